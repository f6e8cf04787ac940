"""Verdicts in one sentence: on a plan, and on the cell that ran it."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from planner.diagnosis.cautions import warnings_of
from planner.evaluation.cases import Condition
from planner.evaluation.evaluate import Line
from planner.evaluation.shares import in_percent, shares_of
from planner.job.model import Job
from planner.part.outline import smallest_rectangle
from planner.report.run_log import RunLog
from planner.report.tree import names_parts, percent
from runtime.table import Node, Table

GOOD_WRONG = 0.005  # share of wrong answers from which a broken assumption lowers the grade
POOR_SUCCESS = 0.9  # share of located parts below which a plan is poor
MOST_CONDITIONS = 3  # most assumptions in a sentence


Grade = Literal["good", "fair", "poor"]


class Weakest(NamedTuple):
    """The world in which a plan does worst, among worlds that break one assumption each."""

    name: str  # name of the world
    wrong: float  # share of confident wrong answers there
    success: float  # share of parts located there

    def text(self) -> str:
        """The world's name and its shares as text."""
        if self.wrong >= GOOD_WRONG:
            return f"{self.name} ({percent(self.wrong)} wrong)"
        return f"{self.name} ({percent(self.success)} located, {percent(self.wrong)} wrong)"


class Verdict(NamedTuple):
    """The grade of a plan, with a sentence, conditions and warnings."""

    grade: Grade
    sentence: str
    error: str  # expected error, as a clause
    conditions: list[str]  # assumptions that keep wrong answers few, the most harmful first
    warnings: list[str]  # reasons to trust the figures less


def weakest(lines: Sequence[Line]) -> Weakest | None:
    """Returns the world with the most wrong answers; of worlds with equally many, that of least success.

    The first of `lines`, the planned world, does not count; None if there is no other.
    """
    if len(lines) < 2:
        return None
    line = max(lines[1:], key=_harm)
    figures = line.evaluation.summary()
    return Weakest(line.case.name, figures["wrong_rate"], figures["success_rate"])


def verdict(
    job: Job, figures: dict[str, Any], lines: Sequence[Line] = (), untried: Sequence[str] = ()
) -> Verdict:
    """The verdict on a job's table.

    Args:
        job: the job of the table.
        figures: as `Evaluation.summary` returns them; for several parts, also those of `Identities`.
        lines: evaluations in several worlds, the planned one first; empty if no other was tried.
        untried: names of further worlds, for which there was no time.
    """
    success, wrong, worst = figures["success_rate"], figures["wrong_rate"], weakest(lines)
    grade: Grade = "good"
    if success < job.goal.confidence or (worst is not None and worst.wrong >= GOOD_WRONG):
        grade = "fair"
    if success < POOR_SUCCESS or wrong > 2.0 * (1.0 - job.goal.confidence):
        grade = "poor"
    effort = f"{figures['mean_squeezes']:.1f} squeezes, about {figures['seconds_mean']:.1f} s"
    sorts = job.goal.kind == "identity"
    error = "where the part lies is not asked for" if sorts else error_text(figures["error_mm"])
    sentence = f"{_located(job, figures)}, {effort}{_leaning(job, worst, len(untried))}"
    return Verdict(grade, sentence, error, _conditions(lines), warnings_of(job))


def _harm(line: Line) -> tuple[float, float]:
    wrong, success = line.evaluation.wrong.mean(), line.evaluation.success.mean()
    return round(float(wrong), 3), -float(success)


def _conditions(lines: Sequence[Line]) -> list[str]:
    """Texts of the assumptions without which too many answers are wrong.

    The most harmful assumption comes first. Of several bounds on the same side of a quantity, only the
    strictest is stated.
    """
    failing = [line for line in lines[1:] if float(line.evaluation.wrong.mean()) >= GOOD_WRONG]
    strictest: dict[tuple[str, str], Condition] = {}
    for case, _ in sorted(failing, key=_harm, reverse=True):
        condition = case.broken or Condition(f"this does not occur: {case.name}")
        key = condition.quantity, condition.side
        if key not in strictest or condition.stricter(strictest[key]):
            strictest[key] = condition
    result = {}
    for condition in strictest.values():
        above, below = (strictest.get((condition.quantity, side)) for side in ("above", "below"))
        text = condition.text()
        if above and below:
            text = f"{condition.quantity} stays between {above.bound:.3g} and {below.value()}"
        result[condition.quantity] = text
    return list(result.values())


def listed(conditions: Sequence[str]) -> str:
    """Joins conditions to a clause, "if friction stays below 1.35 and ..."; "" if there are none."""
    if not conditions:
        return ""
    shown = [*conditions[:MOST_CONDITIONS]]
    rest = len(conditions) - len(shown)
    if rest:
        shown.append(f"{rest} more assumption{'s' * (rest > 1)} hold{'s' * (rest == 1)}")
    return "if " + (", ".join(shown[:-1]) + " and " if len(shown) > 1 else "") + shown[-1]


