"""Sends signals at random moments to processes that run, calibrate or activate a simulated cell.

`campaign(count, seed)` tries `count` cases, prints those that failed and a line at the end, and returns the
number of failures. `campaign(1, seed, first=N)` repeats case N. Each case sends one signal (INT, TERM, HUP,
QUIT), two in quick succession, or STOP, CONT and then one, to a process that uses a `grasp-cell` of this
module. Then a second connection to the gripper and one to the arm check that

- the fingers stand still where the process said that they stopped;
- the arm is up, if the process said so;
- the exit code is that of the first cause: the stop, or the fault that came before it;
- the journal verifies, ends with its last record, and a replay derives the same decisions.

A run with `--port sim` has a cell of its own, which ends together with the run: only the journal is checked.
"""

import contextlib
import json
import random
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from programs import REHEARSAL, RUNTIME, WAIT_S, started
from running_cells import Notices, RunningCell, calibrate_command, runtime_command
from sample_tables import small_table

from drivers import connect
from runtime.journal.chain import records, verify
from runtime.journal.replay import Replay
from runtime.shell.interrupts import SIGNALS
from runtime.table import dump

WORKERS = 4
SCALE = 4.0
UP_MM = small_table().limits.retreat_height_um / 1000
STOPPED, FAULT = 40, 20
# Printed if the interpreter was interrupted while it started, before any code of the project ran.
STARTING = "Fatal Python error: init_"
STILL_S = 0.06  # time between two looks at the fingers
REAL_S = 0.15  # time from the stop at a fault to the arm's retreat, at this scale
PARTS = 2000
# Faults in every second part; in the other parts `Bench.prepare` opens the jaws.
FAULT_AT = '[[fault]]\nkind = "gflt_0e"\nat = 90\npart = '
FAULTS = "".join(f"{FAULT_AT}{part}\n" for part in range(2, PARTS, 2))


class Case(NamedTuple):
    """The signals of a case and their times.

    Attributes:
        kind: name of the kind in `KINDS`.
        numbers: the signals, one after the other.
        delay_s: time from the process's notice (see `Kind`) to the first signal.
        gap_s: time before each later signal.
        pause_s: time for which the process is stopped (SIGSTOP) before the first signal; 0: not stopped.
    """

    kind: str
    numbers: tuple[signal.Signals, ...]
    delay_s: float
    gap_s: float
    pause_s: float


class Ended(NamedTuple):
    """How a process ended: its exit code, what it printed, its journal."""

    code: int
    out: str
    err: str
    journal: Path


def drawn(random_: random.Random) -> Case:
    """Draws a case."""
    kind = random_.choices(list(KINDS), [row.weight for row in KINDS.values()])[0]
    numbers = tuple(random_.choices(SIGNALS, k=random_.choice((1, 1, 2))))
    pause_s = random_.uniform(0.6, 1.6) if kind != "fault" and random_.random() < 0.12 else 0.0
    delay_s, gap_s = random_.uniform(0.0, KINDS[kind].lasts_s), random_.uniform(0.0, 0.1)
    return Case(kind, numbers, delay_s, gap_s, pause_s)


