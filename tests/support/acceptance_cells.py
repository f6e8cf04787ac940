"""Simulated cells under the acceptance study: parts whose audits are drawn, looked at after each of them."""

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
    """What the verdict on a cell was, held against its true rate."""

    RIGHT = "right"
    WRONG = "wrong"
    OPEN = "open"


def tried(rng: np.random.Generator, rate: float, limit: float, most: int, unseen=0.0) -> Tried:
    """Run a cell until its first verdict, or for so many parts.

    Args:
        rng: of everything.
        rate: true share of failures; at the limit itself either verdict is wrong.
        limit: of the study.
        most: number of parts.
        unseen: share of parts whose audit tells nothing, whether or not they failed.
    """
    fails, kinds = rng.random(most) < rate, rng.integers(len(FAILED), size=most)
    hidden, stopped = rng.random(most) < unseen, rng.random(most) < 0.01
    parts = []
    for failed, kind, dark, out in zip(fails, kinds, hidden, stopped, strict=True):
        part = FAILED[kind] if failed else GOOD
        parts.append(STOPPED if out else UNSEEN if dark and part.outcome == "leaf" else part)
    return judged(parts, rate, limit)


def judged(parts: Iterable[Part], rate: float, limit: float) -> Tried:
    """The first verdict on parts, looked at after each; at a true rate of the limit either is wrong."""
    for now in followed(parts, limit):
        if now.verdict is Verdict.ACCEPTED:
            return Tried.RIGHT if rate < limit else Tried.WRONG
        if now.verdict is Verdict.REFUSED:
            return Tried.RIGHT if rate > limit else Tried.WRONG
    return Tried.OPEN
