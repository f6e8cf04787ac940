"""Runs `grasp-runtime` in a simulated cell, one device of which begins to fail at a given call.

The run reaches this device through a relay, which counts the calls of the run. From the given call on, the
device is in one of these modes:

- silent: it receives, and never answers
- slow: each answer comes `SLOW_S` late
- drip: answers come a byte at a time, `DRIP_S` apart
- endless: it sends bytes without an end
- stopped: it receives nothing any more (on a terminal, the flow is stopped)
- gone: it hangs up

The run has to end `SPARE_S` after its deadline at the latest, with a documented exit code. Arm and fingers
have to be at rest, and the arm up if its state was known. The journal has to contain the outcome of the part
and the end of the run. `hostile_campaign` tries random cases, or every call of a run.

The OmniCore controller is not part of the cell: when its arm moves, the hand in the cell does not. A run uses
scene and camera only if it starts its own cell (`--port sim`). To test these two devices, `run_on_cell` gives
such a run a cell that is already running, instead of a new one.
"""

import contextlib
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from arm_rigs import BASE, OmniCoreRig
from cameras import keep_standard
from programs import ROOT, RUNTIME, TABLE, started
from relays import SLOW_S, Case, Hindrance, Relay, Row, TcpRelay, TtyRelay
from running_cells import RunningCell
from sample_tables import small_table, two_squeeze_table

from drivers import connect
from drivers.abb import rws
from drivers.clock import LINK_TIMEOUT_S
from drivers.links import DRAIN_S, READ_TRIES
from drivers.sim.physics import scene_protocol
from drivers.ur.rtde import ANSWER_S
from runtime.devices import audit
from runtime.devices.clock import LINK_MARGIN_S
from runtime.execution.watch import DEADLINE_FACTOR, expected_of
from runtime.journal.chain import records, verify
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.table import dump

# Devices, and the approximate number of rows of calls to each in a run of one part.
ROWS = {
    "gripper": 19,
    "gripper_tcp": 19,
    "gripper_rtu_tcp": 19,
    "gripper_urcap": 79,
    "arm": 22,
    "arm_ur": 4,
    "arm_ur_script": 3,
    "arm_omnicore": 80,
    "scene": 2,
    "camera": 1,
}
GRIPPERS = ("gripper", "gripper_tcp", "gripper_rtu_tcp", "gripper_urcap")
SIMULATED = ("scene", "camera")  # only runs with --port sim call these
SCALE = 12.0
SPARE_S = 2.0
HANG_S = 240.0
URCAP_CALLS = 1000  # calls of a run to the URCap, about
CODES = {0, 10, 20, 21}  # 10 (rejected): the jaws meet no part if another arm moves
UP_MM = small_table().limits.retreat_height_um / 1000
_TRIES_S = READ_TRIES * (LINK_TIMEOUT_S + DRAIN_S)
MOTION_S = 8.0  # time for a motion of the arm, including 3 device seconds for its ramps
# Time in which a run ends if its device does not answer: the deadline of the call and, for the gripper, as
# much again for the safe sequence; for other devices the time of a motion.
DEADLINES_S = {
    **dict.fromkeys(GRIPPERS, 2.0 * _TRIES_S + LINK_TIMEOUT_S),
    "arm": 2.0 + MOTION_S,
    "arm_ur": 3.0 * ANSWER_S + MOTION_S,
    "arm_ur_script": 3.0 * ANSWER_S + MOTION_S,
    "arm_omnicore": 2.0 * rws.ANSWER_S + MOTION_S,
    "scene": scene_protocol.ANSWER_S + MOTION_S,
    "camera": audit.ANSWER_S + MOTION_S,
}


def deadline_s(case: Case) -> float:
    """Returns the deadline of the run, counted from the call of the case [s].

    A slow device answers each call before the call's deadline. Therefore its run has the deadlines of all
    squeezes together.
    """
    if case.mode != "slow" or case.device in SIMULATED:
        return DEADLINES_S[case.device]
    table = small_table()
    squeezes = [expected_of(table, node).total_s for node in table.nodes]
    # Activation and end count as one more squeeze.
    squeezing_s = (len(squeezes) + 1) * (DEADLINE_FACTOR * max(squeezes) / SCALE + LINK_MARGIN_S)
    # Calls outside of squeezes are late, too: the URCap needs seven for a reading.
    return max(squeezing_s, URCAP_CALLS * SLOW_S if case.device == "gripper_urcap" else 0.0)


