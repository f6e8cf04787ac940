"""Converts the gripper and the cell of a job to records of a decision table: limits, gripper, time model."""

import json

from planner.job.model import Job
from runtime.table import Area, GripperSpec, Limits, Timing


def limits_of(job: Job, depth: int) -> Limits:
    """Returns the limits of a job's cell as a table states them.

    `depth` is the number of squeezes on the table's longest path.
    """
    cell = job.cell
    (x_min, y_min), (x_max, y_max) = cell.work_area_mm
    return Limits(
        max_depth=depth,
        max_force_mn=round(1e3 * job.gripper.profile.force_n[1]),
        max_speed_um_s=round(1e3 * cell.max_speed_mm_s),
        work_area_um=Area(
            round(1e3 * x_min), round(1e3 * y_min), round(1e3 * x_max), round(1e3 * y_max)
        ),
        retreat_height_um=round(1e3 * cell.retreat_height_mm),
        squeeze_height_um=round(1e3 * cell.squeeze_height_mm),
        arm_speed_um_s=round(1e3 * cell.arm_speed_mm_s),
    )


def gripper_of(job: Job) -> GripperSpec:
    """Returns the gripper of a job as a table states it: its profile, and the size of the fingers."""
    gripper = job.gripper
    fingers = (gripper.finger_length_mm, gripper.finger_width_mm)
    return GripperSpec.of(gripper.profile, *(round(1e3 * size) for size in fingers))


def timing_of(job: Job) -> Timing:
    """Returns the model of the time that motions take in the cell of a job.

    Raises:
        TableError: the gripper is unknown, or the cell's figures are impossible.
    """
    return Timing.of(limits_of(job, 1), gripper_of(job), json.loads(job.canonical()))
