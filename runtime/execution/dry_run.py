"""Describes what a run would send to the devices, without sending it."""

from collections.abc import Iterator
from math import degrees

from drivers.ports import Arm, Gripper
from runtime.execution import carry, held, safety, strokes
from runtime.execution.executor import RunOptions
from runtime.table import Schedule, Table, job_of, may_turn
from runtime.table.geometry import end_of, placement, pose_text, sent


def tell(table: Table, gripper: Gripper, arm: Arm, options: RunOptions) -> Iterator[str]:
    """Reads both devices, and yields sentences that state what a run would send to them.

    The sentences describe the present state of each device, each push and squeeze at every node of the table,
    and each delivery. The devices must be connected over links that cannot write.

    Raises:
        MotionRefusedError: a run would refuse to go to a place of the table, or to deliver from a leaf.
    """
    handling = options.handling
    calibration = handling.widths(table)
    timing = Schedule.of(table, job_of(table)).timing
    seen, pose = gripper.state(), arm.pose()
    width_mm = calibration.width_um(seen.width_um) / 1000
    activity = "active" if seen.activated else "NOT ACTIVE"
    fault = f"fault {seen.fault_text}" if seen.fault else "no fault"
    yield f"gripper: {activity}, {fault}, {width_mm:.2f} mm open"
    yield f"arm: at ({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f}) mm, {degrees(pose[3]):.1f} deg"
    if (holds := held.look(seen, calibration)) is not None:
        yield f"{holds.sentence()}; a run would be refused"
    if handling.middle_mm:
        yield (
            f"the fingers meet {handling.middle_mm:+.2f} mm off the hand's middle, along its y: "
            "the arm is sent as far beside every place"
        )
    turns = options.turns and options.delivery is None
    if turns and may_turn(table, job_of(table), handling.middle_mm):
        yield (
            "the plan of each part is turned about the origin to the angle at which the hand stands then: "
            "the places below are those of no turn"
        )
    safety.check_places(table, handling.middle_mm)
    low_mm = table.limits.squeeze_height_um / 1000
    for index, node in enumerate(table.nodes):
        for push in node.pushes:
            start = pose_text(sent(placement(push), handling.middle_mm))
            x_mm, y_mm, _ = sent(end_of(push), handling.middle_mm)
            opening_mm = calibration.nearest_um(push.opening_um) / 1000
            yield (
                f"node {index}, before: jaws to {opening_mm:.2f} mm, push from {start}, to ({x_mm:.2f}, "
                f"{y_mm:.2f}) mm at {push.speed_um_s / 1000:g} mm/s"
            )
        place = pose_text(sent(placement(node.squeeze), handling.middle_mm))
        open_mm = node.squeeze.opening_um / 1000
        plan_of_jaws = strokes.closing(node, handling, calibration, open_mm, timing)
        forces = strokes.raising(node.squeeze, handling, calibration.profile)
        plan_of_jaws += [plan_of_jaws[-1]._replace(force_n=force) for force in forces]
        requests = [
            f"{max(s.request_um, 0) / 1000:.2f} mm at {s.speed_mm_s:.0f} mm/s with {s.force_n:.0f} N"
            for s in plan_of_jaws
        ]
        yield (
            f"node {index}: open to {calibration.opening_um(node.squeeze.opening_um) / 1000:.2f} mm, "
            f"hand to {place}, down to {low_mm:g} mm, close to {', '.join(requests)}"
        )
    if options.delivery is not None:
        carry.check(options.delivery, table, arm, handling.middle_mm)
        for part, delivery in options.delivery.each():
            yield f"delivery: {part} from every leaf to {pose_text(delivery.drop)}"