class End(NamedTuple):
    """How a run ended.

    Attributes:
        code: exit code, or "hangs".
        took_s: time from the moment at which the device begins to fail to the end of the run [s].
        wrong: a sentence for each violation, except for lateness, which the machine's load may cause.
        late: a sentence if the run ended too late; empty if it ended in time.
        reached: whether the run reached the call of the case.
        rows: the calls to the device.
    """

    code: str
    took_s: float
    wrong: list[str]
    late: str
    reached: bool
    rows: list[Row]


class Bench:
    """A simulated cell, and runs that use it through relays."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.tree = folder / "small.msgpack"
        dump(two_squeeze_table(), self.tree)
        self.cell = RunningCell(self.tree, time_scale=SCALE)
        self._runs = 0
        self._closing = contextlib.ExitStack()

    @cached_property
    def _omnicore(self) -> OmniCoreRig:
        """A simulated OmniCore controller; its arm moves nothing in the cell."""
        rig = OmniCoreRig()
        self._closing.callback(rig.close)
        return rig

    @cached_property
    def _seen_cell(self) -> RunningCell:
        """A cell with a camera; its world knows the true poses of parts."""
        more = ("--world", DEFAULT_WORLD, "--camera")
        return self._closing.enter_context(RunningCell(TABLE, *more, time_scale=SCALE))

    @cached_property
    def _auditor(self) -> str:
        """The auditor's command for the camera of `_seen_cell`."""
        keep_standard(self._folder)
        words = [sys.executable, "-m", "drivers.camera.audit.command", "judge"]
        words += ["--tree", str(TABLE), "--calibration", str(self._folder / "camera.json")]
        words += ["--tag", str(self._folder / "tag.json")]
        return f"{shlex.join(words)} --camera {{camera}}"

    def close(self) -> None:
        self._closing.close()
        self.cell.close()

    def _cell_of(self, case: Case) -> RunningCell:
        return self._seen_cell if case.device == "camera" else self.cell

    @contextlib.contextmanager
    def endpoints(self, case: Case) -> Iterator[tuple[dict[str, str], Hindrance]]:
        """Context with a relay in front of the case's device.

        Yields the addresses of the cell's devices by name, and the hindrance. For the case's device, the
        address is that of the relay. The hindrance counts the calls and changes the mode of the device.
        """
        hindrance, device = Hindrance(case), case.device
        ends = dict(self._cell_of(case).endpoints)
        # Role of the device in a run: gripper, arm, scene or camera.
        kind = device.partition("_")[0]
        relays: list[Relay] = []
        if device == "gripper":
            relays.append(tty := TtyRelay(hindrance, ends["gripper"]))
            ends["gripper"] = tty.path
        elif device == "arm_omnicore":
            relays.append(tcp := TcpRelay(hindrance, ("127.0.0.1", self._omnicore.server.port)))
            base = ",".join(map(str, (*BASE[:3], *BASE[3])))
            ends["arm"] = f"omnicore://127.0.0.1:{tcp.port}?base={base}{OmniCoreRig.limits}"
        elif device.startswith("arm_ur"):
            relays, ends["arm"] = _ur_relays(ends["arm_ur"], hindrance, device)
        else:
            host, port = _place(ends[device])
            relays.append(tcp := TcpRelay(hindrance, (host, port)))
            ends[kind] = ends[device].replace(f"{host}:{port}", f"127.0.0.1:{tcp.port}", 1)
        try:
            for relay in relays:
                relay.start()
            yield ends, hindrance
        finally:
            for relay in relays:
                relay.close()

    def run(self, case: Case) -> End:
        """Runs one part and returns how the run ended, with everything that is wrong."""
        self._runs += 1
        journal = self._folder / f"journal-{self._runs}.jsonl"
        with self.endpoints(case) as (endpoints, hindrance):
            process = started(
                self._words(case, endpoints, journal),
                env={**os.environ, "PYTHONPATH": str(ROOT), "CELL": json.dumps(endpoints)},
                stdin=subprocess.DEVNULL,
                stderr=subprocess.STDOUT,
            )
            try:
                said = process.communicate(timeout=HANG_S)[0]
            except subprocess.TimeoutExpired:
                process.kill()
                said = process.communicate()[0][-400:]
                return End("hangs", HANG_S, [f"it hangs: {said}"], "", True, hindrance.rows)
            ended_s = time.monotonic()
        took_s = 0.0 if hindrance.began_s is None else ended_s - hindrance.began_s
        code = process.returncode
        wrong = [] if code in CODES else [f"exit code {code}: {said[-400:]}"]
        wrong += ["a traceback"] * ("Traceback" in said)
        sizes = (len(line) for line in said.splitlines())
        wrong += [f"a line of {size} characters" for size in sizes if size > 600]
        wrong += [*_journal_faults(journal, code), *self._rest_faults(case, said)]
        bound_s = deadline_s(case)
        late = f"it took {took_s:.1f} s, its deadline is {bound_s:.1f} s"
        late = late if took_s > bound_s + SPARE_S else ""
        return End(str(code), took_s, wrong, late, hindrance.began_s is not None, hindrance.rows)

    def _words(self, case: Case, endpoints: Mapping[str, str], journal: Path) -> list[str]:
        """The command of a run with one part."""
        words = [*RUNTIME, "--port", endpoints["gripper"], "--arm", endpoints["arm"]]
        if case.device in SIMULATED:
            words = [sys.executable, str(ROOT / "tests" / "support" / "run_on_cell.py")]
            words += ["--port", "sim", "--time-scale", str(SCALE)]
        tree = self.tree
        if case.device == "camera":
            tree = TABLE
            words += ["--audit", self._auditor]
        words += ["--tree", str(tree), "--activate", "--tips", "straight", "--jaws-empty"]
        return [*words, "--journal", str(journal), "--count", "1"]

    def _rest_faults(self, case: Case, said: str) -> Iterator[str]:
        """Yields a sentence if arm or fingers move, and if the arm is not up although its state was known.

        Raises the arm and deactivates the gripper for the next run.
        """
        ends = self._cell_of(case).endpoints
        with contextlib.closing(connect.gripper(ends["gripper"], time_scale=SCALE)) as gripper:
            if gripper.state().moving and "NOT KNOWN TO BE STOPPED" not in said:
                yield "the fingers move"
            with contextlib.closing(connect.arm(ends["arm"], time_scale=SCALE)) as arm:
                before, after = arm.pose(), arm.pose()
                if before != after and "arm not moved: state unknown" not in said:
                    yield "the arm moves"
                low = after[2] < UP_MM - 0.1
                if low and not case.device.startswith("arm") and "state unknown" not in said:
                    yield f"the arm stands at {after[2]:.1f} mm"
                if low:  # raises the arm for the next run
                    arm.move_linear((*after[:2], UP_MM, after[3]), 100.0)
            gripper._send({})  # deactivates the gripper, so that each run makes the same calls


