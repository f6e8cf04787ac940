"""Squeezes parts with arm and gripper by a table, each until its outcome is known.

`traversal.program` yields the requests, such as a squeeze; `hand` performs them. Any fault and any Ctrl-C
ends in the declared safe state (`safe_state`) and in the outcome FAULT or STOPPED.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from drivers.ports import Arm, Gripper, Scene
from runtime.devices.audit import REFUTED, AuditProcess
from runtime.devices.clock import Lap, SystemClock
from runtime.errors import BrokenRunError, GripperStateError
from runtime.execution import recovery, safety
from runtime.execution.carry import deliver
from runtime.execution.delivery import Places
from runtime.execution.events import Console, Phase
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.execution.reading import reading_fields
from runtime.execution.safe_state import reach_safe_state
from runtime.execution.watch import MACHINE, expected_of
from runtime.journal.chain import Journal
from runtime.journal.replay import Replay
from runtime.shell import interrupts
from runtime.shell.errors import ExpectedError, exit_code_of, is_expected
from runtime.table import Phases, Place, Squeeze, Table, predicted_pose
from runtime.table.geometry import placement
from runtime.traversal import program
from runtime.traversal.answer import outcome_fields
from runtime.traversal.decision import Policy, TraversalState
from runtime.traversal.results import Outcome, PartResult, Step


@dataclass(frozen=True, slots=True)
class Cell:
    """The devices, the clock and the journal of an executor, and its auditor if there is one."""

    gripper: Gripper
    arm: Arm
    clock: SystemClock
    journal: Journal
    auditor: AuditProcess | None = None
    scene: Scene | None = None  # brings and knows the parts of a simulated cell; None: a real cell


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of a run besides its table; without a delivery a localised part stays in place."""

    policy: Policy = field(default_factory=Policy)
    handling: Handling = field(default_factory=Handling)
    delivery: Places | None = None
    activate: bool = False  # whether a gripper that is inactive or in fault may be activated
    count: int | None = 1  # number of parts, including those before a crash; None: no end
    # factor of a squeeze's allowed time, above 1 where a person takes part
    patience: float = 1.0
    takt_s: float | None = None  # time within which parts should be done; only reported
    # whether a part's plan may be turned to the angle of the hand; False where a person takes part
    turns: bool = True
    # whether the clock counts seconds of the cell; False for a clock faster than real time
    timed: bool = True


PLAIN = RunOptions()


