"""Runs parts one after another: locates each, compares it with its true pose if known, and sums up."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import isfinite

from drivers.ports import Gripper, Scene
from runtime.errors import JournalError
from runtime.execution import held
from runtime.execution.events import Console, Sighting, Tally
from runtime.execution.executor import Cell, Executor, RunOptions
from runtime.execution.hand import Hand
from runtime.execution.safe_state import ending_safely, fingers_stop
from runtime.execution.safety import needs_activation, ready_gripper
from runtime.journal.chain import Journal
from runtime.journal.replay import Replay
from runtime.shell import interrupts
from runtime.shell.errors import exit_code_of
from runtime.table import Table, error_mm, meets, poses_of
from runtime.traversal.results import Outcome, PartResult

CONTINUING = frozenset({Outcome.LEAF, Outcome.REJECT, Outcome.UNRESOLVED})


def prepare_gripper(gripper: Gripper, tell: Callable[[str], object], *, activate: bool) -> None:
    """Checks that the gripper may be moved; with `activate`, first activates it if needed.

    An activation opens and closes the fingers fully.

    Args:
        gripper: the gripper.
        tell: receives a sentence before an activation.
        activate: whether the gripper may be activated.

    Raises:
        GripperStateError: the gripper moves; or it is inactive or in fault, and activation is not allowed or
            fails.
    """
    if activate and needs_activation(gripper.state()):
        tell("activating the gripper: the fingers open and close fully")
        with fingers_stop(gripper):
            gripper.activate()
    ready_gripper(gripper)


def run_journalled(
    table: Table, cell: Cell, console: Console, options: RunOptions, broken: Replay | None = None
) -> Tally:
    """Prepares the gripper, runs the parts, and writes the run's last record in any case.

    Args:
        table: the table to execute.
        cell: devices and records; the journal must already have its header.
        console: receives the events.
        options: options of the run; the part at which `broken` ended is finished even if `count` is less.
        broken: a run that broke off, to continue.

    Returns:
        The totals over the parts.

    Raises:
        JournalError: the last record cannot be written.
        Exception: any other error, once it is recorded.
    """
    with ending(cell.journal) as tally:
        count = options.count or 1
        first = 1 if broken is None else broken.parts + 1
        last = count if broken is None or broken.part is None else max(count, broken.part)
        if first > last:
            console.note(
                f"no part is left: the run that broke off did {first - 1}, and --count is {count}"
            )
        run_parts(range(first, last + 1), table, cell, console, tally, options, broken)
    return tally


def run_parts(
    numbers: Iterable[int],
    table: Table,
    cell: Cell,
    console: Console,
    tally: Tally,
    options: RunOptions,
    broken: Replay | None = None,
) -> None:
    """Prepares the gripper, and runs parts until they are done or one ends the run.

    The gripper is not prepared if the run `broken` ended within a part, which the fingers may still hold.

    Args:
        numbers: the numbers of the parts; the next number is drawn once the part before has its outcome.
        table: the table to execute.
        cell: devices and records.
        console: receives the events.
        tally: adds up the results.
        options: options of the run.
        broken: a run that broke off, to continue.

    Raises:
        Exception: any error that is not the outcome of a part.
    """
    tally.takt_s, tally.timed = options.takt_s, options.timed
    # Fingers that may still hold the part of a broken run are left to the executor and never sweep.
    if broken is None or broken.part is None:
        with interrupts.stoppable():
            prepare_gripper(cell.gripper, console.note, activate=options.activate)
    executor, scene = Executor(table, cell, console, options), cell.scene
    for number in numbers:
        resumed = broken if broken is not None and broken.part == number else None
        if scene is not None and resumed is None:
            scene.next_part()
        result = executor.run_part(number, resumed)
        seen = None
        if scene is not None and result.outcome in CONTINUING:
            seen = sight(table, scene, result)
        if seen is not None and seen.true is not None:
            cell.journal.record("truth", {"part": number, **truth_fields(seen)})
        console.part(result, seen)
        tally.add(result, seen)
        if options.policy.ends_run(result.outcome):
            return


def put_down(table: Table, cell: Cell, options: RunOptions) -> Mapping[str, object]:
    """Puts down what the fingers hold, as a run without parts; returns the place and the width.

    Raises:
        Exception: any error, once the declared safe state is reached and recorded.
    """
    hand = Hand(cell.gripper, cell.arm, cell.clock, table, options.handling)
    with ending(cell.journal), ending_safely(hand), interrupts.stoppable():
        return held.put_down(hand, table, options.delivery, cell.journal)


@contextmanager
def ending(journal: Journal) -> Iterator[Tally]:
    """Context of a run: yields the run's totals, still zero, and at the end writes the run's last record.

    The record is also written, with the reason, when an exception ends the run.

    Raises:
        JournalError: the last record of a run without an exception cannot be written.
    """
    tally = Tally()
    try:
        yield tally
        interrupts.conclude()
        end_run(journal, tally)
    except BaseException as error:
        interrupts.conclude()
        with suppress(JournalError):
            journal.record("end", _end_fields(tally, exit_code_of(error), _reason(error)))
        raise


def end_run(journal: Journal, tally: Tally) -> None:
    """Writes the last record of a run that ended without an error."""
    journal.record("end", _end_fields(tally, tally.exit_code, None))


def sight(table: Table, scene: Scene, result: PartResult) -> Sighting:
    """Compares the pose that a part's result predicts with the true pose, which `scene` knows."""
    truth = scene.truth()
    named = table.hypotheses[truth.hypothesis].name if table.hypotheses else None
    true = (truth.x_mm, truth.y_mm, truth.theta_rad)
    if not all(map(isfinite, true)):
        return Sighting(None, None, None, truth.crashes)
    # A delivered part lies elsewhere now.
    leaf = result.leaf_of(table)
    if result.outcome is not Outcome.LEAF or leaf is None or result.delivery is not None:
        return Sighting(true, None, None, truth.crashes, named)
    goal = table.goal_of(truth.hypothesis)
    off_mm = min(error_mm(goal, pose, true) for pose in poses_of(goal, leaf))
    shown_mm = None if goal.kind in ("orientation", "identity") else off_mm
    within = meets(goal, leaf, true, truth.hypothesis)
    return Sighting(true, shown_mm, within, truth.crashes, named)


def truth_fields(seen: Sighting) -> dict[str, object]:
    """The true pose of a simulated part, as fields of a journal record."""
    assert seen.true is not None
    x_mm, y_mm, theta_rad = seen.true
    turn_urad = round(1e6 * theta_rad)
    pose = {"x_um": round(1e3 * x_mm), "y_um": round(1e3 * y_mm), "theta_urad": turn_urad}
    off = None if seen.error_mm is None else round(1e3 * seen.error_mm)
    named = {} if seen.hypothesis is None else {"hypothesis": seen.hypothesis}
    return {**pose, "error_um": off, "within_goal": seen.within, **named}


def _reason(error: BaseException) -> str:
    if not isinstance(error, KeyboardInterrupt):
        return repr(error)
    return "; ".join(["stopped by the operator", *getattr(error, "__notes__", ())])


def _end_fields(tally: Tally, code: int, reason: str | None) -> dict[str, object]:
    return {**tally.fields(), "exit_code": code, "reason": reason}
