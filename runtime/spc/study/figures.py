"""Computes the figures of a run-off: its acceptance, and studies of the squeeze as a gauge of poses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, remainder, tau
from typing import NamedTuple

from runtime import table as tables
from runtime.shell.errors import UsageError
from runtime.spc.history import History, Part, by_leaf
from runtime.spc.study.acceptance import Acceptance, Bounds, Planned, followed, parts_for, planned
from runtime.spc.study.gauge import LEAST_READINGS, Crossed, Readings, TypeOne, crossed, type_one
from runtime.table import PPM, GoalSpec, Table, poses_of, predicted_pose, turned_pose

Quantity = Callable[[Part], float]
COORDINATES = ("x_mm", "y_mm", "theta_rad")
COVERED = 0.95  # share of the parts whose leaves get a type-1 study
CHECKPOINTS = 200  # number of points of the drawn curve of bounds
CROSSED = {"parts": 10, "appraisers": 3, "trials": 3}  # the usual size of a crossed study


class GaugeRow(NamedTuple):
    """Type-1 studies (bias, Cg, Cgk) of the parts at one leaf, or at all leaves."""

    leaf: int | None  # index of the leaf; None for all leaves together
    readings: int  # number of measured parts
    studies: Mapping[str, TypeOne]  # a study for each coordinate for which the goal has a tolerance

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
        pairs = self.studies.items()
        studies = {name: {**one._asdict(), "capable": one.capable} for name, one in pairs}
        return {"leaf": self.leaf, "readings": self.readings, **studies}


@dataclass(frozen=True, slots=True)
class Study:
    """Results of the study of a run-off."""

    history: History
    acceptance: Acceptance  # the state at the end of the run-off
    # states of the acceptance, evenly spread over the run-off, and also at the verdict and at the end
    curve: tuple[Acceptance, ...]
    table: GaugeRow  # type-1 studies of the parts at all leaves
    leaves: tuple[GaugeRow, ...]  # type-1 studies of each leaf
    crossed: Mapping[str, Crossed]  # crossed studies by quantity; empty if not requested
    planned: Planned  # number of parts that the acceptance needs

    @property
    def bounds(self) -> Bounds:
        """Confidence bounds of the share of failures.

        With confidence 1 - `ERROR`, the true share is within the bounds of every state in `curve`. So the
        greatest lower and the least upper bound are returned. If these two contradict one another, the share
        has changed during the run-off, and the bounds at its end are returned.
        """
        last, looks = self.acceptance.bounds, [now.bounds for now in self.curve]
        low, high = max(look.low for look in looks), min(look.high for look in looks)
        return Bounds(low, last.share, high) if low <= high else last

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
        return {
            **self.acceptance.fields(),
            "failures": self.bounds._asdict(),
            "table_sha256": self.history.table_sha256,
            "parts": len(self.history.parts),
            "parts_least": self.planned.least,
            "parts_likely": self.planned.likely,
            "type1": {
                "table": self.table.fields(),
                "leaves": [row.fields() for row in self.leaves],
            },
            "crossed": {name: study.fields() for name, study in self.crossed.items()},
        }


def studied(history: History, limit: float, others: Mapping[str, Crossed]) -> Study:
    """Computes the acceptance and the type-1 studies of a run-off.

    Args:
        history: the parts of the run-off.
        limit: largest acceptable share of failures.
        others: crossed studies, which are copied to the result.

    Raises:
        UsageError: no part was audited, too few were measured, or every part was stopped or given up.
    """
    if not any(part.verdict for part in history.parts):
        raise UsageError(
            "the journals hold no audited part; run with --audit, or study a simulated cell with --truth"
        )
    located = (part for part in history.parts if part.leaf is not None)
    measured = [part for part in located if part.residual is not None]
    tolerances = tolerances_of(history.table.goal)
    if tolerances and len(measured) < LEAST_READINGS:
        raise UsageError(
            f"the journals hold {len(measured)} measured parts; a type-1 study takes {LEAST_READINGS} or more"
        )
    course = list(followed(history.parts, limit))
    if not course:
        raise UsageError(
            "every part of the journals was stopped or given up; run some to their end"
        )
    step = max(1, len(course) // CHECKPOINTS)
    decided = course[-1].decided_at
    curve = (now for now in course if now.parts % step == 0 or now.parts in (decided, len(course)))
    leaves = []
    for leaf, parts in by_leaf(measured):
        goal = history.table.goal_of(history.table.leaves[leaf].hypothesis)
        leaves.append(_row(leaf, parts, tolerances_of(goal)))
    whole, plan = _row(None, measured, tolerances), planned(limit, expected_failures(history.table))
    return Study(history, course[-1], tuple(curve), whole, tuple(leaves), others, plan)


def by_truth(history: History) -> History:
    """Copies a history of simulated parts; its verdicts and residuals are computed from the true poses.

    A part that ended at no leaf, or whose true pose is unknown, gets neither verdict nor residual.
    """
    return replace(history, parts=tuple(_judged(history.table, part) for part in history.parts))


def tolerances_of(goal: GoalSpec) -> dict[str, float]:
    """Whole width of the goal's tolerance for each coordinate: greatest minus least allowed value, mm or rad.

    If the goal states a distance, the width is twice this distance. For the angle, the distance is divided by
    the goal's weight rho, in mm per rad. Coordinates without a tolerance are left out.
    """
    if goal.kind in ("tolerances", "orientation"):
        tolerance, turn = goal.tolerance, {"theta_rad": goal.tolerance.theta_urad / 5e5}
        if goal.kind == "orientation":
            return turn
        return {"x_mm": tolerance.x_um / 500, "y_mm": tolerance.y_um / 500, **turn}
    if goal.kind == "identity":
        return {}
    width = goal.distance_um / 500
    turn = {"theta_rad": width / (goal.rho_um / 1000)} if goal.rho_um else {}
    return {"x_mm": width, "y_mm": width, **turn}


def expected_failures(table: Table) -> float | None:
    """Share of parts that failed in the table's evaluation; None if the table has no evaluation."""
    return 1.0 - table.predicted.success_ppm / PPM if table.predicted.trials else None


