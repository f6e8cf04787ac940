"""Mutates files of tables and reads the mutants; `tools/hostile tables` tries many.

A seed and a number determine a mutant. It is damaged at one of three depths: the bytes of the file; the
payload, with a digest that fits again; or the values of the sections, packed again, so that only the
validation can detect the damage. Every mutant must be refused by a `TableError`, or be exactly the file of
another valid table.
"""

import hashlib
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from random import Random
from types import FrameType
from typing import Any

import msgpack
from sample_tables import (
    every_field_table,
    pushing_table,
    random_table,
    several_table,
    small_table,
)

from runtime.table import TableError, dumps, loads

LONGEST_S = 20.0  # a mutant that takes longer counts as a hang
VALUES = (0, 1, 2, 3, 127, 128, 255, 1000, 2**31 - 1, 2**34, -1, -2, -(2**31))
STRANGE = (None, True, 2**63, 1.5, "", b"", [], [0] * 64, "ü" * 100, b"\xff" * 200)


@dataclass(slots=True)
class Tally:
    """Results of the mutants: number by depth and verdict, the slowest mutant, and the failures."""

    verdicts: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    slowest: int = -1
    failures: list[str] = field(default_factory=list)


@cache
def seeds() -> tuple[bytes, ...]:
    """Returns the sound files of tables, from which the mutants are made."""
    drawn = (random_table(1, 8), random_table(2, 12), random_table(3, 40))
    tables = (small_table(), several_table(), every_field_table(), pushing_table(), *drawn)
    return tuple(map(dumps, tables))


def run(seed: int, numbers: range, report: Callable[[Tally], None] | None = None) -> Tally:
    """Judges the mutants with these numbers; returns the tally.

    `report` is called with the tally so far after every 10 000 mutants.
    """
    tally = Tally()
    for number in numbers:
        depth, data = mutant(seed, number)
        start = time.process_time()
        try:
            with _limit(LONGEST_S):
                verdict = judge(depth, data)
        except Exception as error:
            verdict = "failed"
            said = f"{type(error).__name__}: {error}"
            tally.failures.append(f"--seed {seed} --first {number}: {said}")
        taken = time.process_time() - start
        if taken > tally.slowest_s:
            tally.slowest_s, tally.slowest = taken, number
        tally.verdicts[f"{depth}: {verdict}"] += 1
        if report is not None and number % 10_000 == 9_999:
            report(tally)
    return tally


def judge(depth: str, data: bytes) -> str:
    """Reads a mutant; returns "refused", "unchanged" (the mutation had no effect) or "another table".

    Raises:
        AssertionError: the mutant is read as a table, although it was damaged without a new digest (depth
            "file"), or although the file of this table has other bytes.
    """
    try:
        table = loads(data)
    except TableError:
        return "refused"
    if data in seeds():
        return "unchanged"
    assert depth != "file", "a damaged file was accepted"
    assert dumps(table) == data, "accepted, but not the file of the table it was read as"
    return "another table"


def mutant(seed: int, number: int) -> tuple[str, bytes]:
    """Makes the mutant that a seed and a number determine; returns the depth of its damage, and its bytes."""
    random = Random(f"{seed} {number}")
    data = random.choice(seeds())
    depth = random.choices(("file", "payload", "values"), (2, 3, 5))[0]
    if depth == "file":
        return depth, _damaged(data, random)
    magic, version, _, payload = msgpack.unpackb(data)
    payload = (_damaged if depth == "payload" else _with_other_values)(payload, random)
    return depth, bytes(msgpack.packb([magic, version, hashlib.sha256(payload).digest(), payload]))


def _damaged(data: bytes, random: Random) -> bytes:
    out = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        at, length = random.randrange(len(out) + 1), random.choice((1, 1, 2, 8, 64))
        action = random.randrange(7)
        if action == 0 and at < len(out):
            out[at] ^= 1 << random.randrange(8)
        elif action == 1 and at < len(out):
            out[at] = random.choice((0, 1, 0x7F, 0x80, 0xC6, 0xDD, 0xFF, random.randrange(256)))
        elif action == 2:
            del out[at : at + length]
        elif action == 3:
            out[at:at] = random.randbytes(length)
        elif action == 4:
            out[at:at] = out[at : at + length]
        elif action == 5:
            other = random.choice(seeds())
            out[at:] = other[random.randrange(len(other)) :]
        else:
            del out[at:]
    return bytes(out)


def _with_other_values(payload: bytes, random: Random) -> bytes:
    sections = msgpack.unpackb(payload)
    for _ in range(random.choice((1, 1, 2, 3))):
        if random.random() < 0.05:
            moved = sections.pop(random.randrange(len(sections)))
            sections.insert(random.randrange(len(sections) + 1), moved)
        section = random.choice(sections)
        at = random.randrange(len(section))
        section[at] = _other(section[at], random)
    return bytes(msgpack.packb(sections))


def _other(value: Any, random: Random) -> Any:
    if random.random() < 0.03:
        return random.choice(STRANGE)
    if isinstance(value, list):
        return _other_column(value, random)
    if isinstance(value, int):
        return random.choice((value + random.choice((-1, 1, 7, -100)), random.choice(VALUES)))
    return value


def _other_column(column: list[Any], random: Random) -> list[Any]:
    column = list(column)
    for _ in range(random.choice((1, 1, 2))):
        at, action = random.randrange(len(column) + 1), random.randrange(8)
        if at == len(column) or action == 0:
            column.insert(at, random.choice(VALUES[:6]))
        elif action == 1:
            del column[at]
        else:
            column[at] = _other(column[at], random)
    return column


@contextmanager
def _limit(seconds: float) -> Iterator[None]:
    """Raises TimeoutError if the body of the `with` takes more than `seconds` of processor time.

    Unlike elapsed time, processor time does not depend on other work of the machine.
    """

    def expired(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"not refused within {seconds} s")

    before = signal.signal(signal.SIGPROF, expired)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
