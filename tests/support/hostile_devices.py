"""Devices of a simulated cell that fall silent, slow, endless, stopped or gone at any call of a run.

Between a run (a process) and its `grasp-cell` stands a relay for each device, which counts what the run sends
there. At the call with a given number the relay changes what comes back, for good:

- silent: it hears and never answers
- slow: each answer comes `SLOW_S` late
- drip: answers come a byte at a time, `DRIP_S` apart
- endless: bytes without an end
- stopped: it takes nothing any more (on a terminal: its flow is stopped)
- gone: it hangs up

A run has to end by its deadline and `SPARE_S`, with a documented exit code, the arm and the fingers at rest,
the arm up where its state was known, and the part's outcome and the run's end in the journal.
`campaign` tries random cases, or every call of a run, prints those that fail, and returns how many did.
The OmniCore controller is not part of the cell: its arm moves beside it.
"""

import contextlib
import random
import re
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from arm_rigs import BASE, OmniCoreRig
from relays import MODES, Case, Hindrance, Relay, TcpRelay, TtyRelay
from running_cells import ROOT, RunningCell, runtime_command
from sample_tables import small_table

from drivers import connect
from drivers.abb import rws
from drivers.clock import LINK_TIMEOUT_S
from drivers.robotiq.link import READ_TRIES
from drivers.robotiq.modbus import DRAIN_S
from drivers.ur.rtde import ANSWER_S
from runtime.devices.clock import LINK_MARGIN_S
from runtime.execution.executor import expected_s
from runtime.execution.watch import DEADLINE_FACTOR
from runtime.journal.chain import records, verify
from runtime.table import dump

# Devices, and about how many calls of a run of one part each hears; `every` counts them.
CALLS = {
    "gripper": 150,
    "gripper_tcp": 150,
    "gripper_rtu_tcp": 150,
    "gripper_urcap": 900,
    "arm": 16,
    "arm_ur": 30,
    "arm_ur_script": 3,
    "arm_omnicore": 60,
}
SCALE = 12.0
SPARE_S = 2.0
HANG_S = 120.0
NEVER = 1 << 40  # a call that no run comes to
REPORTED = 50
AGAIN = 8
CODES = {0, 10, 20, 21, 22, 23}  # 10: the jaws met no part, where the arm is not the cell's
UP_MM = small_table().limits.retreat_height_um / 1000
_TRIES_S = READ_TRIES * (LINK_TIMEOUT_S + DRAIN_S)
# By when a run ends whose device does not answer: the call's own deadline and, for the gripper, as much again
# for the safe sequence. A motion of the arm may take its own time, and has 3 device seconds for its ramps.
MOTION_S = 8.0
DEADLINES_S = {
    **dict.fromkeys(
        ("gripper", "gripper_tcp", "gripper_rtu_tcp", "gripper_urcap"), 2.0 * _TRIES_S + LINK_TIMEOUT_S
    ),
    "arm": 2.0 + MOTION_S,
    "arm_ur": 3.0 * ANSWER_S + MOTION_S,
    "arm_ur_script": 3.0 * ANSWER_S + MOTION_S,
    "arm_omnicore": 2.0 * rws.ANSWER_S + MOTION_S,
}


def deadline_s(case: Case) -> float:
    """By when after its call the run has to end; a slow device makes no call late, but the squeeze."""
    if case.mode != "slow":
        return DEADLINES_S[case.device]
    table = small_table()
    squeezes = [expected_s(table, node) for node in table.nodes]
    # Activation and end of the run count as one more.
    return (len(squeezes) + 1) * (DEADLINE_FACTOR * max(squeezes) / SCALE + LINK_MARGIN_S)


class End(NamedTuple):
    """How a run ended."""

    code: str
    took_s: float  # after the hindrance
    wrong: list[str]
    calls: int  # that its device heard