def parts_of_leaves(table: Table) -> int | None:
    """Number of parts to run, so that enough of them end at each frequent leaf for its type-1 study.

    The frequent leaves are those that together receive the share `COVERED` of the parts. The rarest of them
    determines the number.

    Returns:
        The number of parts; None if the table has no trials, or if too many parts would be needed.
    """
    trials = sorted((leaf.trials for leaf in table.leaves), reverse=True)
    total, seen = sum(trials), 0
    for count in trials:
        seen += count
        if total and seen >= COVERED * total:
            return parts_for(LEAST_READINGS, count / total)
    return None


def crossed_of(runs: Sequence[History], parts: int) -> dict[str, Crossed]:
    """Computes crossed studies (gauge R&R) of the squeeze as a gauge; each journal is an appraiser.

    One studied quantity is the width of the first squeeze: for this squeeze the hand is at the same place for
    every part. If every part was located, the coordinates of the predicted pose are studied, too.

    Args:
        runs: the history of each journal; all journals have one table.
        parts: number of different parts; each journal measures all of them repeatedly, in the same order.

    Returns:
        The studies, by quantity.

    Raises:
        UsageError: the journals do not hold such a study.
    """
    for number, run in enumerate(runs, 1):
        count, first = len(run.parts), len(runs[0].parts)
        if count % parts or count != first:
            other = f"the first one {first}" if count != first else f"no multiple of {parts}"
            raise UsageError(
                f"--crossed {parts}: journal {number} holds {count} parts, {other}; each holds all "
                "parts equally often"
            )
        if not all(part.squeezes for part in run.parts):
            raise UsageError(
                f"--crossed {parts}: a part of journal {number} was never squeezed; run it again"
            )
    table = runs[0].table
    quantities: dict[str, Quantity] = {"width_mm": lambda part: part.squeezes[0].width_um / 1000}
    if all(part.outcome == "leaf" for run in runs for part in run.parts):
        quantities |= {name: _coordinate(table, k) for k, name in enumerate(COORDINATES)}
    try:
        return {name: crossed(_readings(name, runs, parts, of)) for name, of in quantities.items()}
    except ValueError as error:
        raise UsageError(f"--crossed {parts}: {error}") from error


def _coordinate(table: Table, number: int) -> Quantity:
    """Builds a function that returns a coordinate of a part's predicted pose in the world.

    Args:
        table: the table by which the part was located.
        number: index of the coordinate: x, y or theta.
    """
    return lambda part: turned_pose(predicted_pose(table.leaves[part.leaf or 0]), part.turn_rad)[
        number
    ]


def _readings(name: str, runs: Sequence[History], parts: int, of: Quantity) -> Readings:
    """Collects the readings of a quantity by part, journal and trial.

    Angles of a symmetric part are ambiguous by whole periods of its symmetry. Each angle is shifted by whole
    periods, to within half a period of the part's first angle.

    Args:
        name: name of the quantity.
        runs: the history of each journal.
        parts: number of different parts.
        of: returns the quantity of a part.
    """
    readings = [[[of(part) for part in run.parts[k::parts]] for run in runs] for k in range(parts)]
    if name != "theta_rad":
        return readings
    period = tau / runs[0].table.goal.symmetry
    return [
        [[row[0][0] + remainder(angle - row[0][0], period) for angle in cell] for cell in row]
        for row in readings
    ]


def _row(leaf: int | None, parts: Sequence[Part], tolerances: Mapping[str, float]) -> GaugeRow:
    off = [part.residual for part in parts if part.residual is not None]
    columns = {name: [-deviation[k] for deviation in off] for k, name in enumerate(COORDINATES)}
    studies = {name: type_one(columns[name], width) for name, width in tolerances.items() if off}
    return GaugeRow(leaf, len(parts), studies)


def _judged(table: Table, part: Part) -> Part:
    true = part.true
    if true is None or part.leaf is None or part.within is None:
        return replace(part, verdict=None, residual=None)
    leaf = table.leaves[part.leaf]
    goal = table.goal_of(leaf.hypothesis)
    pose = min(poses_of(goal, leaf), key=lambda pose: tables.distance(goal, pose, true))
    off = tables.residual(goal, pose, true)
    return replace(part, verdict="pass" if part.within else "fail", residual=off)


def in_degrees(name: str, value: float) -> float:
    """Converts a value of a coordinate for display: `theta_rad` to degrees, others not at all."""
    return degrees(value) if name == "theta_rad" else value