def _place(url: str) -> tuple[str, int]:
    host, _, port = urlsplit(url).netloc.partition(":")
    return host, int(port)


def _ur_relays(url: str, hindrance: Hindrance, device: str) -> tuple[list[Relay], str]:
    """Returns relays in front of both ports of a UR controller, and the address of the arm behind them.

    Only the relay of the port that `device` names gets the hindrance. As at a controller, the number of the
    port for programs is two below that of the port for RTDE.
    """
    host, port = _place(url)
    sound = Hindrance(None)
    reading, programs = (hindrance, sound) if device == "arm_ur" else (sound, hindrance)
    while True:
        script = TcpRelay(programs, (host, port - 2))
        try:
            rtde = TcpRelay(reading, (host, port), script.port + 2)
        except OSError:  # the port is in use
            script._listener.close()
            continue
        return [script, rtde], f"ur://127.0.0.1:{rtde.port}?{url.partition('?')[2]}"


def _journal_faults(journal: Path, code: int) -> Iterator[str]:
    """Yields a sentence if the journal, its last record or the outcome of a part is missing."""
    if not journal.exists():
        if code == 0:
            yield "no journal"
        return
    if not verify(journal).closed:
        yield "the journal has no end"
    kinds = [record["kind"] for record in records(journal)]
    if kinds.count("part") != kinds.count("outcome"):
        yield "a part without an outcome"
