"""Tries the cases of `hostile_devices` in several processes: devices fail at random calls, or at each call.

A case mostly waits for deadlines. Therefore many cases run at once, each worker process with a cell of its
own. A loaded machine may make a run late. A case that is late but otherwise right is tried again alone at the
end, and fails only if it is late again.
"""

import contextlib
import random
import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

from hostile_devices import ROWS, Bench, End
from relays import MODES, Case, Row

NEVER = 1 << 40  # number of a row that no run reaches
REPORTED = 100  # cases after which the summary is printed
TRIES = (
    3  # most runs of a case until one reaches its call; the number of polls differs from run to run
)


def cases(count: int, seed: int, first: int = 0) -> Iterator[Case]:
    """Yields `count` cases: every device and mode in turn, each at a random call."""
    pairs = [(device, mode) for device in ROWS for mode in MODES]
    for number in range(first, first + count):
        device, mode = pairs[number % len(pairs)]
        draw = random.Random(f"{seed}/{number}")
        yield Case(device, mode, draw.randrange(ROWS[device]), draw.choice((0, draw.randrange(50))))


def every(devices: Collection[str], *, polls: bool = False) -> Iterator[Case]:
    """Yields a case for each call to these devices in the run of one part, in each mode.

    Two runs without a fault count the calls. Where a gripper is polled repeatedly, only the first call and
    the first and last cycle of polls are taken, unless `polls` is true. All calls to an arm are taken, since
    each belongs to another step.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Bench(Path(folder))) as bench:
        for device in devices:
            rows = _counted(bench, device)
            some = device.startswith("gripper") and not polls
            of_rows = [row.polls() if some else range(row.calls) for row in rows]
            taken = [(number, poll) for number, each in enumerate(of_rows) for poll in each]
            print(f"{device}: {len(taken)} of {sum(row.calls for row in rows)} calls", flush=True)
            yield from (Case(device, mode, *call) for call in taken for mode in MODES)


def _counted(bench: Bench, device: str) -> list[Row]:
    """Repeats a run without a fault until two runs end well; counts the calls to a device in both.

    Returns the rows (see `Row`) that both runs have, each with the lesser of its two numbers of calls.

    Raises:
        RuntimeError: too many of the runs end badly.
    """
    counted: list[list[Row]] = []
    for _ in range(2 + TRIES):
        end = bench.run(Case(device, "silent", NEVER))
        if end.rows and not end.wrong:
            counted.append(end.rows)
        if len(counted) == 2:
            pairs = zip(*counted, strict=False)
            return [Row(min(one.calls, other.calls), one.cycle) for one, other in pairs]
    said = f"exit {end.code}, {end.wrong}"
    raise RuntimeError(f"{device}: no two runs without a fault end well: {said}")


class Summary:
    """Results of the cases so far.

    Attributes:
        failures: a sentence for each case that failed.
        loaded: the cases that were late beside other cases, but in time when run alone.
    """

    def __init__(self) -> None:
        self.failures: list[str] = []
        self.loaded: list[str] = []
        self._ends: dict[tuple[str, str], Counter[str]] = {}
        self._longest: dict[tuple[str, str], float] = {}

    def add(self, case: Case, end: End) -> None:
        """Counts how a case ended, and notes the longest time of its device and mode."""
        key, name = case[:2], f"exit {end.code}" if end.reached else "not reached"
        self._ends.setdefault(key, Counter())[name] += 1
        self._longest[key] = max(self._longest.get(key, 0.0), end.took_s)

    @property
    def count(self) -> int:
        """Number of cases."""
        return sum(ends.total() for ends in self._ends.values())

    def line(self) -> str:
        """The results in a line of text."""
        ends = sum(self._ends.values(), Counter[str]())
        longest: dict[str, float] = {}
        for (_, mode), seconds in self._longest.items():
            longest[mode] = max(longest.get(mode, 0.0), seconds)
        slowest = ", ".join(f"{mode} {seconds:.1f} s" for mode, seconds in longest.items())
        return f"{self.count} cases, {dict(sorted(ends.items()))}; longest: {slowest}"

    def result(self) -> dict[str, Any]:
        """The results by device and mode, as tests/bench/results keeps them."""
        record: dict[str, Any] = {}
        for (device, mode), ends in self._ends.items():
            figures = {"cases": ends.total(), "ends": dict(sorted(ends.items()))}
            figures["longest_s"] = round(self._longest[device, mode], 1)
            record.setdefault(device, {})[mode] = figures
        return {"devices": record, "failures": self.failures, "late_only_among_others": self.loaded}


def campaign(taken: Iterable[tuple[int, Case]], jobs: int) -> Summary:
    """Tries numbered cases, `jobs` at once; prints those that fail, in order, and returns the summary."""
    summary, late = Summary(), []
    numbered = list(taken)
    with tempfile.TemporaryDirectory() as folder:
        with ProcessPoolExecutor(jobs, get_context("fork"), _Worker.open, (folder,)) as pool:
            ends = pool.map(_Worker.tried, [case for _, case in numbered])
            for (number, case), end in zip(numbered, ends, strict=True):
                if end.late and not end.wrong:
                    print(f"late, to be tried alone: {number} {case}: {end.late}", flush=True)
                    late.append((number, case))
                else:
                    _count(summary, number, case, end)
        with contextlib.closing(Bench(Path(tempfile.mkdtemp(dir=folder)))) as bench:
            for number, case in late:
                end = tried(bench, case)
                if not end.late:
                    summary.loaded.append(f"{number} {case}")
                _count(summary, number, case, end)
    print(summary.line())
    print(f"{len(summary.loaded)} were late among others, and in time alone")
    return summary


def _count(summary: Summary, number: int, case: Case, end: End) -> None:
    summary.add(case, end)
    if wrong := [*end.wrong, *filter(None, [end.late])]:
        summary.failures.append(f"{number} {case}: {'; '.join(wrong)}")
        print(f"FAILED {summary.failures[-1]}", flush=True)
    if summary.count % REPORTED == 0:
        print(summary.line(), flush=True)


def tried(bench: Bench, case: Case) -> End:
    """Runs a case until a run reaches the case's call or goes wrong, at most `TRIES` times.

    Returns how the last run ended.
    """
    for _ in range(TRIES):
        end = bench.run(case)
        if end.reached or end.wrong:
            break
    return end


class _Worker:
    """A worker process with its own cell; the cell is closed when the process ends."""

    bench: Bench

    @classmethod
    def open(cls, folder: str) -> None:
        cls.bench = Bench(Path(tempfile.mkdtemp(dir=folder)))
        Finalize(None, cls.bench.close, exitpriority=1)  # atexit does not work in a worker process

    @classmethod
    def tried(cls, case: Case) -> End:
        return tried(cls.bench, case)