def _located(job: Job, figures: dict[str, Any]) -> str:
    """A clause: what is located, and how often; for several parts, also how often the name is right."""
    share = f"in {in_percent(shares_of(figures).located)} of trials"
    if not job.hypothesis:
        return f"finds a {described(job)} lying {belief(job)} {aim(job)} {share}"
    lying = f"a part ({job.name}) lying {belief(job)}"
    if job.goal.identify is False:
        return f"finds {lying} {aim(job)} {share}, whichever it is"
    sorts = job.goal.kind == "identity"
    done = f"names {lying}" if sorts else f"finds and names {lying} {aim(job)}"
    return f"{done} {share} ({percent(figures['identity_rate'])} of the names given are right)"


def _leaning(job: Job, worst: Weakest | None, untried: int) -> str:
    if worst is None:
        return ""
    if untried:
        return f"; {untried} assumptions were not tried, the weakest of the others: {worst.text()}"
    if worst.wrong < GOOD_WRONG and worst.success >= job.goal.confidence:
        return f"; it holds where assumptions fail one by one, the weakest: {worst.text()}"
    return f"; weakest assumption: {worst.text()}"


def error_text(error_mm: dict[str, float] | None) -> str:
    """The expected error as a clause."""
    if error_mm is None:
        return "no expected error: no part was located"
    median_mm, p95_mm = error_mm["median"], error_mm["p95"]
    return f"expected error {median_mm:.2f} mm median, 95 % within {p95_mm:.2f} mm"


def described(job: Job) -> str:
    """The part by its size and name."""
    length, width, _ = smallest_rectangle(job.part.outline_mm)
    return f"{length:.3g} x {width:.3g} mm {job.part.name}"


def belief(job: Job) -> str:
    """The uncertainty of the part's pose as a clause."""
    turn = job.uncertainty.orientation_halfwidth_deg
    angle = "at any angle" if turn >= 180.0 else f"and {turn:g} degrees"
    return f"within {job.uncertainty.radius_mm:g} mm {angle}"


def aim(job: Job) -> str:
    """The tolerance of a job's goal as a clause, such as "to 3 mm"."""
    goal = job.goal
    if goal.kind == "tolerances":
        return f"to {goal.tolerance_mm[0]:g} x {goal.tolerance_mm[1]:g} mm and {goal.tolerance_deg:g} degrees"
    if goal.kind == "orientation":
        return f"to {goal.tolerance_deg:g} degrees"
    modes = f" in one of {goal.modes} poses" if goal.kind == "modes" else ""
    return f"to {goal.distance_mm:g} mm{modes}"


FAR_MM = 2.0  # distance from every planned width that means another part or pose, not noise
USUAL = 0.9  # share of located parts below which the grade of a cell is poor


class CellResult(NamedTuple):
    """The grade of a cell, and a sentence that states the outcomes of its parts."""

    grade: Grade
    sentence: str


def cell_result(table: Table, log: RunLog) -> CellResult:
    """Grades a cell by its journal; states how parts ended, and which node rejected most parts."""
    total = len(log.parts)
    if not total:
        return CellResult("fair", "no part was begun")
    located = sum(not part.failed for part in log.parts)
    done = "named" if table.goal.kind == "identity" else "located"
    message = f"{located} of {total} parts {done}"
    answered = [part for part in log.parts if part.outcome == "leaf"]
    names = Counter(part.name for part in answered if part.name is not None)
    if names and names_parts(table):
        message += f" ({', '.join(f'{number} {name}' for name, number in names.most_common())})"
    wrong = sum(part.audit == "fail" for part in log.parts)
    message += f", {wrong} refuted by the audit" if wrong else ""
    others = Counter(part.outcome for part in log.parts if part.outcome != "leaf")
    message += "".join(f", {number} {outcome}" for outcome, number in others.most_common())
    rejects = [squeeze for _, squeeze in log.rejects()]
    if rejects:  # the readings at the node that rejected most parts
        node = Counter(squeeze.node for squeeze in rejects).most_common(1)[0][0]
        widths = sorted(squeeze.width_um for squeeze in rejects if squeeze.node == node)
        middle = widths[len(widths) // 2]
        message += f"; {len(widths)} rejected at node {node}: {reject_text(table, node, middle)}"
    share = located / total
    return CellResult("good" if share == 1.0 else "fair" if share >= USUAL else "poor", message)


def reject_text(table: Table, node: int, width_um: int) -> str:
    """Text of a rejected reading: the width read at a node, and the widths that were planned there."""
    read_mm = width_um / 1e3
    spans = planned_spans(table.nodes[node])
    planned = ", ".join(f"{low:.1f} to {high:.1f}" for low, high in spans)
    off = min(max(low - read_mm, read_mm - high, 0.0) for low, high in spans)
    return f"{read_mm:.1f} mm read, {planned} planned" + (": another part?" if off > FAR_MM else "")


def planned_spans(node: Node) -> list[tuple[float, float]]:
    """The intervals of width that lead to some branch of a node [mm]; adjacent intervals are merged."""
    spans: list[tuple[float, float]] = []
    for branch in sorted(node.branches, key=lambda branch: branch.low_um):
        low, high = branch.low_um / 1e3, branch.high_um / 1e3
        if spans and low <= spans[-1][1]:
            spans[-1] = (spans[-1][0], max(high, spans[-1][1]))
        else:
            spans.append((low, high))
    return spans
