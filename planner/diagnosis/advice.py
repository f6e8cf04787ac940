"""What to change where a plan falls short: what its table and its evaluation say about each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import BoolArray
from planner.belief.observation import encoder_of
from planner.diagnosis.ambiguity import Ambiguity, ambiguities
from planner.diagnosis.delay import Delay, delays
from planner.evaluation.outcome import Evaluation
from planner.evaluation.sensitivity import EVERYTHING, Gain, sensitivity
from planner.job.model import Job
from planner.search.expand import TreeNode
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.table import Calibration, Table, by_count, decision_map

CLOSE_COUNTS = 4.0
"""Expected widths nearer than this share readings: settled grippers of the kind differ by as much."""
BORDER_COUNTS = 2.0
"""A reading this near to the border between two branches may have been the other one."""
LONG = 3.6
"""Squeezes a part from which a plan is long."""
MOST_LATE = 3
MOST_LINES = 5
MOST_TRIALS = 5000
"""Parts squeezed for each source of noise."""


class ClosePair(NamedTuple):
    """Two neighbouring branches of a node that the encoder may take for one another.

    Attributes:
        node: index of the node.
        lower: number of the branch of lesser width; the other one is the next.
        widths_mm: the two expected widths.
        counts: how far they are apart.
        overlap: whether their intervals have widths in common.
        near: share of all parts that read within `BORDER_COUNTS` of the border between the two.
        lost: share of all parts that do so and are not located in the end.
        excess: how much of that is more than parts elsewhere lose.
    """

    node: int
    lower: int
    widths_mm: tuple[float, float]
    counts: float
    overlap: bool
    near: float
    lost: float
    excess: float


@dataclass(frozen=True, slots=True)
class Advice:
    """What limits a plan.

    Attributes:
        failing: share of the parts that are not located.
        unresolved: share that ends in leaves from which no squeeze gained anything.
        at_depth_limit: share that ends in unresolved leaves as deep as `search.max_depth` allows.
        pairs: branches that the encoder may confuse, those that cost most first.
        open_poses: the unresolved leaves that hold most parts, and what would resolve them.
        gains: what each source of noise costs; empty if not asked for.
        proposing: whether placements were proposed besides the stated ones.
        delays: of a long plan, the nodes that many parts still come to late; empty without the tree.
    """

    failing: float
    unresolved: float
    at_depth_limit: float
    pairs: tuple[ClosePair, ...]
    open_poses: tuple[Ambiguity, ...]
    gains: tuple[Gain, ...]
    proposing: bool
    delays: tuple[Delay, ...] = ()

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "failing": self.failing,
            "unresolved": self.unresolved,
            "at_depth_limit": self.at_depth_limit,
            "pairs": [pair._asdict() for pair in self.pairs],
            "open_poses": [leaf.figures() for leaf in self.open_poses],
            "gains": [gain.figures() for gain in self.gains],
            "delays": [delay.figures() for delay in self.delays],
        }

    def lines(self) -> list[str]:
        """For people: what costs something, and where to look."""
        return [
            *_limits(self),
            *(leaf.line() for leaf in self.open_poses),
            *(delay.line() for delay in self.delays),
            *_confusions(self.pairs),
        ]


def advise(table: Table, evaluation: Evaluation, job: Job, gains: list[Gain] | None = None) -> Advice:
    """Reads off what limits a plan.

    Args:
        table: the table, with the leaves' `resolved` as the runtime will see it.
        evaluation: of this table.
        job: the job it was compiled from.
        gains: what `planner.evaluation.sensitivity.sensitivity` measured.
    """
    deep = evaluation.unresolved & (evaluation.squeezes >= job.search.max_depth)
    return Advice(
        failing=1.0 - float(evaluation.success.mean()),
        unresolved=float(evaluation.unresolved.mean()),
        at_depth_limit=float(deep.mean()),
        pairs=tuple(sorted(_close_pairs(table, evaluation, job), key=lambda pair: -pair.excess)),
        open_poses=tuple(ambiguities(table, evaluation, job)),
        gains=tuple(gains or ()),
        proposing=job.actions.proposals != "none",
    )


def counsel(
    table: Table, evaluation: Evaluation, root: TreeNode, job: Job, scheduler: Scheduler | None = None,
    report: Report = silent,
) -> Advice:  # fmt: skip
    """Everything there is to say about a fresh plan.

    Args:
        table: what `planner.compile.compile_job` returned.
        evaluation: the same.
        root: the same.
        job: the job it was compiled from.
        scheduler: who runs the trials without noise; all cores if None.
        report: told about progress.
    """
    trials = min(len(evaluation.leaf), MOST_TRIALS)
    gains = sensitivity(table, job, trials, scheduler, report)
    advice = advise(table, evaluation, job, gains)
    if evaluation.squeezes.mean() < LONG:
        return advice
    return replace(advice, delays=tuple(delays(root, job, MOST_LATE)))


def _close_pairs(table: Table, evaluation: Evaluation, job: Job) -> list[ClosePair]:
    """Neighbouring branches whose expected widths are close, or whose intervals overlap."""
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
    return pairs


def _border(outcome: tuple[int, ...], lower: int) -> float:
    """The count between the readings of branch `lower` + 1, the wider one, and those of `lower`."""
    wide = max((count for count, number in enumerate(outcome) if number == lower + 1), default=0)
    narrow = min((count for count, number in enumerate(outcome) if number == lower), default=wide)
    return 0.5 * (wide + narrow)


def _reads_near(evaluation: Evaluation, node: int, border: float) -> BoolArray:
    """Trials that read near a count at a node; no trial comes to a node twice."""
    near = np.abs(evaluation.counts - border) <= BORDER_COUNTS
    return np.asarray(((evaluation.path == node) & near).any(axis=1))


def _limits(advice: Advice) -> list[str]:
    """What the missing share is due to."""
    if advice.failing == 0.0:
        return ["every part was located"]
    lines = [f"{advice.failing:.2%} of the parts are not located"]
    if advice.unresolved > 0.0:
        lines.append(
            f"{advice.unresolved:.2%} end unresolved, where no squeeze that was tried gained anything: "
            "add angles or centres" + ("" if advice.proposing else ", or plan with proposals")
        )
    if advice.at_depth_limit > 0.0:
        lines.append(f"{advice.at_depth_limit:.2%} end unresolved at max_depth of [search]: raise it")
    if not advice.gains:
        return lines
    single = [gain for gain in advice.gains if gain.source != EVERYTHING]
    for gain in (gain for gain in single if gain.certain):
        lines.append(
            f"{gain.source} limits it: {gain.gain:.2%} more, give or take {gain.error:.2%}, if it did not "
            "scatter"
        )
    if not any(gain.certain for gain in single):
        lines.append("no source of noise alone limits this plan: " + _measured(single))
    rest = advice.gains[-1]
    share = f"{1.0 - rest.success_rate:.2%} would not be located without any noise"
    lines.append(f"{share}: that is up to the action set")
    return lines


def _measured(gains: list[Gain]) -> str:
    return ", ".join(f"{gain.source} {gain.gain:+.2%}" for gain in gains)


def _confusions(pairs: tuple[ClosePair, ...]) -> list[str]:
    """Pairs of branches near whose border more parts are lost than elsewhere."""
    costly = [pair for pair in pairs if pair.excess > 0.0]
    lines = [
        f"node {pair.node}: {pair.widths_mm[0]:.1f} and {pair.widths_mm[1]:.1f} mm are {pair.counts:.1f} "
        f"counts apart; {pair.near:.2%} of the parts read near the border, {pair.lost:.2%} are lost there"
        for pair in costly[:MOST_LINES]
    ]
    if len(costly) > MOST_LINES:
        lines.append(f"and {len(costly) - MOST_LINES} more such pairs; see --json")
    return lines
