"""Prints what happens in a run: lines for people, or one JSON object for each part."""

import json
import sys
from collections.abc import Iterator
from math import degrees
from pathlib import Path

from runtime.execution.events import Console, Sighting, Tally
from runtime.shell.command import say
from runtime.table import GoalSpec, Leaf, Pose2, Table, predicted_pose, takt_text
from runtime.table.geometry import compose, placement, pose_text
from runtime.traversal import answer
from runtime.traversal.results import Outcome, PartResult, Step


class Lines(Console):
    """A console that prints lines for people: one for each squeeze and each part, and one at the end."""

    def __init__(self, table: Table) -> None:
        self._table, self._frames = table, answer.frames_of(table)

    def note(self, sentence: str) -> None:
        """Prints a sentence as a line."""
        say(sentence)

    def step(self, part: int, step: Step) -> None:
        """Prints a line for a squeeze: its node, the hand's pose, the width, and the node or leaf reached."""
        place = pose_text(placement(step.squeeze))
        say(
            f"part {part} squeeze {step.number}: node {step.node}, hand at {place}; "
            f"width {step.width_um / 1000:.2f} mm -> {_reached(step)}"
        )

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Prints a line for a part's result: outcome, leaf, predicted pose, success in the table's trials.

        If the true pose is known, the line also states the true error.
        """
        message = f"part {result.part}: {result.outcome.name}"
        if (leaf := result.leaf_of(self._table)) is not None:
            success = (
                "never tried" if leaf.success is None else f"{leaf.success:.4f} of {leaf.trials}"
            )
            named = "" if (name := self._table.name_of(leaf)) is None else f"{name}, "
            message += (
                f", leaf {result.leaf}, {named}{pose_text(predicted_pose(leaf))}, success {success}"
            )
            datum = self._frames[leaf.hypothesis].datum
            if datum is not None and leaf.resolved:
                message += f", datum {pose_text(compose(predicted_pose(leaf), datum))}"
            if (error := _expected_error(leaf)) is not None:
                message += f", error {error['median']:.2f} mm (95 %: {error['p95']:.2f})"
        if seen is not None and seen.error_mm is not None:
            message += f"; true error {seen.error_mm:.2f} mm"
        if seen is not None and seen.hypothesis is not None:
            message += f"; it is {seen.hypothesis}"
        message += "".join(f"; {sentence}" for sentence in _sentences(result))
        say(message)

    def summary(self, tally: Tally, journal: Path) -> None:
        """Prints a line for the whole run: totals and means of its parts, and the journal's path.

        The totals are the parts by outcome, the parts within the goal, and the crashes, if known. The means
        are the squeezes and the seconds a part.
        """
        parts = "1 part" if tally.parts == 1 else f"{tally.parts} parts"
        say(f"{parts}: {', '.join(_totals(tally, self._table.goal))}; journal {journal}")


class Objects(Console):
    """A console that prints one JSON object for each part on standard output, and notes on standard error."""

    def __init__(self, table: Table, journal: Path) -> None:
        self._table = table
        self._journal = journal

    def note(self, sentence: str) -> None:
        """Prints a sentence on standard error."""
        say(sentence, sys.stderr)

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Prints the result of a part as one JSON object (`as_object`)."""
        say(json.dumps(as_object(self._table, result, seen, self._journal)))


def as_object(
    table: Table, result: PartResult, seen: Sighting | None, journal: Path
) -> dict[str, object]:
    """The result of a part in the form of JSON; the names of the fields state their units.

    Args:
        table: the table by which the part was located.
        result: the part's result.
        seen: the part's true pose and name, if known; else None.
        journal: path of the run's journal.
    """
    leaf, fields = result.leaf_of(table), result.fields()
    del fields["phases"]
    return {
        **fields,
        "readings_mm": [step.reading_um / 1000 for step in result.steps],
        "widths_mm": [step.width_um / 1000 for step in result.steps],
        "predicted_pose": None if leaf is None else _pose_object(predicted_pose(leaf)),
        **_in_the_drawing(table, result),
        "success_probability": None if leaf is None else leaf.success,
        "success_trials": None if leaf is None else leaf.trials,
        "expected_error_mm": None if leaf is None else _expected_error(leaf),
        **_names(table, leaf, seen),
        "true_pose": None if seen is None or seen.true is None else _pose_object(seen.true),
        "error_mm": None if seen is None or seen.error_mm is None else round(seen.error_mm, 4),
        "within_goal": None if seen is None else seen.within,
        "crashes": None if seen is None else seen.crashes,
        "journal": str(journal),
    }


def _in_the_drawing(table: Table, result: PartResult) -> dict[str, object]:
    """Returns the fields `datum_pose` and `picks`: where the drawing's datum and the picks lie on a part.

    The result is empty if the part ended at no leaf, or if the job names no datum of the part.
    """
    frames = answer.frames_of(table)
    leaf = result.leaf_of(table)
    if leaf is None or frames[leaf.hypothesis].datum is None:
        return {}
    fields = answer.fields(table, result, frames)
    return {"datum_pose": fields["datum"], "picks": fields["picks"]}


def _names(table: Table, leaf: Leaf | None, seen: Sighting | None) -> dict[str, object]:
    """The fields with the predicted and the true name of a part; none for a table of a single part."""
    if not table.hypotheses:
        return {}
    said = None if leaf is None else table.name_of(leaf)
    return {"hypothesis": said, "true_hypothesis": None if seen is None else seen.hypothesis}


def _totals(tally: Tally, goal: GoalSpec) -> Iterator[str]:
    yield from (f"{tally.outcomes[each]} {each.name}" for each in Outcome if tally.outcomes[each])
    if tally.within is not None:
        yield f"{tally.within} within {_goal(goal)}"
    if tally.crashes is not None:
        yield f"{tally.crashes} crashes"
    yield f"{tally.squeezes / max(tally.parts, 1):.2f} squeezes a part"
    if times := tally.times():
        yield f"{times['seconds_mean']:.1f} s a part, 95 % within {times['seconds_p95']:.1f} s"
    if "takt_s" in times:
        yield takt_text(times)


def _goal(goal: GoalSpec) -> str:
    if goal.kind == "identity":
        return "the right part"
    if goal.kind in ("pose", "modes"):
        return f"{goal.distance_um / 1000:g} mm"
    tolerance = goal.tolerance
    turn = f"{round(degrees(tolerance.theta_urad / 1e6), 3):g} deg"
    if goal.kind == "orientation":
        return turn
    return f"{tolerance.x_um / 1000:g} mm, {tolerance.y_um / 1000:g} mm, {turn}"


def _reached(step: Step) -> str:
    if step.target is None:
        return f"REJECT, {step.reason}"
    return f"node {step.target}" if step.target >= 0 else f"leaf {~step.target}"


def _sentences(result: PartResult) -> list[str]:
    lines = [] if result.audit is None else [f"audit: {result.audit}"]
    lines += [] if result.delivery is None else [f"delivery: {result.delivery}"]
    return [*lines, *([result.reason] if result.reason else []), *result.safe_state]


def _expected_error(leaf: Leaf) -> dict[str, float] | None:
    """Median and 95th percentile of the error in the trials that ended at a leaf, mm; None without trials."""
    errors_mm = {"median": leaf.error_median_um / 1000, "p95": leaf.error_p95_um / 1000}
    return errors_mm if leaf.trials else None


def _pose_object(pose: Pose2) -> dict[str, float]:
    return {"x_mm": pose[0], "y_mm": pose[1], "theta_rad": pose[2]}