class Executor:
    """Executes one valid table in one cell, part by part.

    The devices must be connected, and not yet moved.

    Raises:
        TableError: the gripper cannot execute the table.
    """

    def __init__(
        self, table: Table, cell: Cell, console: Console, options: RunOptions = PLAIN
    ) -> None:
        safety.check_table(table)
        self._console = console
        self._options = options
        self._found: int | None = None  # the leaf of the part that is being delivered
        self._phases: list[Phases] = []  # phases of the part's squeezes so far
        self._steps: tuple[Step, ...] = ()  # squeezes of the current part whose release is done
        self._hand = Hand(cell.gripper, cell.arm, cell.clock, table, options.handling)
        self._cell = replace(cell, journal=self._hand.watch.watched(cell.journal, MACHINE))
        self._plan = program.Program(table, self._hand.calibration, options.policy)
        self._program = self._plan  # turned for the current part

    def run_part(self, part: int, broken: Replay | None = None) -> PartResult:
        """Squeezes one part until its outcome is known, or continues it where a run broke off.

        Returns:
            The result. After LEAF, REJECT and UNRESOLVED the hand is up with the jaws open; after FAULT and
            STOPPED the cell is in the declared safe state; ABORTED means that nothing was moved.

        Raises:
            Exception: any unexpected error, which is a bug, once the safe state is reached.
        """
        self._steps = () if broken is None else tuple(broken.steps)
        self._found, began = None, Lap(self._cell.clock)
        try:
            if broken is None:
                self._cell.journal.record("part", {"part": part})
            with interrupts.stoppable():
                turn_urad = self._turned(part, broken)
                if broken is not None:
                    self._free(part, broken)
                state = program.START if broken is None else broken.traversal
                result = self._finish(self._descend(part, state))
                result = replace(result, turn_urad=turn_urad)
                self._hand.where()  # an arm that was displaced makes any outcome a fault
                if self._options.timed:
                    result = replace(result, seconds=began.lap(), phases=tuple(self._phases))
            self._cell.journal.record("outcome", outcome_fields(self._program.table, result))
        except BrokenRunError as error:
            # Nothing was moved; the operator looks at the fingers.
            aborted = PartResult.of(part, Outcome.ABORTED, self._steps, str(error))
            return self._ended(aborted, ["nothing was moved"])
        except KeyboardInterrupt as request:
            return self._end(part, Outcome.STOPPED, "stopped by the operator", request)
        except Exception as error:
            fault = self._end(part, Outcome.FAULT, str(error), error)
            if not is_expected(error):
                raise
            return fault
        self._console.phase(part, Phase.DONE, None)
        return result

    def _turned(self, part: int, broken: Replay | None) -> int:
        """Turns a part's plan about the origin, so that the first squeeze has the present angle of the hand.

        A part of a broken run keeps the angle by which its plan was turned in that run. The plan is not
        turned where parts are delivered, since the paths to the drop-off are checked for the leaves as
        planned.

        Returns:
            The angle by which the plan was turned, urad; 0 if it was not turned.
        """
        turn_urad = 0
        if broken is not None:
            turn_urad = broken.turn_urad
        elif self._options.turns and self._options.delivery is None:
            turn_urad = round(1e6 * self._hand.turn_of_plan(self._plan.table.nodes[0].squeeze))
            if turn_urad:
                self._cell.journal.record("turned", {"part": part, "turn_urad": turn_urad})
        self._program = self._plan.turned(turn_urad)
        return turn_urad

    def _descend(self, part: int, state: TraversalState) -> PartResult:
        """Performs a part's program from `state` to its end; returns the part's result.

        Each squeeze has a deadline.
        """
        self._phases.clear()
        requests = self._program.part(part, state, self._steps)
        request = next(requests)
        while not isinstance(request, program.Done):
            assert isinstance(request, program.Approach)
            expected = expected_of(self._program.table, request.node)
            with self._hand.watch.squeeze(expected, self._options.patience):
                release = self._squeeze(part, requests, request)
            self._steps = release.steps
            self._console.step(part, release.step)
            request = next(requests)
        return request.result

    def _squeeze(
        self, part: int, requests: program.Requests, approach: program.Approach
    ) -> program.Release:
        """Performs one squeeze, from above the part until the hand is above it again.

        Args:
            part: number of the part.
            requests: the part's program.
            approach: the program's current request.

        Returns:
            The program's request to release the part; this request has been performed already.
        """
        index, node, lap = approach.index, approach.node, Lap(self._cell.clock)
        if not approach.again:
            self._push(part, approach)
        push_s = lap.lap()
        angle_rad = self._travel(part, index, node.squeeze, first=approach.number == 1)
        travel_s = lap.lap()
        self._hand.descend(*placement(node.squeeze)[:2], angle_rad)
        lower_s = lap.lap()
        # Before the part is touched: a resumed run has to know that it may have been.
        document = {"part": part, "number": approach.number, "node": index}
        self._cell.journal.record("placed", document)
        self._console.phase(part, Phase.SQUEEZE, index)
        reading = self._hand.meet(node)
        request = requests.send(program.Reading(reading.width_um, reading.object))
        if isinstance(request, program.Tighten):
            reading = self._hand.tighten(node, reading)
            request = requests.send(program.Reading(reading.width_um, reading.object))
        assert isinstance(request, program.Release)
        self._console.phase(part, Phase.READ, index)
        # Before anything moves on: a decision that is not on the disk was never taken.
        fields = {"part": part, **request.step.fields(), **reading_fields(reading)}
        self._cell.journal.record("squeeze", fields)
        close_s = lap.lap()
        self._console.phase(part, Phase.RELEASE, index)
        after, following = request.after, request.following
        self._drag(request.point)
        self._hand.let_go(node.squeeze, following.squeeze)
        release_s = lap.lap()
        if after.outcome is not None or (following.pushes and not after.again):
            self._hand.retreat()
            self._hand.jaws.open(following.squeeze)
        else:
            self._hand.rise()
        self._phases.append(Phases(push_s, travel_s, lower_s, close_s, release_s, lap.lap()))
        return request

    def _push(self, part: int, approach: program.Approach) -> None:
        node, index = approach.node, approach.index
        for push in node.pushes:
            self._console.phase(part, Phase.PUSH, index)
            self._hand.retreat()
            self._hand.jaws.set_to(push, node.squeeze)
            self._hand.travel(*placement(push))
            # From here on the part may have been moved: a resumed run has to restart it.
            document = {"part": part, "number": approach.number, "node": index}
            self._cell.journal.record("pushing", document)
            self._hand.push(push)
        if node.pushes:
            self._hand.retreat()
            self._hand.jaws.open(node.squeeze)

    def _travel(self, part: int, index: int, squeeze: Squeeze, *, first: bool) -> float:
        """Moves above the place of a squeeze, and opens the jaws for it; returns the hand's angle, rad."""
        self._console.phase(part, Phase.PLACE, index)
        if first:
            self._hand.retreat()
        else:
            self._hand.rise()
        self._hand.jaws.set_out(squeeze, fast=True)
        x_mm, y_mm, angle_rad = placement(squeeze)
        angle_rad = self._hand.turn_to(x_mm, y_mm, angle_rad, first=first)
        self._hand.travel(x_mm, y_mm, angle_rad, to_squeeze=True)
        self._hand.jaws.open(squeeze)
        return angle_rad

    def _drag(self, point: Place | None) -> None:
        """Drags the held part to `point`; None: does nothing."""
        if point is not None:
            self._hand.slide(point.x_um / 1000, point.y_um / 1000)

    def _free(self, part: int, broken: Replay) -> None:
        """Releases the part that the hand may still hold since a run broke off, and retreats.

        If that run would have dragged the part before the release, the part is dragged first.
        """
        self._console.phase(part, Phase.RESUME, broken.traversal.node)
        try:
            self._hand.await_stillness()
        except GripperStateError as error:
            raise BrokenRunError(f"{error} (the part may still be between the fingers)") from error
        pending = recovery.pending(broken, self._program.table, self._hand)
        if pending is None:
            return
        node, branch = pending
        self._drag(node.release_point(branch))
        self._hand.release(node.squeeze)
        self._cell.journal.record("freed", {"part": part})
        self._hand.retreat()

    def _finish(self, result: PartResult) -> PartResult:
        """Audits and delivers a part that ended at a leaf; returns the result with verdict and delivery.

        A part that the audit refutes is not delivered. The result of any other part is returned unchanged.
        """
        if result.outcome is not Outcome.LEAF or result.leaf is None:
            return result
        leaf = self._program.table.leaves[result.leaf]
        if self._cell.auditor is not None:
            self._console.phase(result.part, Phase.AUDIT, None)
            name = self._program.table.name_of(leaf)
            answer = self._cell.auditor.judge(result.part, predicted_pose(leaf), name)
            result = replace(result, audit=str(answer["verdict"]))
            self._cell.journal.record("audit", {**answer, "part": result.part})
        places = self._options.delivery
        delivery = None if places is None else places.of(leaf.hypothesis)
        if delivery is not None and result.audit == REFUTED:
            # The fingers would close beside the part, or on it.
            result = result.delivered("the audit refutes the pose")
            refused = {"part": result.part, "begun": False, "missed": result.reason}
            self._cell.journal.record("delivery", refused)
        elif delivery is not None:
            self._console.phase(result.part, Phase.DELIVER, None)
            # Includes the pose, which is the answer even if the delivery fails.
            pose = {"x_um": leaf.x_um, "y_um": leaf.y_um, "theta_urad": leaf.theta_urad}
            document = {"part": result.part, "begun": True, "leaf": result.leaf, **pose}
            self._cell.journal.record("delivery", document)
            self._found = result.leaf
            missed = deliver(self._hand, delivery, leaf, self._program.table)
            result = result.delivered(missed)
            ended = {"part": result.part, "begun": False, "missed": missed}
            self._cell.journal.record("delivery", ended)
        return result

    def _end(self, part: int, outcome: Outcome, reason: str, error: BaseException) -> PartResult:
        """Brings the cell into the safe state after a fault or a stop; journals and returns the result."""
        self._console.phase(part, Phase.SAFE, None)
        cell, limits, known = self._cell, self._program.table.limits, self._hand.arm_known
        notes = reach_safe_state(cell.gripper, cell.arm, limits, arm_known=known)
        result = PartResult.of(part, outcome, self._steps, reason)
        return self._ended(replace(result, exit_code=exit_code_of(error)), notes)

    def _ended(self, result: PartResult, notes: Sequence[str]) -> PartResult:
        """Journals the result of a fault, a stop or an abort, and returns it with `notes` as `safe_state`.

        If the journal cannot be written, `safe_state` of the returned result says so.
        """
        result = replace(result, leaf=self._found, safe_state=tuple(notes))
        try:
            self._cell.journal.record("outcome", outcome_fields(self._program.table, result))
        except ExpectedError as error:
            return replace(result, safe_state=(*result.safe_state, f"not journalled: {error}"))
        return result
