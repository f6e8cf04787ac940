"""Simulates the acceptance study of a cell: draws audited parts, and evaluates the study after each part."""

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
    """The study's verdict on a cell, compared with the true share of failures: right, wrong or none yet."""

    RIGHT = "right"
    WRONG = "wrong"
    OPEN = "open"


def tried(rng: np.random.Generator, rate: float, limit: float, most: int, unseen=0.0) -> Tried:
    """Draws at most `most` parts of a cell, and compares the study's first verdict with the true rate.

    Args:
        rng: source of randomness.
        rate: true share of failures; if it equals the limit, either verdict is wrong.
        limit: largest share of failures that the study accepts.
        most: greatest number of parts.
        unseen: probability that the audit of a part at a leaf has the verdict "unknown".
    """
    fails, kinds = rng.random(most) < rate, rng.integers(len(FAILED), size=most)
    hidden, stopped = rng.random(most) < unseen, rng.random(most) < 0.01
    parts = []
    for failed, kind, dark, out in zip(fails, kinds, hidden, stopped, strict=True):
        part = FAILED[kind] if failed else GOOD
        parts.append(STOPPED if out else UNSEEN if dark and part.outcome == "leaf" else part)
    return judged(parts, rate, limit)


def judged(parts: Iterable[Part], rate: float, limit: float) -> Tried:
    """Evaluates the study after each part, and compares its first verdict with the true rate of failures."""
    for now in followed(parts, limit):
        if now.verdict is Verdict.ACCEPTED:
            return Tried.RIGHT if rate < limit else Tried.WRONG
        if now.verdict is Verdict.REFUSED:
            return Tried.RIGHT if rate > limit else Tried.WRONG
    return Tried.OPEN