class Bench:
    """A cell with a second connection to its gripper; tries one case after the other.

    Args:
        folder: folder for table, journals and sockets.
        faulty: whether the gripper fails in the middle of every second part.
    """

    def __init__(self, folder: Path, *, faulty: bool) -> None:
        self.folder, self.tree = folder, folder / "small.msgpack"
        dump(small_table(), self.tree)
        more: list[str] = []
        if faulty:
            (folder / "faults.toml").write_text(FAULTS)
            more = ["--faults", str(folder / "faults.toml")]
        self.cell = RunningCell(self.tree, *more, time_scale=SCALE)
        ends = self.cell.endpoints
        self.gripper: Any = connect.gripper(ends["gripper_rtu_tcp"], time_scale=SCALE)
        self.scene: Any = connect.scene(ends["scene"])
        self.number = 0

    def close(self) -> None:
        """Ends the cell."""
        self.gripper.close()
        self.scene.close()
        self.cell.close()

    def prepare(self, *, active: bool) -> None:
        """Opens the jaws, resets the gripper unless `active`, and feeds a part."""
        self.scene.next_part()
        self.gripper.activate()
        self.gripper.move(85_000, 150.0, 20.0)
        self.gripper.wait()
        if not active:
            self.gripper._link.write(bytes(6))
        self.scene.next_part()

    def run(self, case: Case) -> tuple[Ended, list[str]]:
        """Tries a case; returns how the process ended, and a sentence for each broken rule."""
        kind = KINDS[case.kind]
        self.number += 1
        self.prepare(active=kind.active)
        journal = self.folder / f"{self.number}.jsonl"
        with contextlib.closing(Notices(self.folder)) as notices:
            words = kind.command(self, journal)
            process = started(words, env=notices.environment, stdin=subprocess.PIPE)
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                process.stdin.write("\n" * 9)
                process.stdin.flush()
                if kind.notice is None:
                    process.stdout.readline()
                elif kind.notice:
                    notices.wait(kind.notice, process)
                self._send(process, case)
                stdin, process.stdin = process.stdin, None  # its end would be another stop
                out, err = process.communicate(timeout=WAIT_S)
                stdin.close()
            finally:
                process.kill()
                process.wait()
        ended = Ended(process.returncode, out, err, journal)
        wrong = [*self._moving(ended), *self._low(ended), *kind.check(ended)]
        said = f"exit code {ended.code}, said {err.strip()!r}"
        return ended, [f"{sentence}; {said}" for sentence in wrong]

    def _send(self, process: "subprocess.Popen[str]", case: Case) -> None:
        time.sleep(case.delay_s)
        if case.pause_s:
            process.send_signal(signal.SIGSTOP)
            time.sleep(case.pause_s)
            process.send_signal(signal.SIGCONT)
            time.sleep(0.3)
        for index, number in enumerate(case.numbers):
            time.sleep(case.gap_s if index else 0.0)
            process.send_signal(number)

    def _moving(self, ended: Ended) -> Iterator[str]:
        """Yields a sentence if the fingers move, or stand elsewhere than the process said when it ended.

        Also yields one if the output says that a state is not known, and one if it contains a traceback.
        """
        first = self.gripper.state()
        time.sleep(STILL_S)
        last = self.gripper.state()
        if last.moving or first.width_um != last.width_um:
            yield f"the fingers move on, from {first.width_um} to {last.width_um} um"
        output = ended.out + ended.err
        said = re.findall(r"fingers stopped at ([\d.]+) mm", output)
        ours = "simulated cell" not in output  # else the cell ended with the process
        if ours and any(abs(1000 * float(mm) - last.width_um) > 10 for mm in said):
            yield f"the fingers stand at {last.width_um} um, stopped at {said}"
        if "NOT KNOWN" in output:
            yield "a state that is not known"
        if "Traceback" in output and ended.code >= 0 and STARTING not in output:
            yield "a traceback"

    def _low(self, ended: Ended) -> Iterator[str]:
        """Raises the arm; yields a sentence if the arm was not up although the process said so."""
        with contextlib.closing(connect.arm(self.cell.endpoints["arm"], time_scale=SCALE)) as arm:
            x_mm, y_mm, z_mm, angle_rad = arm.pose()
            if z_mm < UP_MM:
                arm.move_linear((x_mm, y_mm, UP_MM, angle_rad), 250.0)
        if "arm at retreat height" in ended.out and z_mm < UP_MM - 0.1:
            yield f"the arm stands at {z_mm} mm"


def _run(bench: Bench, journal: Path) -> list[str]:
    return runtime_command(bench.tree, bench.cell, journal, "--count", "1000")


def _simulate(bench: Bench, journal: Path) -> list[str]:
    """The command of a run with a cell of its own, which ends with the run."""
    words = [*RUNTIME, "--tree", str(bench.tree), "--port", "sim", *REHEARSAL]
    return [*words, "--time-scale", f"{SCALE:g}", "--count", "1000", "--journal", str(journal)]


def _calibrate(bench: Bench, journal: Path) -> list[str]:
    more = ("--blocks", "0,20,40", "--grips", "1000", "--activate")
    return calibrate_command(bench.cell, journal.with_suffix(".json"), *more)


def _stopped(ended: Ended) -> Iterator[str]:
    if ended.code != STOPPED:
        yield "not the exit code of a stop"
    yield from _journal(ended)


def _stopped_or_never_begun(ended: Ended) -> Iterator[str]:
    """Checks the end of a process that got signals while it started.

    Before the process has installed its handlers, a signal kills it. Nothing has moved then, and there must
    be no journal.
    """
    if ended.code >= 0 and STARTING not in ended.err:
        yield from _stopped(ended)
    elif ended.journal.exists():
        yield "killed with a journal"


