"""Parts that do not belong on the table: how often one of them is taken for one that does."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from planner.belief.observation import encoder_of
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.scheduler import Scheduler
from planner.world import World, Worlds
from runtime.table import Table


class Strange(NamedTuple):
    """What became of one stranger."""

    name: str
    evaluation: Evaluation
    leaf: int | None  # that most of those answered came to
    widths_mm: tuple[float, ...]  # median widths on the way there: what could not be told apart

    @property
    def answered(self) -> float:
        """Share that ended in a resolved leaf."""
        return float(self.evaluation.resolved.mean())

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "trials": len(self.evaluation.leaf),
            "answered_rate": self.answered,
            "reject_rate": float(self.evaluation.rejected.mean()),
            "unresolved_rate": float(self.evaluation.unresolved.mean()),
            "crashes": self.evaluation.crashes,
            "leaf": self.leaf,
            "widths_mm": [round(width, 2) for width in self.widths_mm],
        }

    def line(self) -> str:
        """For people."""
        told = f"stranger   {self.answered:7.2%}  of {self.name} answered as a part that belongs there"
        if self.leaf is None:
            return told
        widths = ", ".join(f"{width:.1f}" for width in self.widths_mm)
        return f"{told}, most at leaf {self.leaf} by {widths} mm"


def strangers(
    table: Table, job: Job, worlds: Callable[[Job], World | Worlds], trials: int, seed: int,
    scheduler: Scheduler, disturbance: Disturbance,
) -> Iterator[Strange]:  # fmt: skip
    """Runs a table on each stranger of its job; the arguments are those of `evaluate`."""
    for stranger in job.strangers:
        found = evaluate(table, stranger, worlds(stranger), trials, seed, scheduler, disturbance)
        yield Strange(stranger.part.name, found, *_commonest(found, job))


def _commonest(found: Evaluation, job: Job) -> tuple[int | None, tuple[float, ...]]:
    """The leaf that most answered parts came to, and the median widths on the way."""
    if not found.resolved.any():
        return None, ()
    leaf = int(np.bincount(found.leaf[found.resolved]).argmax())
    here = found.leaf == leaf
    counts = found.counts[here][:, : int(found.squeezes[here][0])]  # a tree: one way leads to a leaf
    return leaf, tuple(map(float, encoder_of(job).width_mm(np.median(counts, axis=0))))
