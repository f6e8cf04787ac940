"""The loop of the cell: place, squeeze, read, descend in the tree, until the part's outcome is known.

Pure logic over the Protocols of `runtime.ports`: no import of a driver, no file, no clock of its own. Any
fault and any Ctrl-C end in `runtime.safe_state` and in a terminal outcome.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple, Protocol

from runtime import safety
from runtime.errors import CellError, GripperStateError
from runtime.ports import Arm, Clock, Gripper, Journal, Pose, Settled
from runtime.results import Outcome, PartResult, Step
from runtime.safe_state import reach_safe_state
from runtime.table import REJECT, Calibration, Node, Squeeze, Table, count_map

# How much longer than stroke and path take at the commanded speeds one squeeze may last.
DEADLINE_FACTOR = 3.0
# Nearer than this to the retreat height the arm counts as retreated.
LEVEL_MM = 0.05


class Observer(Protocol):
    """Sees each squeeze when it is decided; must not raise."""

    def __call__(self, part: int, step: Step) -> None:
        """One squeeze of one part."""


@dataclass(frozen=True, slots=True)
class Cell:
    """The devices and records one executor works with."""

    gripper: Gripper
    arm: Arm
    clock: Clock
    journal: Journal


class Decision(NamedTuple):
    """What a reading means at a node: the branch taken, or `REJECT` and the reason."""

    branch: int
    reason: str | None


def decide(node: Node, outcomes: tuple[int, ...], count: int, object_flag: int) -> Decision:
    """What a settled reading means at a node; nothing is inferred.

    Args:
        node: the node.
        outcomes: its 256-entry map from `count_map`.
        count: settled encoder count, 0..255.
        object_flag: settled object flag, 1..3.

    Returns:
        The branch, or `REJECT` with its reason: nothing between the fingers, or a width nobody planned for.

    Raises:
        GripperStateError: the flag contradicts a closing motion.
    """
    if object_flag == safety.ARRIVED:
        return Decision(REJECT, "the fingers closed on nothing")
    if object_flag != safety.CLOSING_CONTACT:
        raise GripperStateError(
            f"object flag {object_flag} after a closing motion; the reading is not believed"
        )
    if outcomes[count] == REJECT:
        widths = ", ".join(f"{b.low_um / 1000:.2f}..{b.high_um / 1000:.2f}" for b in node.branches)
        return Decision(REJECT, f"no outcome of this squeeze has this width (planned: {widths} mm)")
    return Decision(outcomes[count], None)


class Executor:
    """Executes one table with one cell.

    Args:
        table: the table, proved.
        cell: the devices, connected and not yet moved.
        observe: called after each squeeze.

    Raises:
        TableError: the gripper cannot do what the table asks.
    """

    def __init__(self, table: Table, cell: Cell, observe: Observer) -> None:
        safety.check_table(table)
        self._table = table
        self._cell = cell
        self._observe = observe
        self._calibration = Calibration.linear(table.gripper)
        self._maps = [count_map(node, self._calibration) for node in table.nodes]
        # Whether the arm stands where its last acknowledged motion left it.
        self._arm_known = True

    def run_part(self, part: int) -> PartResult:
        """Squeeze one part until its outcome is known.

        Args:
            part: its number, for the journal.

        Returns:
            The outcome; LEAF, REJECT and UNRESOLVED leave the jaws open above the part, FAULT and STOPPED
            leave the declared safe state.

        Raises:
            Exception: an error that no device makes is a bug, and raised once the safe state is reached.
        """
        steps: list[Step] = []
        try:
            self._cell.journal.record("part", {"part": part})
            result = self._descend(part, steps)
            self._cell.journal.record("outcome", {"part": part, **result.fields()})
        except KeyboardInterrupt:
            return self._end(part, steps, Outcome.STOPPED, "stopped by the operator")
        except Exception as error:
            fault = self._end(part, steps, Outcome.FAULT, str(error), _exit_code(error))
            if not _is_expected(error):
                raise
            return fault
        return result

    def _descend(self, part: int, steps: list[Step]) -> PartResult:
        target = 0
        while target >= 0:
            step = self._squeeze_at(target, len(steps) + 1, part)
            steps.append(step)
            self._observe(part, step)
            if step.target is None:
                return PartResult.of(part, Outcome.REJECT, steps, step.reason)
            target = step.target
        leaf = self._table.leaves[~target]
        if leaf.resolved:
            return PartResult.of(part, Outcome.LEAF, steps, None)
        reason = f"leaf {~target} is not resolved: the table cannot tell the pose well enough"
        return PartResult.of(part, Outcome.UNRESOLVED, steps, reason)

    def _squeeze_at(self, index: int, number: int, part: int) -> Step:
        node = self._table.nodes[index]
        deadline = self._cell.clock.deadline(DEADLINE_FACTOR * self._expected_s(node.squeeze))
        reading = self._placed_reading(node.squeeze)
        decision = decide(node, self._maps[index], reading.position_counts, reading.object_flag)
        target = None if decision.branch == REJECT else node.branches[decision.branch].target
        step = Step(
            number=number,
            node=index,
            squeeze=node.squeeze,
            position_counts=reading.position_counts,
            width_um=self._calibration.width_um(reading.position_counts),
            target=target,
            reason=decision.reason,
        )
        # Before anything moves on: a decision that is not on the disk was never taken.
        self._cell.journal.record("squeeze", {"part": part, **step.fields(), **_reading_fields(reading)})
        self._release(node.squeeze)
        if (late_s := self._cell.clock.now() - deadline) > 0:
            raise GripperStateError(f"one squeeze ended {late_s:.1f} s late; check arm and gripper speed")
        return step

    def _placed_reading(self, squeeze: Squeeze) -> Settled:
        """Retreat, open, travel, descend, close; the settled reading of the closing motion."""
        self._retreat()
        self._open(squeeze)
        x_mm, y_mm, angle_rad = squeeze.x_um / 1000, squeeze.y_um / 1000, squeeze.angle_urad / 1e6
        limits = self._table.limits
        self._travel((x_mm, y_mm, limits.retreat_height_um / 1000, angle_rad))
        self._travel((x_mm, y_mm, limits.squeeze_height_um / 1000, angle_rad))
        reading = self._jaws(safety.CLOSED_COUNTS, squeeze)
        safety.check_fresh(reading, safety.CLOSED_COUNTS)
        return reading

    def _release(self, squeeze: Squeeze) -> None:
        self._open(squeeze)
        self._retreat()

    def _open(self, squeeze: Squeeze) -> None:
        request = safety.opening_counts(squeeze.opening_um, self._calibration)
        safety.check_opened(self._jaws(request, squeeze), request, self._calibration)

    def _jaws(self, position_counts: int, squeeze: Squeeze) -> Settled:
        safety.ready_gripper(self._cell.gripper)
        self._cell.gripper.move(
            position_counts, safety.speed_counts(squeeze.speed_um_s), safety.force_counts(squeeze.force_mn)
        )
        return self._cell.gripper.wait()

    def _retreat(self) -> None:
        """Go straight up, from wherever the arm stands; nothing to do if it is up already."""
        safety.ready_gripper(self._cell.gripper)
        self._arm_known = False  # until it answers
        x_mm, y_mm, z_mm, angle_rad = self._cell.arm.pose()
        self._arm_known = True
        height_mm = self._table.limits.retreat_height_um / 1000
        if z_mm < height_mm - LEVEL_MM:
            self._move_arm((x_mm, y_mm, height_mm, angle_rad))

    def _travel(self, target: Pose) -> None:
        safety.check_target(target, self._table.limits)
        safety.ready_gripper(self._cell.gripper)
        self._move_arm(target)

    def _move_arm(self, target: Pose) -> None:
        self._arm_known = False  # until the motion is acknowledged; an interrupt leaves it so
        self._cell.arm.move_linear(*target, self._table.limits.arm_speed_um_s / 1000)
        safety.check_placed(self._cell.arm, target)
        self._arm_known = True

    def _expected_s(self, squeeze: Squeeze) -> float:
        """Cell seconds of the longest way there is: across the work area, up and down, three strokes."""
        limits = self._table.limits
        x_min, y_min, x_max, y_max = limits.work_area_um
        path_um = hypot(x_max - x_min, y_max - y_min)
        path_um += 3 * (limits.retreat_height_um - limits.squeeze_height_um)
        return path_um / limits.arm_speed_um_s + 3 * self._table.gripper.opening_um / squeeze.speed_um_s

    def _end(
        self, part: int, steps: list[Step], outcome: Outcome, reason: str, exit_code: int | None = None
    ) -> PartResult:
        notes = reach_safe_state(
            self._cell.gripper, self._cell.arm, self._table.limits, arm_known=self._arm_known
        )
        result = PartResult.of(part, outcome, steps, reason, exit_code=exit_code, safe_state=tuple(notes))
        return _journalled(result, lambda: self._cell.journal.record("outcome", result.fields()))


def _journalled(result: PartResult, write: Callable[[], None]) -> PartResult:
    """Record a fault's result; a journal that fails now is told in the result instead of hiding the fault."""
    try:
        write()
    except CellError as error:
        return result.noting(f"not journalled: {error}")
    return result


def _reading_fields(reading: Settled) -> dict[str, object]:
    return {
        "object_flag": reading.object_flag,
        "echo_counts": reading.echo_counts,
        "current_ma": reading.current_ma,
        "settle_s": round(reading.seconds, 4),
    }


def _is_expected(error: Exception) -> bool:
    return hasattr(error, "exit_code") or isinstance(error, TimeoutError | ConnectionError | OSError)


def _exit_code(error: Exception) -> int:
    code = getattr(error, "exit_code", None)
    if isinstance(code, int):
        return code
    return 20 if isinstance(error, TimeoutError | ConnectionError | OSError) else 1
