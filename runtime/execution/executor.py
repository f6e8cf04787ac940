"""The loop of the cell: place, squeeze, read, descend in the tree, until the part's outcome is known.

What a reading means and what follows is `decision`'s, how the hand moves `hand`'s. Any fault and any Ctrl-C
end in `safe_state` and in a terminal outcome.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import hypot, tau

from drivers.ports import Arm, Gripper, Settled
from runtime.devices.audit import AuditProcess, answer_of
from runtime.devices.clock import Lap, SystemClock
from runtime.errors import BrokenRunError, GripperStateError
from runtime.execution import recovery, safety
from runtime.execution.carry import deliver
from runtime.execution.delivery import Delivery, Sorting
from runtime.execution.events import Console, Phase
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.execution.reading import reading_fields
from runtime.execution.safe_state import reach_safe_state
from runtime.execution.watch import MACHINE, Expected
from runtime.journal.chain import Journal
from runtime.journal.replay import Replay
from runtime.shell import interrupts
from runtime.shell.errors import ExpectedError, exit_code_of, is_expected
from runtime.table import (
    REJECT,
    Node,
    Phases,
    Schedule,
    Squeeze,
    Table,
    decision_map,
    job_of,
    predicted_pose,
    turned,
)
from runtime.traversal.answer import outcome_fields
from runtime.traversal.decision import (
    Decision,
    Policy,
    TraversalState,
    advance,
    decide,
    release_point,
    step_of,
)
from runtime.traversal.geometry import placement
from runtime.traversal.results import Outcome, PartResult, Step


@dataclass(frozen=True, slots=True)
class Cell:
    """The devices and records one executor works with; an auditor where there is one."""

    gripper: Gripper
    arm: Arm
    clock: SystemClock
    journal: Journal
    auditor: AuditProcess | None = None


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What a run does besides what its table says; without a delivery a localised part stays in place."""

    policy: Policy = field(default_factory=Policy)
    handling: Handling = field(default_factory=Handling)
    delivery: Delivery | Sorting | None = None
    patience: float = (
        1.0  # how much longer than by arm and gripper a squeeze may take: for a person
    )
    takt_s: float | None = None  # within which parts should be done; only told
    turns: bool = (
        True  # whether a part's plan may be turned to where the hand stands: not for a person
    )
    timed: bool = (
        True  # whether the clock's seconds are the cell's, which runs no faster than its programs
    )


PLAIN = RunOptions()


