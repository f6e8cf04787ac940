"""Shares of all parts in percent, rounded so that printed numbers add up."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

OUTCOMES = ("success_rate", "wrong_rate", "unresolved_rate", "reject_rate")
DECIMALS = 2


class Shares(NamedTuple):
    """Outcomes of all parts of an evaluation [percent]; the five add up to 100."""

    located: float
    wrong: float
    unresolved: float
    rejected: float
    crashed: float  # a finger came down on the part


def shares_of(figures: dict[str, Any]) -> Shares:
    """The shares of figures as `Evaluation.summary` returns them."""
    crashed = figures["crashes"] / figures["trials"]
    return Shares(*rounded([*(figures[name] for name in OUTCOMES), crashed]))


def rounded(shares: Sequence[float]) -> list[float]:
    """Converts shares, 0 to 1, to rounded percent by the largest remainder, so that their sum is kept.

    A share above 0 is not rounded to 0; therefore 100 stands only for all parts.
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
