"""What to change where a plan falls short: the measures of this package, put together."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from planner.diagnosis import close_widths, noise
from planner.diagnosis.ambiguity import Ambiguity, Delay, ambiguities, delays
from planner.diagnosis.close_widths import ClosePair, close_pairs
from planner.diagnosis.margins import Margins, margins_of
from planner.diagnosis.noise import Gain, gains_without_noise
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.search.expand import TreeNode
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.table import Table

LONG = 3.6  # squeezes a part from which a plan is long
MOST_LATE = 3
MOST_TRIALS = 5000  # parts squeezed for each source of noise


class Advice(NamedTuple):
    """What limits a plan."""

    failing: float  # share of the parts that are not located
    rejected: float  # share whose width no branch has
    unresolved: float  # share that ends in leaves from which no squeeze gained anything
    at_depth_limit: float  # share that ends in unresolved leaves as deep as `search.max_depth` allows
    pairs: list[ClosePair]  # branches that the encoder may confuse, those that cost most first
    open_poses: list[Ambiguity]  # the unresolved leaves that hold most parts, and what would resolve them
    gains: Sequence[Gain]  # what each source of noise costs; empty if not asked for
    proposing: bool  # whether placements were proposed besides the stated ones
    delays: Sequence[Delay]  # of a long plan, the nodes that many parts still come to late
    margins: Margins | None = None  # what widths a little off do; None if not asked for

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "failing": self.failing,
            "rejected": self.rejected,
            "unresolved": self.unresolved,
            "at_depth_limit": self.at_depth_limit,
            "pairs": [pair._asdict() for pair in self.pairs],
            "open_poses": [leaf.figures() for leaf in self.open_poses],
            "gains": [gain.figures() for gain in self.gains],
            "delays": [delay.figures() for delay in self.delays],
            "margins": self.margins and self.margins.figures(),
        }

    def lines(self) -> list[str]:
        """For people: what costs something, and where to look."""
        return [
            *self._shares(),
            *(leaf.line() for leaf in self.open_poses),
            *(delay.line() for delay in self.delays),
            *close_widths.lines_of(self.pairs),
            *([self.margins.line()] if self.margins and self.margins.thin else []),
        ]

    def _shares(self) -> list[str]:
        if self.failing == 0.0:
            return ["every part was located"]
        lines = [f"{self.failing:.2%} of the parts are not located"]
        if self.unresolved > 0.0:
            lines.append(
                f"{self.unresolved:.2%} end unresolved, where no squeeze that was tried gained anything: "
                "add angles or centres" + ("" if self.proposing else ", or plan with proposals")
            )
        if self.at_depth_limit > 0.0:
            lines.append(f"{self.at_depth_limit:.2%} end unresolved at max_depth of [search]: raise it")
        return lines + noise.lines_of(self.gains)


def advise(
    table: Table, evaluation: Evaluation, job: Job, gains: Sequence[Gain] = (), late: Sequence[Delay] = (),
    margins: Margins | None = None,
) -> Advice:  # fmt: skip
    """Reads off what limits the plan of a job, given what the other modules found by further trials."""
    deep = evaluation.unresolved & (evaluation.squeezes >= job.search.max_depth)
    return Advice(
        failing=1.0 - float(evaluation.success.mean()),
        rejected=float(evaluation.rejected.mean()),
        unresolved=float(evaluation.unresolved.mean()),
        at_depth_limit=float(deep.mean()),
        pairs=close_pairs(table, evaluation, job),
        open_poses=[] if job.hypothesis else ambiguities(table, evaluation, job),
        gains=gains,
        proposing=job.actions.proposals != "none",
        delays=late,
        margins=margins,
    )


def counsel(
    table: Table, evaluation: Evaluation, root: TreeNode, job: Job, scheduler: Scheduler | None = None,
    report: Report = silent,
) -> Advice:  # fmt: skip
    """Everything there is to say about what `planner.compile.compile_job` returned for a job."""
    trials = min(len(evaluation.leaf), MOST_TRIALS)
    gains = gains_without_noise(table, job, trials, scheduler, report)
    late = delays(root, job, MOST_LATE) if evaluation.squeezes.mean() >= LONG and not job.hypothesis else []
    margins = margins_of(table, evaluation, job, trials, scheduler, report)
    return advise(table, evaluation, job, gains, late, margins)
