"""A run of many parts: feed, execute, compare with the truth where there is one, sum up."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from math import isfinite

from drivers.ports import Gripper
from runtime.devices.ports import Journal, Scene
from runtime.errors import JournalError, exit_code_of
from runtime.execution import held
from runtime.execution.events import Console, Sighting, Tally, Watcher, ignore_phase
from runtime.execution.executor import Cell, Executor, RunOptions
from runtime.execution.hand import Hand
from runtime.execution.recovery import BrokenRun
from runtime.execution.safe_state import fingers_stop, reach_safe_state
from runtime.execution.safety import ready_gripper
from runtime.shell import interrupts
from runtime.table import Calibration, Table, error_mm, meets, poses_of
from runtime.traversal.results import Outcome, PartResult

CONTINUING = frozenset({Outcome.LEAF, Outcome.REJECT, Outcome.UNRESOLVED})
Result = tuple[PartResult, Sighting | None]


def prepare_gripper(gripper: Gripper, console: Console, *, activate: bool) -> None:
    """Make sure that the gripper may be moved; only `activate` lets the fingers sweep.

    Args:
        gripper: connected, not yet moved.
        console: told before the fingers move.
        activate: whether an inactive gripper may be activated.

    Raises:
        GripperStateError: it is not active and must not be activated, or reports a fault.
    """
    if activate and not gripper.state().activated:
        console.note("activating the gripper: the fingers open and close fully")
        with fingers_stop(gripper):
            gripper.activate()
    ready_gripper(gripper)


def run_journalled(
    table: Table,
    cell: Cell,
    scene: Scene | None,
    console: Console,
    *,
    count: int,
    activate: bool,
    options: RunOptions | None = None,
    watch: Watcher = ignore_phase,
    broken: BrokenRun | None = None,
) -> Tally:
    """Prepare the gripper, run the parts, and write the run's last record however it ends.

    Args:
        table: the table, proved.
        cell: the devices and the journal, its header written.
        scene: the simulated cell's feeder and ground truth, None on a real one.
        console: told as it happens.
        count: number of parts, those of a broken run included.
        activate: whether an inactive gripper may be activated.
        options: what the table leaves open.
        watch: told of each change of phase.
        broken: the run that broke off and is gone on with, None for a new one.

    Returns:
        What the parts came to; each one's result goes to the console.

    Raises:
        JournalError: the last record cannot be written.
        Exception: an error before the first part, or between two, once it is recorded.
    """
    options = options or RunOptions()
    with _ending(cell.journal) as tally:
        # Fingers that may hold a part are the executor's to look at, and never sweep.
        if broken is None or broken.part is None:
            with interrupts.stoppable():
                prepare_gripper(cell.gripper, console, activate=activate)
        for result, seen in run_parts(table, cell, scene, console, count, options, watch, broken):
            tally.add(result, seen)
    return tally


def put_down(table: Table, cell: Cell, console: Console, options: RunOptions) -> Mapping[str, object]:
    """Put down what the fingers hold, as a run without parts.

    Args:
        table: the table, proved.
        cell: the devices and the journal, its header written.
        console: told what the safe state was after a fault.
        options: how the hand is used, and where parts are carried.

    Returns:
        Where it was put down, and its width.

    Raises:
        Exception: whatever went wrong, once the declared safe state is reached and recorded.
    """
    calibration = options.handling.calibration or Calibration.linear(table.gripper)
    hand = Hand(cell.gripper, cell.arm, cell.clock, table.limits, calibration, options.handling)
    with _ending(cell.journal):
        try:
            with interrupts.stoppable():
                return held.put_down(hand, table, options.delivery, cell.journal)
        except BaseException:
            for sentence in reach_safe_state(cell.gripper, cell.arm, table.limits, arm_known=hand.arm_known):
                console.note(sentence)
            raise


@contextmanager
def _ending(journal: Journal) -> Iterator[Tally]:
    """Write a run's last record however it ends."""
    tally = Tally()
    try:
        yield tally
    except BaseException as error:
        interrupts.conclude()
        with suppress(JournalError):
            journal.record("end", _end_fields(tally, exit_code_of(error), _reason(error)))
        raise
    interrupts.conclude()
    journal.record("end", _end_fields(tally, tally.exit_code, None))


def run_parts(
    table: Table,
    cell: Cell,
    scene: Scene | None,
    console: Console,
    count: int,
    options: RunOptions | None = None,
    watch: Watcher = ignore_phase,
    broken: BrokenRun | None = None,
) -> Iterator[Result]:
    """Execute the table on the parts up to number `count`, or until one whose end ends the run.

    Args:
        table: the table, proved.
        cell: the devices and the journal.
        scene: the simulated cell's feeder and ground truth, None on a real one.
        console: told as it happens.
        count: the last part's number.
        options: what the table leaves open.
        watch: told of each change of phase.
        broken: the run that is gone on with.

    Yields:
        A result a part, with the truth where a scene knows it.
    """
    options = options or RunOptions()
    executor = Executor(table, cell, console.step, options, watch)
    begun = None if broken is None else broken.part
    first = 1 if broken is None else broken.parts + 1
    for number in range(first, count + 1):
        resumed = begun if begun is not None and begun.part == number else None
        if scene is not None and resumed is None:
            scene.next_part()
        result = executor.run_part(number, resumed)
        seen = None if scene is None or result.outcome not in CONTINUING else sight(table, scene, result)
        console.part(result, seen)
        yield result, seen
        if options.policy.ends_run(result.outcome):
            return


def sight(table: Table, scene: Scene, result: PartResult) -> Sighting:
    """Compare a part's predicted pose with the truth."""
    truth = scene.truth()
    true = (truth.x_mm, truth.y_mm, truth.theta_rad)
    if not all(map(isfinite, true)):
        return Sighting(None, None, None, truth.crashes)
    # A part that was taken away by the last grasp lies elsewhere now.
    if result.outcome is not Outcome.LEAF or result.leaf is None or result.delivery is not None:
        return Sighting(true, None, None, truth.crashes)
    goal, leaf = table.goal, table.leaves[result.leaf]
    off_mm = min(error_mm(goal, pose, true) for pose in poses_of(goal, leaf))
    shown_mm = None if goal.kind == "orientation" else off_mm
    return Sighting(true, shown_mm, meets(goal, leaf, true), truth.crashes)


def _reason(error: BaseException) -> str:
    if not isinstance(error, KeyboardInterrupt):
        return repr(error)
    return "; ".join(["stopped by the operator", *getattr(error, "__notes__", ())])


def _end_fields(tally: Tally, code: int, reason: str | None) -> dict[str, object]:
    return {**tally.fields(), "exit_code": code, "reason": reason}
