"""The proof of everything about a table but its tree: gripper, goal, limits, the embedded job."""

import hashlib

from runtime.errors import TableError
from runtime.table_model import KINDS, MAX_DEPTH, PPM, GoalSpec, GripperSpec, Limits, Table

MAX_MODES = 64


def prove_header(table: Table) -> None:
    """Check everything about a table but its tree.

    Raises:
        TableError: a field is of the wrong type or out of range, or the job is not the one of the digest.
    """
    text("tool", table.tool)
    if not isinstance(table.job_digest, bytes) or len(table.job_digest) != 32:
        raise TableError("job_digest is not 32 bytes")
    if table.job is not None:
        text("job", table.job)
        if hashlib.sha256(table.job.encode()).digest() != table.job_digest:
            raise TableError("the embedded job is not the one the table was made from; recompile it")
    prove_gripper(table.gripper)
    _prove_goal(table.goal)
    predicted = table.predicted
    within("predicted.success_ppm", predicted.success_ppm, 0, PPM)
    within("predicted.trials", predicted.trials, 0)
    within("predicted.mean_squeezes_ppm", predicted.mean_squeezes_ppm, 0, MAX_DEPTH * PPM)
    within("predicted.reject_ppm", predicted.reject_ppm, 0, PPM)
    _prove_limits(table.limits)


def text(name: str, value: object) -> None:
    """Check that a field is text.

    Raises:
        TableError: it is not.
    """
    if not isinstance(value, str):
        raise TableError(f"{name} is {value!r}, not text")


def integer(name: str, value: object) -> None:
    """Check that a field is an integer; a truth value is none, and neither is a numpy number.

    Raises:
        TableError: it is not.
    """
    if type(value) is not int:
        raise TableError(f"{name} is {value!r} of type {type(value).__name__}, not an integer")


def within(name: str, value: int, least: int, most: int | None = None) -> None:
    """Check that a field is an integer in its range.

    Raises:
        TableError: it is not.
    """
    integer(name, value)
    if value < least or (most is not None and value > most):
        allowed = f"at least {least}" if most is None else f"{least}..{most}"
        raise TableError(f"{name} is {value}, allowed is {allowed}")


def prove_gripper(gripper: GripperSpec) -> None:
    """Check the gripper: lengths, and counts that rise as it closes.

    Raises:
        TableError: a field is of the wrong type or out of range.
    """
    text("gripper.model", gripper.model)
    within("gripper.opening_um", gripper.opening_um, 1, 1_000_000)
    within("gripper.finger_length_um", gripper.finger_length_um, 1, 1_000_000)
    within("gripper.finger_width_um", gripper.finger_width_um, 1, 1_000_000)
    within("gripper.count_closed", gripper.count_closed, 1, 255)
    within("gripper.count_open", gripper.count_open, 0, gripper.count_closed - 1)
    within("gripper.encoder_noise_um", gripper.encoder_noise_um, 0, gripper.opening_um)


def _prove_goal(goal: GoalSpec) -> None:
    if goal.kind not in KINDS:
        raise TableError(f"goal.kind is {goal.kind!r}, allowed are {', '.join(KINDS)}")
    measured = goal.kind in ("pose", "modes")
    within("goal.distance_um", goal.distance_um, 1 if measured else 0)
    within("goal.confidence_ppm", goal.confidence_ppm, 0, PPM)
    within("goal.rho_um", goal.rho_um, 0)
    within("goal.symmetry", goal.symmetry, 1, 1000)
    within("goal.modes", goal.modes, 1, MAX_MODES)
    if not isinstance(goal.tolerance, tuple) or len(goal.tolerance) != 3:
        raise TableError("goal.tolerance is not x, y, theta")
    shifts, turns = goal.kind == "tolerances", not measured
    for name, value, needed in zip(("x", "y", "theta"), goal.tolerance, (shifts, shifts, turns), strict=True):
        within(f"goal.tolerance {name}", value, int(needed))


def _prove_limits(limits: Limits) -> None:
    within("limits.max_depth", limits.max_depth, 1, MAX_DEPTH)
    within("limits.max_force_mn", limits.max_force_mn, 1)
    within("limits.max_speed_um_s", limits.max_speed_um_s, 1)
    within("limits.arm_speed_um_s", limits.arm_speed_um_s, 1)
    area = limits.work_area_um
    if not isinstance(area, tuple) or len(area) != 4:
        raise TableError("limits.work_area_um is not x min, y min, x max, y max")
    for name, value in zip(("x min", "y min", "x max", "y max"), area, strict=True):
        integer(f"limits.work_area_um {name}", value)
    if area[0] >= area[2] or area[1] >= area[3]:
        raise TableError(f"limits.work_area_um is empty: {area}")
    integer("limits.squeeze_height_um", limits.squeeze_height_um)
    within("limits.retreat_height_um", limits.retreat_height_um, limits.squeeze_height_um + 1)
