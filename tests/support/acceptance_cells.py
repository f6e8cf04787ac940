"""Simulates cells under the acceptance study: draws audits of parts, and evaluates the study after each."""

from collections.abc import Iterable
from enum import Enum

import numpy as np

from runtime.spc.history import Part
from runtime.spc.study.acceptance import Verdict, followed

FAILED = (Part(1, outcome="leaf", verdict="fail"),)
FAILED += tuple(Part(1, outcome=how) for how in ("reject", "unresolved", "fault"))
GOOD = Part(1, outcome="leaf", verdict="pass")
UNSEEN, STOPPED = Part(1, outcome="leaf", verdict="unknown"), Part(1, outcome="stopped")


class Tried(Enum):
    """Whether the verdict on a cell was right, given the cell's true rate of failures, or is still open."""

    RIGHT = "right"
    WRONG = "wrong"
    OPEN = "open"


def tried(rng: np.random.Generator, rate: float, limit: float, most: int, unseen=0.0) -> Tried:
    """Runs a cell until the first verdict on it, or until `most` parts are done.

    Args:
        rng: source of randomness.
        rate: true share of failures; if it equals the limit, either verdict is wrong.
        limit: limit of the study on the share of failures.
        most: most parts.
        unseen: share of parts at a leaf whose audit has no result, whether or not they failed.
    """
    fails, kinds = rng.random(most) < rate, rng.integers(len(FAILED), size=most)
    hidden, stopped = rng.random(most) < unseen, rng.random(most) < 0.01
    parts = []
    for failed, kind, dark, out in zip(fails, kinds, hidden, stopped, strict=True):
        part = FAILED[kind] if failed else GOOD
        parts.append(STOPPED if out else UNSEEN if dark and part.outcome == "leaf" else part)
    return judged(parts, rate, limit)


def judged(parts: Iterable[Part], rate: float, limit: float) -> Tried:
    """Compares the first verdict on parts with their true rate; the study is evaluated after each part."""
    for now in followed(parts, limit):
        if now.verdict is Verdict.ACCEPTED:
            return Tried.RIGHT if rate < limit else Tried.WRONG
        if now.verdict is Verdict.REFUSED:
            return Tried.RIGHT if rate > limit else Tried.WRONG
    return Tried.OPEN
