"""Margins of a plan: the effect of a small offset of the measured widths on the answers of its table."""

from typing import NamedTuple

import numpy as np

from planner.arrays import IntArray
from planner.belief.observation import encoder_of
from planner.evaluation.cases import OFFSET, offset_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import Lookup, encoder_of_table
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.table import REJECT, Table, decision_map

THIN = 0.02  # share of wrong answers under an offset above which margins are thin
SEED_MARGINS = 0x4D415247


class Margins(NamedTuple):
    """Effect of a small constant error of the measured widths on the answers of a table."""

    off_mm: float  # size of the offset, which is tried with either sign
    wrong_rate: float  # share of parts answered wrongly with the worse of the two signs
    near: float  # share of parts with a reading within `off_mm` of another branch of its node

    @property
    def thin(self) -> bool:
        """Whether the offset makes enough answers wrong to deserve a warning."""
        return self.wrong_rate > THIN

    def line(self) -> str:
        """States the margins and the remedy as a warning, in one line for people."""
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
    """Runs a table on `trials` parts with all widths too large, and on as many with all widths too small.

    Returns the margins of the table. The widths are off by `OFFSET` times the encoder's grain.
    """
    seed = job.seed + SEED_MARGINS
    lines = sweep(table, job, offset_cases(job), trials, seed, scheduler, report)
    wrong = max(float(line.evaluation.wrong.mean()) for line in lines)
    off_mm = OFFSET * encoder_of(job).grain_mm
    return Margins(off_mm, wrong, near_another(table, evaluation))


def near_another(table: Table, evaluation: Evaluation) -> float:
    """Share of the parts that would take another branch at some squeeze if the width were slightly off.

    The offset is at most `OFFSET` times the encoder's grain, which is the scatter of the readings of one
    width.
    """
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