def _failed(ended: Ended) -> Iterator[str]:
    if ended.code != FAULT:
        yield "not the exit code of the fault"
    if "FAULT" not in ended.out:
        yield "the fault is not told"
    yield from _journal(ended)


def _interrupted(ended: Ended) -> Iterator[str]:
    if ended.code != STOPPED or "fingers stopped at" not in ended.err:
        yield "a calibration that was not stopped"


def _journal(ended: Ended) -> Iterator[str]:
    if not ended.journal.exists():
        return
    seen = verify(ended.journal)
    if not seen.closed:
        yield "the journal has no last record"
    entries = list(records(ended.journal))
    yield from (f"replay: {finding}" for finding in Replay().follow(entries))
    if entries[-1].get("exit_code") != ended.code:
        yield f"the journal ends with {entries[-1]}"
    last = next((each for each in reversed(entries) if each["kind"] == "outcome"), None)
    if last is not None and last["outcome"] in ("fault", "stopped"):
        safe = str(last["safe_state"][0]).startswith("fingers stopped")
        if not safe or last["exit_code"] != ended.code:
            yield f"the outcome is {last}"


class Kind(NamedTuple):
    """What the cases of one kind have in common.

    Attributes:
        weight: relative frequency of the kind.
        active: whether the gripper is active before the process starts.
        lasts_s: longest time from the notice to the first signal.
        command: returns the command of the process.
        notice: report to the service manager after which signals are sent; empty: they are sent at once,
            maybe while the process still starts; None: they are sent after the first line of output.
        check: yields a sentence for each broken rule.
    """

    weight: int
    active: bool
    lasts_s: float
    command: Callable[[Bench, Path], list[str]]
    notice: str | None
    check: Callable[[Ended], Iterator[str]]


KINDS = {
    "start": Kind(2, True, 1.0, _run, "", _stopped_or_never_begun),
    "run": Kind(6, True, 2.5, _run, "READY=1", _stopped),
    "simulated run": Kind(2, True, 2.5, _simulate, "READY=1", _stopped),
    "activation": Kind(4, False, 0.8, _run, "READY=1", _stopped),
    "calibration": Kind(4, True, 1.5, _calibrate, None, _interrupted),
    "calibration's activation": Kind(4, False, 0.8, _calibrate, None, _interrupted),
    "fault": Kind(4, True, REAL_S, _run, ": safe", _failed),
}


@contextlib.contextmanager
def usual_signals() -> Iterator[None]:
    """Context in which no signal of `SIGNALS` is ignored.

    Under `nohup` a program ignores a signal, and the processes that it starts would ignore the signal, too.
    """
    ignored = [number for number in SIGNALS if signal.getsignal(number) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)


def campaign(count: int, seed: int, first: int = 0) -> int:
    """Tries the cases `first` to `first + count - 1` of a seed, and prints each that fails with its number.

    Returns:
        Number of failed cases.
    """
    numbered = [(k, drawn(random.Random(f"{seed}/{k}"))) for k in range(first, first + count)]
    faulty = [each for each in numbered if each[1].kind == "fault"]
    others = [each for each in numbered if each[1].kind != "fault"]
    shares = [faulty, *(others[worker :: WORKERS - 1] for worker in range(WORKERS - 1))]
    failed: list[int] = []

    def work(share: list[tuple[int, Case]], folder: Path) -> None:
        with contextlib.closing(Bench(folder, faulty=share is faulty)) as bench:
            for number, case in share:
                try:
                    _, wrong = bench.run(case)
                except Exception as error:
                    wrong = [f"the case itself failed: {error!r}"]
                if wrong:
                    failed.append(number)
                    said = f"{case}: {'; '.join(wrong)}"
                    print(f"signals, seed {seed}, case {number}: {said}", flush=True)

    pool = ThreadPoolExecutor(WORKERS)
    with tempfile.TemporaryDirectory() as folder, usual_signals(), pool:
        given = [share for share in shares if share]
        list(pool.map(work, given, [Path(tempfile.mkdtemp(dir=folder)) for _ in given]))
    print(json.dumps({"signals": count, "seed": seed, "failed": sorted(failed)}), flush=True)
    return len(failed)
