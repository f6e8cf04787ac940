"""What branches rest on: widths that the encoder may confuse, and how far they may be off."""

from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from planner.belief.observation import encoder_of
from planner.evaluation.cases import OFFSET_COUNTS, offset_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import REJECT, Calibration, Table, by_count, decision_map

THIN = (
    0.02  # share of the parts answered wrongly, where widths are off, from which margins are thin
)
SEED_MARGINS = 0x4D415247


class Margins(NamedTuple):
    """What widths a little off make of a table."""

    counts: float  # how far they are off, to either side
    wrong_rate: float  # share of the parts answered wrongly then, on the worse side
    near: float  # share of the parts that read so near to another branch, at some node

    @property
    def thin(self) -> bool:
        """Whether that is worth a word."""
        return self.wrong_rate > THIN

    def line(self) -> str:
        """For people."""
        counts = f"{self.counts:g} counts"
        return (
            f"thin margins: widths {counts} off make {self.wrong_rate:.1%} of the answers wrong, since "
            f"{self.near:.0%} of the parts read within {counts} of another branch: "
            "encoder_mm of [doubt] plans for that"
        )


def margins_of(
    table: Table,
    evaluation: Evaluation,
    job: Job,
    trials: int,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> Margins:
    """Runs a table with widths off to either side, `trials` parts each."""
    seed = job.seed + SEED_MARGINS
    worlds = partial(ContactWorlds.of_job, seed=seed)
    lines = sweep(table, job, offset_cases(job), worlds, trials, seed, scheduler, report)
    wrong = max(float(line.evaluation.wrong.mean()) for line in lines)
    return Margins(OFFSET_COUNTS, wrong, near_another(table, evaluation))


def near_another(table: Table, evaluation: Evaluation) -> float:
    """Share of the parts of which some reading, if it were `OFFSET_COUNTS` off, would mean another branch."""
    calibration, reach = Calibration.linear(table.gripper), int(OFFSET_COUNTS)
    meant = np.array([by_count(decision_map(node, calibration)) for node in table.nodes])
    around = np.pad(meant, ((0, 0), (reach, reach)), constant_values=REJECT)
    around = sliding_window_view(around, 2 * reach + 1, axis=1)
    other = ((around != meant[..., None]) & (around != REJECT)).any(axis=2)
    return float(
        ((evaluation.path >= 0) & other[evaluation.path, evaluation.counts]).any(axis=1).mean()
    )


CLOSE_COUNTS = 4.0  # nearer widths share readings: settled grippers of the kind differ by as much
BORDER_COUNTS = (
    2.0  # a reading this near to the border between two branches may have been the other one
)
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
            reads = np.abs(evaluation.counts - _border(outcome, number)) <= BORDER_COUNTS
            near = ((evaluation.path == index) & reads).any(
                axis=1
            )  # no trial comes to a node twice
            widths_mm = below.expected_um / 1e3, above.expected_um / 1e3
            share, lost = float(near.mean()), float((near & failed).mean())
            excess = float(lost - share * failed.mean())
            pairs.append(
                ClosePair(index, number, widths_mm, round(counts, 2), overlap, share, lost, excess)
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