class Executor:
    """Executes one valid table with one cell, connected and not yet moved.

    Raises:
        TableError: the gripper cannot do what the table asks.
    """

    def __init__(
        self, table: Table, cell: Cell, console: Console, options: RunOptions = PLAIN
    ) -> None:
        safety.check_table(table)
        self._plan = self._table = table  # as planned, and as turned for the part under way
        self._console = console
        self._options = options
        self._found: int | None = None  # the leaf of the part that is being delivered
        self._phases: list[Phases] = []  # of the part's squeezes so far
        self._hand = Hand(cell.gripper, cell.arm, cell.clock, table, options.handling)
        self._cell = replace(cell, journal=self._hand.watch.watched(cell.journal, MACHINE))
        self._slowest_um_s = table.gripper.least_speed_um_s
        self._maps = [decision_map(node, table.gripper) for node in table.nodes]

    def run_part(self, part: int, broken: Replay | None = None) -> PartResult:
        """Squeeze one part until its outcome is known, or go on with it where a run broke off.

        Returns:
            The outcome; LEAF, REJECT and UNRESOLVED leave the jaws open above the part, FAULT and STOPPED
            leave the declared safe state.

        Raises:
            Exception: an error that no device makes is a bug, and raised once the safe state is reached.
        """
        steps: list[Step] = []
        self._found, began = None, Lap(self._cell.clock)
        try:
            if broken is None:
                self._cell.journal.record("part", {"part": part})
            with interrupts.stoppable():
                turn_urad = self._turned(part, broken)
                if broken is not None:
                    steps.extend(broken.steps)
                    self._free(part, broken)
                result = self._descend(
                    part, steps, TraversalState() if broken is None else broken.traversal
                )
                result = replace(self._finish(result), turn_urad=turn_urad)
                self._hand.where()  # an arm that was displaced makes any outcome a fault
                if self._options.timed:
                    result = replace(result, seconds=began.lap(), phases=tuple(self._phases))
            self._cell.journal.record("outcome", outcome_fields(self._table, result))
        except BrokenRunError as error:
            # Nothing was moved; the operator looks at the fingers.
            notes = ("nothing was moved",)
            return self._ended(
                PartResult.of(part, Outcome.ABORTED, steps, str(error), safe_state=notes)
            )
        except KeyboardInterrupt:
            return self._end(part, steps, Outcome.STOPPED, "stopped by the operator")
        except Exception as error:
            fault = self._end(part, steps, Outcome.FAULT, str(error), exit_code_of(error))
            if not is_expected(error):
                raise
            return fault
        self._console.phase(part, Phase.DONE, None)
        return result

    def _turned(self, part: int, broken: Replay | None) -> int:
        """Turn the plan for a part to where the hand stands, or as a run that broke off had it; by what.

        Not where parts are delivered: the ways to the drop-off are checked for the leaves as planned.
        """
        turn_urad = 0
        if broken is not None:
            turn_urad = broken.turn_urad
        elif self._options.turns and self._options.delivery is None:
            turn_urad = round(1e6 * self._hand.turn_of_plan(self._plan.nodes[0].squeeze))
            if turn_urad:
                self._cell.journal.record("turned", {"part": part, "turn_urad": turn_urad})
        self._table = turned(self._plan, turn_urad)
        return turn_urad

    def _descend(self, part: int, steps: list[Step], traversal: TraversalState) -> PartResult:
        self._phases.clear()
        while traversal.outcome is None:
            node = self._table.nodes[traversal.node]
            expected = expected_of(self._table, node, self._slowest_um_s)
            with self._hand.watch.squeeze(expected, self._options.patience):
                step, traversal = self._squeeze(part, traversal, len(steps) + 1)
            steps.append(step)
            self._console.step(part, step)
        return PartResult.of(part, traversal.outcome, steps, reason_of(traversal, steps))

    def _squeeze(
        self, part: int, traversal: TraversalState, number: int
    ) -> tuple[Step, TraversalState]:
        """One squeeze, from the hand above the part to the hand above the part; and what follows."""
        index, table = traversal.node, self._table
        node, began = table.nodes[index], Lap(self._cell.clock)
        if not traversal.again:
            self._push(part, number, index, node)
        push_s = began.lap()
        angle_rad = self._travel(part, index, node.squeeze, first=number == 1)
        travel_s = began.lap()
        self._hand.descend(*placement(node.squeeze)[:2], angle_rad)
        lower_s = began.lap()
        # Before the part is touched: who resumes this run has to know that it may have been.
        self._cell.journal.record("placed", {"part": part, "number": number, "node": index})
        self._console.phase(part, Phase.SQUEEZE, index)
        reading, decision = self._read(node, index)
        self._console.phase(part, Phase.READ, index)
        step = step_of(decision, number, index, reading.width_um, self._hand.calibration)
        # Before anything moves on: a decision that is not on the disk was never taken.
        self._cell.journal.record(
            "squeeze", {"part": part, **step.fields(), **reading_fields(reading)}
        )
        close_s = began.lap()
        self._console.phase(part, Phase.RELEASE, index)
        after = advance(traversal, step.target, table, self._options.policy)
        following = table.nodes[0 if after.outcome is not None else after.node]
        self._drag(node, decision.branch)
        self._hand.let_go(node.squeeze, following.squeeze)
        release_s = began.lap()
        if after.outcome is not None or (following.pushes and not after.again):
            self._hand.retreat()
            self._hand.open(following.squeeze)
        else:
            self._hand.rise()
        self._phases.append(Phases(push_s, travel_s, lower_s, close_s, release_s, began.lap()))
        return step, after

    def _read(self, node: Node, index: int) -> tuple[Settled, Decision]:
        """Close the jaws and decide; the force is raised where a reading decides nothing, or for a drag."""
        reading = self._hand.meet(node)
        decision = self._decided(node, index, reading)
        if decision.branch != REJECT and release_point(node, decision.branch) is None:
            return reading, decision
        reading = self._hand.tighten(node, reading)
        return reading, self._decided(node, index, reading)

    def _decided(self, node: Node, index: int, reading: Settled) -> Decision:
        width_um = self._hand.calibration.width_um(reading.width_um)
        return decide(node, self._maps[index], width_um, reading.object)

    def _push(self, part: int, number: int, index: int, node: Node) -> None:
        for push in node.pushes:
            self._console.phase(part, Phase.PUSH, index)
            self._hand.retreat()
            self._hand.set_jaws(push, node.squeeze)
            self._hand.travel(*placement(push))
            # From here on the part may have been moved: who resumes this run has to start it over.
            self._cell.journal.record("pushing", {"part": part, "number": number, "node": index})
            self._hand.push(push)
        if node.pushes:
            self._hand.retreat()
            self._hand.open(node.squeeze)

    def _travel(self, part: int, index: int, squeeze: Squeeze, *, first: bool) -> float:
        """Go above a squeeze's place, the jaws on their way to its opening; the angle of the hand there."""
        self._console.phase(part, Phase.PLACE, index)
        if first:
            self._hand.retreat()
        else:
            self._hand.rise()
        self._hand.set_out(squeeze)
        x_mm, y_mm, angle_rad = placement(squeeze)
        angle_rad = self._hand.turn_to(x_mm, y_mm, angle_rad)
        self._hand.travel(x_mm, y_mm, angle_rad, to_squeeze=True)
        self._hand.open(squeeze)
        return angle_rad

    def _drag(self, node: Node, branch: int) -> None:
        """Take what the jaws hold to where the node wants it let go."""
        target = release_point(node, branch)
        if target is not None:
            self._hand.drag(target.x_um / 1000, target.y_um / 1000)

    def _free(self, part: int, broken: Replay) -> None:
        """Let go of what a run that broke off may still hold, where it holds it."""
        self._console.phase(part, Phase.RESUME, broken.traversal.node)
        try:
            self._hand.await_stillness()
        except GripperStateError as error:
            raise BrokenRunError(f"{error} (the part may still be between the fingers)") from error
        pending = recovery.pending(broken, self._table, self._hand)
        if pending is None:
            return
        node, branch = pending
        self._drag(node, branch)
        self._hand.release(node.squeeze)
        self._cell.journal.record("freed", {"part": part})
        self._hand.retreat()

    def _finish(self, result: PartResult) -> PartResult:
        """At a leaf: ask the auditor, then deliver; other outcomes pass as they are."""
        if result.outcome is not Outcome.LEAF or result.leaf is None:
            return result
        leaf = self._table.leaves[result.leaf]
        pose = predicted_pose(leaf)
        if self._cell.auditor is not None:
            self._console.phase(result.part, Phase.AUDIT, None)
            answer = answer_of(self._cell.auditor, result.part, pose, self._table.name_of(leaf))
            result = replace(result, audit=str(answer["verdict"]))
            self._cell.journal.record("audit", {**answer, "part": result.part})
        places = self._options.delivery
        delivery = None if places is None else places.of(leaf.hypothesis)
        if delivery is not None:
            self._console.phase(result.part, Phase.DELIVER, None)
            # With the pose, which is the answer even where the delivery comes to nothing.
            document = {
                "leaf": result.leaf,
                "x_um": leaf.x_um,
                "y_um": leaf.y_um,
                "theta_urad": leaf.theta_urad,
            }
            self._cell.journal.record("delivery", {"part": result.part, "begun": True, **document})
            self._found = result.leaf
            missed = deliver(self._hand, delivery, leaf, self._table)
            result = result.delivered(missed)
            self._cell.journal.record(
                "delivery", {"part": result.part, "begun": False, "missed": missed}
            )
        return result

    def _end(
        self,
        part: int,
        steps: list[Step],
        outcome: Outcome,
        reason: str,
        exit_code: int | None = None,
    ) -> PartResult:
        self._console.phase(part, Phase.SAFE, None)
        notes = reach_safe_state(
            self._cell.gripper, self._cell.arm, self._table.limits, arm_known=self._hand.arm_known
        )
        result = PartResult.of(
            part, outcome, steps, reason, exit_code=exit_code, safe_state=tuple(notes)
        )
        return self._ended(replace(result, leaf=self._found))

    def _ended(self, result: PartResult) -> PartResult:
        """Record a fault's result; a journal that fails now is noted there instead of hiding the fault."""
        try:
            self._cell.journal.record("outcome", outcome_fields(self._table, result))
        except ExpectedError as error:
            return replace(result, safe_state=(*result.safe_state, f"not journalled: {error}"))
        return result


