"""Shares of parts by outcome, in percent, rounded so that the printed numbers add up to 100."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

OUTCOMES = ("success_rate", "wrong_rate", "unresolved_rate", "reject_rate")
DECIMALS = 2


class Shares(NamedTuple):
    """Shares of the parts of an evaluation by outcome [percent]; the five add up to 100."""

    located: float
    wrong: float
    unresolved: float
    rejected: float
    crashed: float  # a finger came down on the part


def shares_of(figures: dict[str, Any]) -> Shares:
    """Computes the shares from the figures that `Evaluation.summary` returns."""
    crashed = figures["crashes"] / figures["trials"]
    return Shares(*rounded([*(figures[name] for name in OUTCOMES), crashed]))


def rounded(shares: Sequence[float]) -> list[float]:
    """Converts shares from 0 to 1 to percent, rounded by the largest remainder so that their sum is kept.

    A share above 0 is not rounded to 0. So 100 is printed only where all parts have one outcome.
    """
    unit = 10**DECIMALS
    exact = [100.0 * unit * share for share in shares]
    whole = [max(math.floor(value + 1e-6), int(value > 1e-6)) for value in exact]
    remainder = sorted(range(len(exact)), key=lambda k: whole[k] - exact[k])
    missing = round(math.fsum(exact)) - sum(whole)
    for k in remainder[: max(missing, 0)]:
        whole[k] += 1
    whole[whole.index(max(whole))] += min(missing, 0)
    return [value / unit for value in whole]


def in_percent(percent: float) -> str:
    """Formats a rounded share in percent."""
    return f"{percent:g} %"
