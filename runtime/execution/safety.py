"""Checks before every motion: the table, the gripper, the target, the place reached."""

from math import hypot, isfinite, remainder, tau

from drivers.ports import Arm, Gripper, GripperState, PoseOfHand, Settled
from runtime.errors import GripperStateError, MotionRefusedError, TableError
from runtime.table import Limits, Table
from runtime.table.geometry import MOST_TURNS, end_of, placement, sent

# Largest distance of an arm, by its own reading, from where it was sent; beyond, it was displaced.
PLACED_MM = 0.5
PLACED_RAD = 0.01


def check_table(table: Table) -> None:
    """Checks that the gripper can execute the table, before anything is connected.

    Raises:
        TableError: a speed or force lies outside the gripper's range; the message names the first such node.
    """
    gripper = table.gripper
    slowest, fastest = gripper.least_speed_um_s, gripper.most_speed_um_s
    weakest, strongest = gripper.least_force_mn, gripper.most_force_mn
    for index, node in enumerate(table.nodes):
        speed, force = node.squeeze.speed_um_s, node.squeeze.force_mn
        if not slowest <= speed <= fastest:
            raise TableError(
                f"node {index} closes at {speed / 1000:g} mm/s; the gripper does "
                f"{slowest / 1000:g}..{fastest / 1000:g}, change gripper.speed_mm_s and recompile"
            )
        if not weakest <= force <= strongest:
            raise TableError(
                f"node {index} squeezes with {force / 1000:g} N; the gripper does "
                f"{weakest / 1000:g}..{strongest / 1000:g}, change gripper.force_n and recompile"
            )


def needs_activation(state: GripperState) -> bool:
    """Whether the gripper needs an activation, which clears faults, before it can move."""
    return not state.activated or state.fault != 0


def ready_gripper(gripper: Gripper, asked_um: int | None = None) -> GripperState:
    """Reads the gripper, and checks that gripper and arm may be moved; returns the gripper's state.

    A gripper that still moves to `asked_um`, the last request of this run, is ready, too.

    Raises:
        GripperStateError: the gripper is not activated, is in fault, or moves without a request.
    """
    state = gripper.state()
    if state.fault:
        raise GripperStateError(
            f"the gripper reports fault {state.fault_text}; remove the cause, then start again "
            "with --activate"
        )
    if not state.activated:
        raise GripperStateError(
            "the gripper is not activated; clear the space between the fingers, "
            "then start again with --activate"
        )
    if state.moving and state.target_um != asked_um:
        raise GripperStateError(
            "the gripper moves without having been asked to; who else commands it?"
        )
    return state


def stroke(
    gripper: Gripper, width_um: int, speed_mm_s: float, force_n: float, asked_um: int | None = None
) -> Settled:
    """Moves the jaws of a gripper that is ready, and waits until they have settled.

    The jaws may still move to `asked_um`, see `ready_gripper`.

    Raises:
        GripperStateError: the gripper is not ready.
    """
    ready_gripper(gripper, asked_um)
    gripper.move(width_um, speed_mm_s, force_n)
    return gripper.wait()


def check_target(pose: PoseOfHand, limits: Limits) -> None:
    """Checks that a target of the arm lies within the table's limits.

    Raises:
        MotionRefusedError: the target is not a number, lies outside the work area or the planned heights, or
            has an angle of too many turns.
    """
    x_mm, y_mm, z_mm, angle_rad = pose
    area = limits.work_area_um
    if not all(isfinite(value) for value in pose):
        raise MotionRefusedError(f"the arm was to be sent to {pose}, which is no place")
    if not area.contains(x_mm, y_mm):
        raise MotionRefusedError(
            f"({x_mm:.2f}, {y_mm:.2f}) mm is outside the work area "
            f"x {area.x_min / 1000:g}..{area.x_max / 1000:g}, "
            f"y {area.y_min / 1000:g}..{area.y_max / 1000:g} mm"
        )
    if not limits.squeeze_height_um / 1000 <= z_mm <= limits.retreat_height_um / 1000:
        raise MotionRefusedError(
            f"height {z_mm:.2f} mm is outside {limits.squeeze_height_um / 1000:g} (squeeze) to "
            f"{limits.retreat_height_um / 1000:g} mm (retreat)"
        )
    if abs(angle_rad) > MOST_TURNS * tau:
        raise MotionRefusedError(f"angle {angle_rad:.3f} rad is more than {MOST_TURNS} whole turns")


def check_places(table: Table, middle_mm: float) -> None:
    """Checks that the arm stays within the table's limits when the fingers meet at each place of the table.

    Args:
        table: the table.
        middle_mm: distance from the hand's middle at which the fingers meet.

    Raises:
        MotionRefusedError: a place to which the arm would be sent lies outside the work area.
    """
    limits = table.limits
    for node in table.nodes:
        ends = [end for push in node.pushes for end in (placement(push), end_of(push))]
        released = [node.release_point(k) for k in range(len(node.branches))]
        places = {placement(node.squeeze, point) for point in (None, *released)}
        for x_mm, y_mm, angle_rad in (sent(place, middle_mm) for place in (*places, *ends)):
            for height_um in (limits.squeeze_height_um, limits.retreat_height_um):
                check_target((x_mm, y_mm, height_um / 1000, angle_rad), limits)


def check_placed(arm: Arm, target: PoseOfHand) -> PoseOfHand:
    """Reads the arm and checks that it stands where it was sent, with the hand at the requested angle.

    Returns:
        The place where the arm stands.

    Raises:
        MotionRefusedError: the arm stands elsewhere, so that nothing may be moved next.
    """
    pose = x_mm, y_mm, z_mm, angle_rad = arm.pose()
    off_mm = hypot(x_mm - target[0], y_mm - target[1], z_mm - target[2])
    off_rad = abs(remainder(angle_rad - target[3], tau))
    # Written so that a reading that is not a number fails, too.
    if not (off_mm <= PLACED_MM and off_rad <= PLACED_RAD):
        raise MotionRefusedError(
            f"the arm stands {off_mm:.2f} mm and {off_rad:.3f} rad off the place it was sent to; "
            "find out what moved it, and check the controller before the next run"
        )
    return pose