def expected_of(table: Table, node: Node, slowest_um_s: int) -> Expected:
    """Cell seconds of the longest path: across the work area, a turn, up, down; and of three slow strokes.

    The same for each push, and its way. A stroke may be as slow as the gripper's least speed.
    """
    timing = Schedule.of(table, job_of(table)).timing
    area = table.limits.work_area_um
    across_mm = hypot(area.x_max - area.x_min, area.y_max - area.y_min) / 1e3
    arm_s = timing.move_s(across_mm) + timing.move_s(0.0, tau)
    arm_s += 3 * timing.move_s(timing.retreat_mm - timing.squeeze_mm)
    speed_mm_s = min(node.squeeze.speed_um_s, slowest_um_s) / 1e3
    ways_s = sum(
        timing.move_s(push.length_um / 1e3, 0.0, push.speed_um_s / 1e3) for push in node.pushes
    )
    times = 1 + len(node.pushes)
    strokes_s = 3 * timing.close_s(table.gripper.opening_um / 1e3, None, 0.0, speed_mm_s)
    return Expected(times * arm_s + ways_s, times * strokes_s)


def expected_s(table: Table, node: Node) -> float:
    """Cell seconds of arm and gripper together, of a gripper that is known."""
    return expected_of(table, node, table.gripper.least_speed_um_s).total_s


def reason_of(traversal: TraversalState, steps: Sequence[Step]) -> str | None:
    """Why a part ended in no resolved leaf, None where it did."""
    if traversal.outcome is Outcome.REJECT:
        return steps[-1].reason
    if traversal.outcome is Outcome.UNRESOLVED:
        return f"leaf {traversal.leaf} is not resolved: the table cannot tell the pose well enough"
    return None
