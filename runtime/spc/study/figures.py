"""Figures of a study: the squeeze as a gauge of poses, leaf by leaf, and the cell's acceptance."""

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
CHECKPOINTS = 200  # points of the curve of bounds
CROSSED = {"parts": 10, "appraisers": 3, "trials": 3}  # the usual design


class GaugeRow(NamedTuple):
    """Type-1 studies of one leaf, or of all leaves."""

    leaf: int | None  # None for the whole table
    readings: int
    studies: Mapping[str, TypeOne]  # by coordinate, if the goal has a tolerance for it

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
        pairs = self.studies.items()
        studies = {name: {**one._asdict(), "capable": one.capable} for name, one in pairs}
        return {"leaf": self.leaf, "readings": self.readings, **studies}


@dataclass(frozen=True, slots=True)
class Study:
    """Results of a study of a run-off's journals."""

    history: History
    acceptance: Acceptance
    # the state at looks evenly spread over the run, at the verdict, and at the end
    curve: tuple[Acceptance, ...]
    table: GaugeRow
    leaves: tuple[GaugeRow, ...]
    crossed: Mapping[str, Crossed]  # studies by quantity; empty if not requested
    planned: Planned

    @property
    def bounds(self) -> Bounds:
        """Bounds of the share of failures.

        The bounds of all looks hold together, so the narrowest of `curve` apply. If they contradict one
        another, the share has changed during the run-off, and the bounds of the last look are returned.
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
    """Studies the history of a run-off.

    Args:
        history: the history.
        limit: largest acceptable share of failures.
        others: crossed studies to include.

    Raises:
        UsageError: no part was audited, too few were measured, or the operator stopped every part.
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
        raise UsageError("the operator stopped every part of the journals; run some to their end")
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
    """Copy of a history in which the true pose, known in simulation, decides whether a part passes."""
    return replace(history, parts=tuple(_judged(history.table, part) for part in history.parts))


def tolerances_of(goal: GoalSpec) -> dict[str, float]:
    """Whole widths of the goal's tolerances by coordinate, mm and rad.

    The distance of a goal applies to each coordinate alone; coordinates without a tolerance are left out.
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
    """Share of parts that the table's evaluation did not locate; None without an evaluation."""
    return 1.0 - table.predicted.success_ppm / PPM if table.predicted.trials else None


def parts_of_leaves(table: Table) -> int | None:
    """Number of parts to run, so that each of the most frequent leaves has the readings of a type-1 study.

    These leaves together hold the share `COVERED` of the parts. The result is None if there were no trials,
    or if too many parts would be needed.
    """
    trials = sorted((leaf.trials for leaf in table.leaves), reverse=True)
    total, seen = sum(trials), 0
    for count in trials:
        seen += count
        if total and seen >= COVERED * total:
            return parts_for(LEAST_READINGS, count / total)
    return None


def crossed_of(runs: Sequence[History], parts: int) -> dict[str, Crossed]:
    """Crossed studies, by quantity, of the squeeze as a gauge; each journal is an appraiser.

    The quantities are the width of the first squeeze, where the hand is at the same place for every part, and
    the coordinates of the leaf's pose, if every part was located.

    Args:
        runs: the history of each journal; all journals have one table.
        parts: number of parts, which each run measures again and again in the same order.

    Raises:
        UsageError: the journals do not hold such a study.
    """
    for number, run in enumerate(runs, 1):
        if len(run.parts) % parts or len(run.parts) != len(runs[0].parts):
            raise UsageError(
                f"--crossed {parts}: journal {number} holds {len(run.parts)} parts, the first one "
                f"{len(runs[0].parts)}; each holds all parts equally often"
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
    """A function that returns a coordinate of the pose in the world that a part's leaf predicts."""
    return lambda part: turned_pose(predicted_pose(table.leaves[part.leaf or 0]), part.turn_rad)[
        number
    ]


def _readings(name: str, runs: Sequence[History], parts: int, of: Quantity) -> Readings:
    """Readings of a quantity by part, journal and trial.

    Angles are shifted by whole periods of the part's symmetry, to within half a period of its first reading.
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
    """A value for display: degrees for `theta_rad`, unchanged for other coordinates."""
    return degrees(value) if name == "theta_rad" else value
