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
`campaign(count, seed)` tries random cases, prints those that fail, and returns how many did.
"""

import contextlib
import os
import random
import re
import select
import socket
import subprocess
import tempfile
import termios
import threading
import time
import tty
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from running_cells import ROOT, RunningCell, runtime_command
from sample_tables import small_table

from drivers import connect
from drivers.clock import LINK_TIMEOUT_S
from drivers.robotiq.link import READ_TRIES
from drivers.robotiq.modbus import DRAIN_S
from drivers.ur.rtde import ANSWER_S
from runtime.devices.clock import LINK_MARGIN_S
from runtime.execution.executor import expected_s
from runtime.execution.watch import DEADLINE_FACTOR
from runtime.journal.chain import records, verify
from runtime.table import dump

MODES = ("silent", "slow", "drip", "endless", "stopped", "gone")
# Devices, and about how many calls of a run of one part each hears.
CALLS = {
    "gripper": 150,
    "gripper_tcp": 150,
    "gripper_rtu_tcp": 150,
    "gripper_urcap": 900,
    "arm": 16,
    "arm_ur": 30,
    "arm_ur_script": 3,
}
SCALE = 12.0
SLOW_S, DRIP_S = 0.2, 0.1
SPARE_S = 2.0
HANG_S = 120.0
CODES = {0, 20, 21, 22, 23}
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
}


class Case(NamedTuple):
    """Which device changes how, at which of the run's calls to it."""

    device: str
    mode: str
    call: int

    @property
    def deadline_s(self) -> float:
        """By when after that call the run has to end; a slow device makes no call late, but the squeeze."""
        if self.mode == "slow":
            table = small_table()
            squeezes = [expected_s(table, node) for node in table.nodes]
            # Activation and end of the run count as one more.
            return (len(squeezes) + 1) * (DEADLINE_FACTOR * max(squeezes) / SCALE + LINK_MARGIN_S)
        return DEADLINES_S[self.device]


class Hindrance:
    """Counts calls; from the case's call on its mode holds."""

    def __init__(self, case: Case | None) -> None:
        self.case, self.calls = case, 0
        self.began_s: float | None = None

    def heard(self) -> str:
        """One more call; the mode that holds now, empty for none."""
        self.calls += 1
        if self.case is None or self.calls <= self.case.call:
            return ""
        if self.began_s is None:
            self.began_s = time.monotonic()
        return self.case.mode

    @property
    def mode(self) -> str:
        """The mode that holds."""
        return "" if self.began_s is None or self.case is None else self.case.mode


class Relay:
    """Bytes between a run and one device, both ways, until it is closed."""

    def __init__(self, hindrance: Hindrance) -> None:
        self._hindrance = hindrance
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        raise NotImplementedError

    def _stop_flow(self) -> None:
        """Take nothing any more."""

    def _relay(self, run: int, device: int) -> None:
        """Relay between two descriptors until one hangs up."""
        while not self._closed.is_set():
            mode = self._hindrance.mode
            if mode == "gone":
                return
            if mode == "endless":
                with contextlib.suppress(BlockingIOError):
                    if select.select([], [run], [], 0.01)[1]:
                        os.write(run, os.urandom(200))
            listened = [device] if mode == "stopped" else [run, device]
            ready = select.select(listened, [], [], 0.0 if mode == "endless" else 0.02)[0]
            if run in ready:
                if not (data := os.read(run, 4096)):
                    return
                mode = self._hindrance.heard()
                if mode == "stopped":
                    self._stop_flow()
                if mode in ("", "slow", "drip"):
                    os.write(device, data)
            if device in ready:
                if not (data := os.read(device, 4096)):
                    return
                self._answer(run, data, mode)

    def _answer(self, run: int, data: bytes, mode: str) -> None:
        if mode == "slow":
            self._closed.wait(SLOW_S)
        if mode == "drip":
            for at in range(len(data)):
                self._closed.wait(DRIP_S)
                os.write(run, data[at : at + 1])
        elif mode in ("", "slow"):
            os.write(run, data)


class TcpRelay(Relay):
    """In front of a TCP port."""

    def __init__(self, hindrance: Hindrance, place: tuple[str, int], port: int = 0) -> None:
        super().__init__(hindrance)
        self._place = place
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]

    def close(self) -> None:
        super().close()
        self._listener.close()

    def _run(self) -> None:
        while not self._closed.is_set():
            if not select.select([self._listener], [], [], 0.05)[0]:
                continue
            run = self._listener.accept()[0]
            with contextlib.suppress(OSError), run, socket.create_connection(self._place) as device:
                self._relay(run.fileno(), device.fileno())


class TtyRelay(Relay):
    """In front of a pseudo-terminal."""

    def __init__(self, hindrance: Hindrance, path: str) -> None:
        super().__init__(hindrance)
        self._device = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._device)
        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        self.path = os.ttyname(self._ends[1])

    def close(self) -> None:
        super().close()
        for descriptor in (*self._ends, self._device):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            self._relay(self._ends[0], self._device)
        for descriptor in self._ends:
            os.close(descriptor)

    def _stop_flow(self) -> None:
        termios.tcflow(self._ends[1], termios.TCOOFF)


class Bench:
    """A simulated cell of one's own, and runs on it through relays."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.tree = folder / "small.msgpack"
        dump(small_table(), self.tree)
        self.cell = RunningCell(self.tree, time_scale=SCALE)
        self._runs = 0

    def close(self) -> None:
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
        else:
            relays, arm = _ur_relays(ends["arm_ur"], hindrance, case.device)
        try:
            for relay in relays:
                relay.start()
            yield gripper, arm, hindrance
        finally:
            for relay in relays:
                relay.close()

    def run(self, case: Case) -> tuple[str, float, list[str]]:
        """How a run ended, after how many seconds of the hindrance, and what is wrong with that."""
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
                return "hangs", HANG_S, [f"it hangs: {process.communicate()[0][-400:]}"]
            ended_s = time.monotonic()
        took_s = 0.0 if hindrance.began_s is None else ended_s - hindrance.began_s
        code = process.returncode
        wrong = [] if code in CODES else [f"exit code {code}: {told[-400:]}"]
        if took_s > case.deadline_s + SPARE_S:
            wrong.append(f"it took {took_s:.1f} s, its deadline is {case.deadline_s:.1f} s")
        wrong += ["a traceback"] * ("Traceback" in told)
        wrong += [f"a line of {len(line)} characters" for line in told.splitlines() if len(line) > 600]
        return str(code), took_s, [*wrong, *_journal_faults(journal, code), *self._rest_faults(case, told)]

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


def campaign(count: int, seed: int, first: int = 0) -> int:
    """Try so many cases; returns how many failed, each of which is printed with its number."""
    failed, ends, slowest = 0, Counter[str](), dict.fromkeys(MODES, 0.0)
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Bench(Path(folder))) as bench:
        for number, case in cases(count, seed, first):
            end, took_s, wrong = bench.run(case)
            ends[f"exit {end}"] += 1
            slowest[case.mode] = max(slowest[case.mode], took_s)
            if wrong:
                failed += 1
                print(f"FAILED {number} {case}: {'; '.join(wrong)}", flush=True)
    told = ", ".join(f"{mode} {seconds:.1f} s" for mode, seconds in slowest.items())
    print(f"{count} cases, {dict(ends)}; longest: {told}")
    return failed
