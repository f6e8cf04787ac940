"""Margins of branches: widths that the encoder may confuse, and the offset that they tolerate."""

from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planner.arrays import IntArray
from planner.belief.observation import encoder_of
from planner.evaluation.cases import OFFSET, offset_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.lookup import Lookup
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import encoder_of_table
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import REJECT, Segments, Table, decision_map

THIN = 0.02  # least share of wrong answers under an offset that makes margins thin
SEED_MARGINS = 0x4D415247


class Margins(NamedTuple):
    """Effect of a small offset of widths on a table."""

    off_mm: float  # offset to either side
    wrong_rate: float  # share of parts answered wrongly with it, on the worse side
    near: float  # share of parts with a reading so near another branch, at some node

    @property
    def thin(self) -> bool:
        """Whether the margins deserve a warning."""
        return self.wrong_rate > THIN

    def line(self) -> str:
        """For people."""
        off = f"{self.off_mm:.2g} mm"
        return (
            f"thin margins: widths {off} off make {self.wrong_rate:.1%} of the answers wrong, since "
            f"{self.near:.0%} of the parts read within {off} of another branch: "
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
    """Runs a table with widths offset to either side, `trials` parts each."""
    seed = job.seed + SEED_MARGINS
    worlds = partial(ContactWorlds.of_job, seed=seed)
    lines = sweep(table, job, offset_cases(job), worlds, trials, seed, scheduler, report)
    wrong = max(float(line.evaluation.wrong.mean()) for line in lines)
    off_mm = OFFSET * encoder_of(job).grain_mm
    return Margins(off_mm, wrong, near_another(table, evaluation))


def near_another(table: Table, evaluation: Evaluation) -> float:
    """Share of the parts with a reading that an offset of `OFFSET` grains would take into another branch."""
    encoder = encoder_of_table(table)
    lookup = Lookup.of([decision_map(node, table.gripper).either for node in table.nodes])
    squeezed = evaluation.path >= 0
    node, steps = evaluation.path[squeezed], evaluation.steps[squeezed]

    def meant(off: int) -> IntArray:
        read = np.clip(steps + off, 0, encoder.steps)
        branch = lookup.branch[lookup.segment(node, encoder.width_um(read))]
        return np.where(read == steps + off, branch, REJECT)

    here, near = meant(0), np.zeros(squeezed.shape, np.bool_)
    for off in range(1, int(OFFSET * encoder.grain_mm / encoder.mm_per_step) + 1):
        for there in (meant(-off), meant(off)):
            near[squeezed] |= (there != here) & (there != REJECT)
    return float(near.any(axis=1).mean())


CLOSE = 4.0  # grains; nearer branches have readings in common
BORDER = 2.0  # distance, in grains, of readings near the border of two branches
MOST_LINES = 5


class ClosePair(NamedTuple):
    """Two neighbouring branches of a node."""

    node: int  # index of the node
    lower: int  # number of the branch of smaller width; the other is the next
    widths_mm: tuple[float, float]  # the two expected widths
    grains: float  # distance in units of the scatter of one width's readings
    overlap: bool  # whether their intervals overlap
    near: float  # share of all parts that read within `BORDER` of the border between the two
    lost: float  # share of all parts that do so and are not located in the end
    excess: float  # excess of that over the losses of parts elsewhere


def close_pairs(table: Table, evaluation: Evaluation, job: Job) -> list[ClosePair]:
    """Neighbouring branches whose widths are close or whose intervals overlap, the costliest first."""
    grain_um, encoder = 1e3 * encoder_of(job).grain_mm, encoder_of_table(table)
    failed, width_um = ~evaluation.success, encoder.width_um(evaluation.steps)
    pairs = []
    for index, node in enumerate(table.nodes):
        meant = decision_map(node, table.gripper).either
        for number, (below, above) in enumerate(pairwise(node.branches)):
            grains = (above.expected_um - below.expected_um) / grain_um
            overlap = below.high_um >= above.low_um
            if grains >= CLOSE and not overlap:
                continue
            reads = np.abs(width_um - _border_um(meant, number)) <= BORDER * grain_um
            near = ((evaluation.path == index) & reads).any(axis=1)  # no trial visits a node twice
            widths_mm = below.expected_um / 1e3, above.expected_um / 1e3
            share, lost = float(near.mean()), float((near & failed).mean())
            excess = float(lost - share * failed.mean())
            pairs.append(
                ClosePair(index, number, widths_mm, round(grains, 2), overlap, share, lost, excess)
            )
    return sorted(pairs, key=lambda pair: -pair.excess)


def lines_of(pairs: list[ClosePair]) -> list[str]:
    """For people: the pairs near whose border more parts are lost than elsewhere."""
    costly = [pair for pair in pairs if pair.excess > 0.0]
    lines = [
        f"node {pair.node}: {pair.widths_mm[0]:.1f} and {pair.widths_mm[1]:.1f} mm are {pair.grains:.1f} "
        f"readings apart; {pair.near:.2%} of the parts read near the border, {pair.lost:.2%} are lost there"
        for pair in costly[:MOST_LINES]
    ]
    rest = len(costly) - MOST_LINES
    return lines + [f"and {rest} more such pairs; see --json"] * (rest > 0)


def _border_um(meant: Segments, lower: int) -> float:
    """The border between branch `lower` and the next wider one."""
    narrow = max((high for _, high, number in meant.intervals() if number == lower), default=0)
    wide = (low for low, _, number in meant.intervals() if number == lower + 1)
    return 0.5 * (min(wide, default=narrow) + narrow)
