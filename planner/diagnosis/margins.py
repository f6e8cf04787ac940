"""How far widths may be off before a table's answers are wrong: what its branches rest on."""

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from planner.evaluation.cases import OFFSET_COUNTS, offset_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import REJECT, Calibration, Table, by_count, decision_map

THIN = 0.02  # share of the parts answered wrongly, where widths are off, from which margins are thin
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

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "thin": self.thin}

    def line(self) -> str:
        """For people."""
        counts = f"{self.counts:g} counts"
        return (
            f"thin margins: widths {counts} off make {self.wrong_rate:.1%} of the answers wrong, since "
            f"{self.near:.0%} of the parts read within {counts} of another branch: "
            "encoder_mm of [doubt] plans for that"
        )


def margins_of(
    table: Table, evaluation: Evaluation, job: Job, trials: int, scheduler: Scheduler | None = None,
    report: Report = silent,
) -> Margins:  # fmt: skip
    """Runs a table with widths off to either side, `trials` parts each."""
    seed = job.seed + SEED_MARGINS
    lines = sweep(
        table,
        job,
        offset_cases(job),
        lambda real: ContactWorlds.of_job(real, seed),
        trials,
        seed,
        scheduler,
        report,
    )
    wrong = max(float(line.evaluation.wrong.mean()) for line in lines)
    return Margins(OFFSET_COUNTS, wrong, near_another(table, evaluation))


def near_another(table: Table, evaluation: Evaluation) -> float:
    """Share of the parts of which some reading, if it were `OFFSET_COUNTS` off, would mean another branch."""
    calibration, reach = Calibration.linear(table.gripper), int(OFFSET_COUNTS)
    meant = np.array([by_count(decision_map(node, calibration)) for node in table.nodes])
    around = np.pad(meant, ((0, 0), (reach, reach)), constant_values=REJECT)
    around = sliding_window_view(around, 2 * reach + 1, axis=1)
    other = ((around != meant[..., None]) & (around != REJECT)).any(axis=2)
    return float(((evaluation.path >= 0) & other[evaluation.path, evaluation.counts]).any(axis=1).mean())
