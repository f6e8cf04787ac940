"""Neighbouring branches of a node whose widths the encoder may take for one another."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planner.arrays import BoolArray
from planner.belief.observation import encoder_of
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from runtime.table import Calibration, Table, by_count, decision_map

CLOSE_COUNTS = 4.0  # nearer widths share readings: settled grippers of the kind differ by as much
BORDER_COUNTS = 2.0  # a reading this near to the border between two branches may have been the other one
MOST_LINES = 5


class ClosePair(NamedTuple):
    """Two neighbouring branches of a node."""

    node: int  # index of the node
    lower: int  # number of the branch of lesser width; the other one is the next
    widths_mm: tuple[float, float]  # the two expected widths
    counts: float  # how far they are apart
    overlap: bool  # whether their intervals have widths in common
    near: float  # share of all parts that read within `BORDER_COUNTS` of the border between the two
    lost: float  # share of all parts that do so and are not located in the end
    excess: float  # how much of that is more than parts elsewhere lose


def close_pairs(table: Table, evaluation: Evaluation, job: Job) -> list[ClosePair]:
    """Neighbouring branches whose widths are close or whose intervals overlap, the costliest first."""
    um_per_count = 1e3 * encoder_of(job).mm_per_count
    calibration = Calibration.linear(table.gripper)
    failed = ~evaluation.success
    pairs = []
    for index, node in enumerate(table.nodes):
        outcome = by_count(decision_map(node, calibration))
        for number, (below, above) in enumerate(pairwise(node.branches)):
            counts = (above.expected_um - below.expected_um) / um_per_count
            overlap = below.high_um >= above.low_um
            if counts >= CLOSE_COUNTS and not overlap:
                continue
            near = _reads_near(evaluation, index, _border(outcome, number))
            pairs.append(
                ClosePair(
                    node=index,
                    lower=number,
                    widths_mm=(below.expected_um / 1e3, above.expected_um / 1e3),
                    counts=round(counts, 2),
                    overlap=overlap,
                    near=float(near.mean()),
                    lost=float((near & failed).mean()),
                    excess=float((near & failed).mean() - near.mean() * failed.mean()),
                )
            )
    return sorted(pairs, key=lambda pair: -pair.excess)


def lines_of(pairs: list[ClosePair]) -> list[str]:
    """For people: the pairs near whose border more parts are lost than elsewhere."""
    costly = [pair for pair in pairs if pair.excess > 0.0]
    lines = [
        f"node {pair.node}: {pair.widths_mm[0]:.1f} and {pair.widths_mm[1]:.1f} mm are {pair.counts:.1f} "
        f"counts apart; {pair.near:.2%} of the parts read near the border, {pair.lost:.2%} are lost there"
        for pair in costly[:MOST_LINES]
    ]
    rest = len(costly) - MOST_LINES
    return lines + [f"and {rest} more such pairs; see --json"] * (rest > 0)


def _border(outcome: tuple[int, ...], lower: int) -> float:
    """The count between the readings of branch `lower` + 1, the wider one, and those of `lower`."""
    wide = max((count for count, number in enumerate(outcome) if number == lower + 1), default=0)
    narrow = min((count for count, number in enumerate(outcome) if number == lower), default=wide)
    return 0.5 * (wide + narrow)


def _reads_near(evaluation: Evaluation, node: int, border: float) -> BoolArray:
    """Trials that read near a count at a node; no trial comes to a node twice."""
    near = np.abs(evaluation.counts - border) <= BORDER_COUNTS
    return np.asarray(((evaluation.path == node) & near).any(axis=1))
