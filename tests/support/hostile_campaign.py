"""Campaigns of hostile devices: random calls, or each call of a part's run, several runs at once.

Most of a case is waiting for deadlines, so many go at once, each worker process with a cell of its own. A run
may be late because the machine is loaded: one that is past its deadline, and nothing else, is tried once more
alone when the others are done, and fails only if it is late again.
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

NEVER = 1 << 40  # a row that no run comes to
REPORTED = 100
TRIES = 3  # until a run comes to the case's call: they differ by some polls


def cases(count: int, seed: int, first: int = 0) -> Iterator[Case]:
    """Random cases by their numbers: every device and mode in turn, each at a random call."""
    pairs = [(device, mode) for device in ROWS for mode in MODES]
    for number in range(first, first + count):
        device, mode = pairs[number % len(pairs)]
        draw = random.Random(f"{seed}/{number}")
        yield Case(device, mode, draw.randrange(ROWS[device]), draw.choice((0, draw.randrange(50))))


def every(devices: Collection[str], *, polls: bool = False) -> Iterator[Case]:
    """Each call of a part's run to each device, in each mode; runs without a fault count them.

    Of the polls of a gripper that moves, the first, the second and the last are taken, or with `polls` all.
    An arm is asked once a step, so its calls differ even where they ask the same.
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
    """The calls that two runs, which end well, both make."""
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
    """What the cases so far came to.

    Attributes:
        failures: a sentence each.
        loaded: cases that were late among others and in time alone.
    """

    def __init__(self) -> None:
        self.failures: list[str] = []
        self.loaded: list[str] = []
        self._ends: dict[tuple[str, str], Counter[str]] = {}
        self._longest: dict[tuple[str, str], float] = {}

    def add(self, case: Case, end: End) -> None:
        """Count a case."""
        key, name = case[:2], f"exit {end.code}" if end.reached else "not reached"
        self._ends.setdefault(key, Counter())[name] += 1
        self._longest[key] = max(self._longest.get(key, 0.0), end.took_s)

    @property
    def count(self) -> int:
        """How many cases."""
        return sum(ends.total() for ends in self._ends.values())

    def line(self) -> str:
        """All of it in a line."""
        ends = sum(self._ends.values(), Counter[str]())
        longest: dict[str, float] = {}
        for (_, mode), seconds in self._longest.items():
            longest[mode] = max(longest.get(mode, 0.0), seconds)
        slowest = ", ".join(f"{mode} {seconds:.1f} s" for mode, seconds in longest.items())
        return f"{self.count} cases, {dict(sorted(ends.items()))}; longest: {slowest}"

    def result(self) -> dict[str, Any]:
        """All of it by device and mode, as tests/bench/results keeps it."""
        record: dict[str, Any] = {}
        for (device, mode), ends in self._ends.items():
            figures = {"cases": ends.total(), "ends": dict(sorted(ends.items()))}
            figures["longest_s"] = round(self._longest[device, mode], 1)
            record.setdefault(device, {})[mode] = figures
        return {"devices": record, "failures": self.failures, "late_only_among_others": self.loaded}


def campaign(taken: Iterable[tuple[int, Case]], jobs: int) -> Summary:
    """Try numbered cases, so many at once; what fails is printed, in their order."""
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
    """How the run ended that came to the case's call; the last one's where none did."""
    for _ in range(TRIES):
        end = bench.run(case)
        if end.reached or end.wrong:
            break
    return end


class _Worker:
    """What a worker process has: a cell of its own, until it ends."""

    bench: Bench

    @classmethod
    def open(cls, folder: str) -> None:
        cls.bench = Bench(Path(tempfile.mkdtemp(dir=folder)))
        Finalize(None, cls.bench.close, exitpriority=1)  # a worker process runs no atexit

    @classmethod
    def tried(cls, case: Case) -> End:
        return tried(cls.bench, case)