class Bench:
    """A simulated cell of one's own, and runs on it through relays."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.tree = folder / "small.msgpack"
        dump(small_table(), self.tree)
        self.cell = RunningCell(self.tree, time_scale=SCALE)
        self._runs = 0
        self._closing = contextlib.ExitStack()

    @cached_property
    def _omnicore(self) -> OmniCoreRig:
        """A controller of its own, whose arm moves nothing in the cell."""
        rig = OmniCoreRig()
        self._closing.callback(rig.close)
        return rig

    def close(self) -> None:
        self._closing.close()
        self.cell.__exit__()

    @contextlib.contextmanager
    def addresses(self, case: Case) -> Iterator[tuple[str, str, Hindrance]]:
        """Addresses of gripper and arm for a run; the case's device is behind a relay that obeys it."""
        ends, hindrance = self.cell.endpoints, Hindrance(case)
        relays: list[Relay] = []
        gripper, arm = ends["gripper"], ends["arm"]
        if case.device == "gripper":
            relays.append(TtyRelay(hindrance, gripper))
            gripper = relays[0].path
        elif case.device.startswith("gripper"):
            scheme, place = _place(ends[case.device])
            relays.append(TcpRelay(hindrance, place))
            gripper = f"{scheme}://127.0.0.1:{relays[0].port}"
        elif case.device == "arm":
            _, place = _place(arm)
            relays.append(TcpRelay(hindrance, place))
            arm = f"tcp://127.0.0.1:{relays[0].port}?{arm.partition('?')[2]}"
        elif case.device == "arm_omnicore":
            relays.append(TcpRelay(hindrance, ("127.0.0.1", self._omnicore.server.port)))
            base = ",".join(map(str, (*BASE[:3], *BASE[3])))
            arm = f"omnicore://127.0.0.1:{relays[0].port}?base={base}{OmniCoreRig.limits}"
        else:
            relays, arm = _ur_relays(ends["arm_ur"], hindrance, case.device)
        try:
            for relay in relays:
                relay.start()
            yield gripper, arm, hindrance
        finally:
            for relay in relays:
                relay.close()

    def run(self, case: Case) -> End:
        """How a run ended, and what is wrong with that."""
        self._runs += 1
        journal = self._folder / f"journal-{self._runs}.jsonl"
        with self.addresses(case) as (gripper, arm, hindrance):
            words = runtime_command(self.tree, self.cell, journal, "--jaws-empty", "--count", "1")
            words[words.index("--port") + 1], words[words.index("--arm") + 1] = gripper, arm
            process = subprocess.Popen(
                words,
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            try:
                told = process.communicate(timeout=HANG_S)[0]
            except subprocess.TimeoutExpired:
                process.kill()
                said = process.communicate()[0][-400:]
                return End("hangs", HANG_S, [f"it hangs: {said}"], hindrance.calls)
            ended_s = time.monotonic()
        took_s = 0.0 if hindrance.began_s is None else ended_s - hindrance.began_s
        code = process.returncode
        wrong = [] if code in CODES else [f"exit code {code}: {told[-400:]}"]
        if took_s > deadline_s(case) + SPARE_S:
            wrong.append(f"it took {took_s:.1f} s, its deadline is {deadline_s(case):.1f} s")
        wrong += ["a traceback"] * ("Traceback" in told)
        wrong += [f"a line of {len(line)} characters" for line in told.splitlines() if len(line) > 600]
        wrong += [*_journal_faults(journal, code), *self._rest_faults(case, told)]
        return End(str(code), took_s, wrong, hindrance.calls)

    def _rest_faults(self, case: Case, told: str) -> Iterator[str]:
        """Whether arm and fingers rest, and the arm is up where its state was known."""
        with contextlib.closing(connect.gripper(self.cell.endpoints["gripper"], time_scale=SCALE)) as gripper:
            if gripper.state().moving and "NOT KNOWN TO BE STOPPED" not in told:
                yield "the fingers move"
            with contextlib.closing(connect.arm(self.cell.endpoints["arm"], time_scale=SCALE)) as arm:
                before, after = arm.pose(), arm.pose()
                if before != after and "arm not moved: state unknown" not in told:
                    yield "the arm moves"
                if (
                    not case.device.startswith("arm")
                    and "state unknown" not in told
                    and after[2] < UP_MM - 0.1
                ):
                    yield f"the arm stands at {after[2]:.1f} mm"
                if after[2] < UP_MM - 0.1:  # for the next one
                    arm.move_linear(*after[:2], UP_MM, after[3], 100.0)
            gripper.stop()


def _place(url: str) -> tuple[str, tuple[str, int]]:
    found = re.match(r"([\w+]+)://([\w.]+):(\d+)", url)
    assert found is not None
    return found[1], (found[2], int(found[3]))


def _ur_relays(url: str, hindrance: Hindrance, device: str) -> tuple[list[Relay], str]:
    """Relays of both ports of a UR controller, the one for programs two below; the other obeys nothing."""
    _, (host, port) = _place(url)
    sound = Hindrance(None)
    reading, programs = (hindrance, sound) if device == "arm_ur" else (sound, hindrance)
    while True:
        script = TcpRelay(programs, (host, port - 2))
        try:
            rtde = TcpRelay(reading, (host, port), script.port + 2)
        except OSError:  # taken
            script._listener.close()
            continue
        return [script, rtde], f"ur://127.0.0.1:{rtde.port}?{url.partition('?')[2]}"


def _journal_faults(journal: Path, code: int) -> Iterator[str]:
    """What a journal lacks: its last record, and the outcome of a part that was begun."""
    if not journal.exists():
        if code == 0:
            yield "no journal"
        return
    if not verify(journal).closed:
        yield "the journal has no end"
    kinds = [record["kind"] for record in records(journal)]
    if kinds.count("part") != kinds.count("outcome"):
        yield "a part without an outcome"


def cases(count: int, seed: int, first: int = 0) -> Iterator[tuple[int, Case]]:
    """Random cases by their numbers: every device and mode in turn, each at a random call."""
    pairs = [(device, mode) for device in CALLS for mode in MODES]
    for number in range(first, first + count):
        device, mode = pairs[number % len(pairs)]
        draw = random.Random(f"{seed}/{number}")
        yield number, Case(device, mode, draw.randrange(CALLS[device]))


def every(bench: Bench, devices: Collection[str]) -> Iterator[tuple[int, Case]]:
    """Each call of a part's run to each device, in each mode; a run without a fault counts them."""
    number = 0
    for device in devices:
        calls = bench.run(Case(device, "silent", NEVER)).calls
        print(f"{device}: {calls} calls", flush=True)
        for call in range(calls):
            for mode in MODES:
                yield number, Case(device, mode, call)
                number += 1


def campaign(count: int, seed: int, first: int = 0, devices: Collection[str] = ()) -> int:
    """Try so many random cases, or every call of the devices named.

    Returns:
        How many failed, each of which is printed with its number.
    """
    failed, ends, slowest = 0, Counter[str](), dict.fromkeys(MODES, 0.0)
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Bench(Path(folder))) as bench:
        for number, case in every(bench, devices) if devices else cases(count, seed, first):
            end = bench.run(case)
            for _ in range(AGAIN if devices else 0):  # a part that takes fewer squeezes has fewer calls
                if end.calls > case.call or end.wrong:
                    break
                end = bench.run(case)
            ends[f"exit {end.code}" if end.calls > case.call else "not reached"] += 1
            slowest[case.mode] = max(slowest[case.mode], end.took_s)
            if end.wrong:
                failed += 1
                print(f"FAILED {number} {case}: {'; '.join(end.wrong)}", flush=True)
            if sum(ends.values()) % REPORTED == 0:
                print(_figures(ends, slowest), flush=True)
    print(_figures(ends, slowest))
    return failed


def _figures(ends: Counter[str], slowest: Mapping[str, float]) -> str:
    longest = ", ".join(f"{mode} {seconds:.1f} s" for mode, seconds in slowest.items())
    return f"{sum(ends.values())} cases, {dict(ends)}; longest: {longest}"
