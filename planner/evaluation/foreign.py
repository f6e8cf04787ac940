"""Foreign parts, which the job does not expect: how often a decision table takes them for the job's parts."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.errors import FitError
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.part.outline import Outline, width
from runtime.table import Table

OFTEN = 0.05  # share of answered foreign parts above which the answers are explained
MOST = 3  # most answers that are explained
DIRECTIONS = 360  # angles at which widths are compared, over half a turn
SCALES, DISC_SIDES = (0.9, 1.1), 60  # relative sizes of generated foreign parts, vertices of a disc


class Answer(NamedTuple):
    """A resolved leaf in which trials of a foreign part ended, and the widths read on the way there."""

    leaf: int  # index of the leaf
    part: str | None  # name of the part that the leaf states; None if the job has one part only
    share: float  # share of the foreign parts that end at the leaf
    widths_mm: tuple[float, ...]  # median width of the foreign parts at each squeeze
    ours_mm: tuple[float, ...]  # median width of the job's parts that end there; or empty
    differ_mm: float  # `widths_differ_mm` of the foreign part and the job's part

    @property
    def apart_mm(self) -> float | None:
        """Largest difference of `widths_mm` and `ours_mm` at any squeeze [mm]; None if `ours_mm` is empty."""
        pairs = zip(self.widths_mm, self.ours_mm, strict=True) if self.ours_mm else ()
        return max((round(abs(theirs - ours), 2) for theirs, ours in pairs), default=None)

    def line(self) -> str:
        """States the leaf, its share, and the widths of the foreign part and the job's part, in one line."""
        named = "" if self.part is None else f" as {self.part}"
        message = f"           {self.share:7.2%}  at leaf {self.leaf}{named}, by {_listed(self.widths_mm)} mm"
        if self.apart_mm is not None:
            message += f": within {self.apart_mm:.1f} mm of ours at every squeeze ({_listed(self.ours_mm)})"
        return f"{message}; some width differs by {self.differ_mm:.1f} mm"


class Tried(NamedTuple):
    """The trials of one foreign part, and the leaves that took it for a part of the job."""

    name: str
    evaluation: Evaluation
    answers: tuple[Answer, ...]  # the leaves that answer most of its trials, at most `MOST`

    @property
    def answered(self) -> float:
        """Share of the foreign part's trials that ended in a resolved leaf."""
        return float(self.evaluation.resolved.mean())

    @property
    def often(self) -> bool:
        """Whether more than a share `OFTEN` of the foreign part's trials ended in a resolved leaf."""
        return self.answered > OFTEN

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        return {
            "name": self.name,
            "trials": len(self.evaluation.leaf),
            "answered_rate": self.answered,
            "too_often": self.often,
            "reject_rate": float(self.evaluation.rejected.mean()),
            "unresolved_rate": float(self.evaluation.unresolved.mean()),
            "crashes": self.evaluation.crashes,
            "answers": [{**each._asdict(), "apart_mm": each.apart_mm} for each in self.answers],
        }

    def lines(self) -> list[str]:
        """The share of trials that a resolved leaf answered and, above `OFTEN`, a line for each answer."""
        message = (
            f"foreign    {self.answered:7.2%}  of {self.name} answered as a part that belongs there"
        )
        if not self.often:
            return [message]
        return [f"{message}, more than {OFTEN:.0%}:", *(answer.line() for answer in self.answers)]


def family(job: Job) -> tuple[Job, ...]:
    """Generates foreign parts that resemble the parts of a job; returns each as the job of a single part.

    For each part of the job these are the part a tenth smaller and a tenth larger, a disc of its mean width,
    and a rectangle of its least and greatest width. All press evenly on the table. Parts that do not fit
    between the open fingers are left out.
    """
    turns = 2.0 * np.pi / DISC_SIDES * np.arange(DISC_SIDES)
    disc = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    plain, results = {"pressure": {"kind": "uniform"}, "goal": {"kind": "pose"}}, []
    for alone in job.alone:
        outline, wide = alone.part.outline_mm, _all_widths(alone.part.outline_mm)
        shapes = {f"x {scale}": scale * outline for scale in SCALES}
        shapes["its disc"] = 0.5 * wide.mean() * disc
        shapes["its rectangle"] = 0.5 * np.array([wide.max(), wide.min()]) * square
        for variant, shape in shapes.items():
            name = f"{alone.part.name} {variant}"
            part = {"name": name, "outline_mm": shape.tolist(), "symmetry": 1}
            with suppress(FitError):
                results.append(alone.replaced(part=part, **plain))
    return tuple(results)


def tried(
    table: Table,
    job: Job,
    ours: Evaluation,
    parts: Sequence[Job],
    evaluated: Callable[[Job], Evaluation],
) -> Iterator[Tried]:
    """Runs a table on foreign parts, and yields for each its trials and the leaves that answered them.

    Args:
        table: the table.
        job: the job of the table.
        ours: trials of the job's parts.
        parts: the foreign parts, each as the job of a single part.
        evaluated: runs the table on a foreign part, and returns the evaluation.
    """
    for foreign in parts:
        result, outline = evaluated(foreign), foreign.part.outline_mm
        differ = [round(widths_differ_mm(outline, each.part.outline_mm), 2) for each in job.alone]
        yield Tried(foreign.part.name, result, tuple(_answers(table, job, ours, result, differ)))


def widths_differ_mm(one: Outline, other: Outline) -> float:
    """Largest difference between the widths of two outlines in any direction [mm].

    One outline is first turned such that this difference is least.
    """
    first, second = _all_widths(one), _all_widths(other)
    turned = np.array([np.roll(first, turn) for turn in range(DIRECTIONS)])
    return float(np.abs(turned - second).max(axis=1).min())


def _all_widths(outline: Outline) -> Array:
    return np.array([width(outline, angle) for angle in np.pi / DIRECTIONS * np.arange(DIRECTIONS)])


def _answers(
    table: Table, job: Job, known: Evaluation, foreign: Evaluation, differ: list[float]
) -> Iterator[Answer]:
    reached = Counter(foreign.leaf[foreign.resolved].tolist())
    for index, number in reached.most_common(MOST):
        leaf, share = table.leaves[index], number / len(foreign.leaf)
        theirs, ours = (_widths(trials, index, job) for trials in (foreign, known))
        yield Answer(index, table.name_of(leaf), share, theirs, ours, differ[leaf.hypothesis])


def _widths(evaluation: Evaluation, leaf: int, job: Job) -> tuple[float, ...]:
    """The median width at each squeeze on the way to a leaf [mm]; empty if no part ended at the leaf."""
    here = evaluation.leaf == leaf
    if not here.any():
        return ()
    squeezes = int(evaluation.squeezes[here][0])  # a tree: only one way leads to a leaf
    medians = encoder_of(job).width_mm(np.median(evaluation.steps[here, :squeezes], axis=0))
    return tuple(round(float(width), 2) for width in medians)


def _listed(widths_mm: tuple[float, ...]) -> str:
    return ", ".join(f"{width:.1f}" for width in widths_mm)
