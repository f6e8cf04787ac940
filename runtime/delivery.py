"""What becomes of a localised part: a last grasp at the predicted pose, and a pose to put it down at.

Declared in a job's section `delivery`, in a TOML file of the same keys, or on the command line:

```
drop_mm = [50.0, 0.0]       where the part goes: its frame's origin in the world
drop_angle_deg = 90.0
grasp_mm = [0.0, 0.0]       where it is taken: the hand's centre in the part's frame (default: its origin)
grasp_angle_deg = 0.0
width_mm = 21.0             what the fingers then have to read (default: anything but nothing)
width_tolerance_mm = 1.5
area_mm = [-60, -60, 90, 60]  x min, y min, x max, y max of the hand while it carries (default: the work area)
```
"""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from runtime.decision import ARRIVED, CLOSING_CONTACT
from runtime.errors import GripperStateError, UsageError
from runtime.geometry import compose
from runtime.hand import Hand
from runtime.reading import OPENED_COUNTS
from runtime.table import PPM, Branch, Limits, Node, Pose2, Table

KEYS = {
    "drop_mm": 2,
    "drop_angle_deg": 0,
    "grasp_mm": 2,
    "grasp_angle_deg": 0,
    "width_mm": 0,
    "width_tolerance_mm": 0,
    "area_mm": 4,
}


@dataclass(frozen=True, slots=True)
class Delivery:
    """Where a localised part is taken and put down.

    Attributes:
        drop: pose of the part in the world, mm, mm, rad.
        grasp: pose of the hand in the part's frame, mm, mm, rad.
        width_mm: least and greatest width the fingers may read at the grasp.
        area_um: x min, y min, x max, y max of the hand while it carries, um; None for the work area.
    """

    drop: Pose2
    grasp: Pose2 = (0.0, 0.0, 0.0)
    width_mm: tuple[float, float] = (0.5, math.inf)
    area_um: tuple[int, int, int, int] | None = None


def from_text(text: str) -> Delivery:
    """The delivery of `x,y,angle`: mm, mm, degrees of the part where it is put down.

    Raises:
        UsageError: it is not three numbers.
    """
    try:
        x_mm, y_mm, angle_deg = (float(word) for word in text.split(","))
    except ValueError:
        raise UsageError(f"--deliver {text!r}: write x,y,angle in mm, mm and degrees, or a file") from None
    return from_keys({"drop_mm": [x_mm, y_mm], "drop_angle_deg": angle_deg}, "--deliver")


def from_file(path: Path) -> Delivery:
    """The delivery of a TOML file, its keys at the top or in a section `delivery`.

    Raises:
        UsageError: it cannot be read, or a key is wrong.
    """
    try:
        with path.open("rb") as file:
            keys = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"--deliver {path}: {error}") from error
    return from_keys(keys.get("delivery", keys), str(path))


def from_job(text: str | None) -> Delivery | None:
    """The delivery of a table's embedded job, None where it has none.

    Raises:
        UsageError: a key of it is wrong.
    """
    job = json.loads(text) if text is not None else {}
    keys = job.get("delivery") if isinstance(job, dict) else None
    return None if keys is None else from_keys(keys, "the job's section delivery")


def from_keys(keys: Mapping[str, object], where: str) -> Delivery:
    """The delivery of its keys.

    Raises:
        UsageError: one is unknown, missing, or not as many finite numbers as it takes.
    """
    if unknown := keys.keys() - KEYS.keys():
        raise UsageError(f"{where}: unknown key {sorted(unknown)[0]}; known are {', '.join(KEYS)}")
    if "drop_mm" not in keys:
        raise UsageError(f"{where}: drop_mm is missing; say where the part goes")
    numbers = {name: _numbers(where, name, keys[name]) for name in KEYS if name in keys}
    drop, grasp = (
        (*numbers.get(f"{name}_mm", (0.0, 0.0)), math.radians(numbers.get(f"{name}_angle_deg", (0.0,))[0]))
        for name in ("drop", "grasp")
    )
    made = Delivery(_pose(drop), _pose(grasp))
    if "width_mm" in numbers:
        width, room = numbers["width_mm"][0], numbers.get("width_tolerance_mm", (1.5,))[0]
        made = replace(made, width_mm=(width - room, width + room))
    if "area_mm" in numbers:
        x_min, y_min, x_max, y_max = (round(1000 * value) for value in numbers["area_mm"])
        made = replace(made, area_um=(x_min, y_min, x_max, y_max))
    return made


def deliver(hand: Hand, delivery: Delivery, pose: Pose2, table: Table) -> str | None:
    """Grasp a part at its pose, carry it and put it down.

    Args:
        hand: above the part, jaws open.
        delivery: where to.
        pose: of the part in the world, mm, mm, rad.
        table: for speed, force and opening of the grasp: those of the root.

    Returns:
        None where the part was put down, else why it was left where it lay: the fingers read another width.

    Raises:
        GripperStateError: the part slipped out while it was carried, or the gripper is not ready.
        MotionRefusedError: the grasp or the drop-off is outside the area.
    """
    node = _grasp_node(table)
    _approach(hand, compose(pose, delivery.grasp), node)
    reading = hand.close(node)
    width_mm = hand.width_mm(reading.position_counts)
    low_mm, high_mm = delivery.width_mm
    if reading.object_flag == ARRIVED or not low_mm <= width_mm <= high_mm:
        hand.release(node.squeeze)
        hand.retreat()
        return (
            f"the fingers read {width_mm:.2f} mm at the last grasp, expected was {low_mm:g}..{high_mm:g} mm"
        )
    carrying = hand.limits if delivery.area_um is None else _within(hand.limits, delivery.area_um)
    with hand.limited(carrying):
        hand.retreat()
        _check_held(hand, reading.position_counts)
        x_mm, y_mm, angle_rad = compose(delivery.drop, delivery.grasp)
        angle_rad = math.remainder(angle_rad, math.tau)
        hand.travel(x_mm, y_mm, angle_rad)
        _check_held(hand, reading.position_counts)
        hand.lower(x_mm, y_mm, angle_rad, width_mm)
        hand.release(node.squeeze)
        hand.retreat()
    return None


def _approach(hand: Hand, place: Pose2, node: Node) -> None:
    x_mm, y_mm, angle_rad = place
    angle_rad = math.remainder(angle_rad, math.tau)
    hand.retreat()
    hand.open(node.squeeze)
    hand.travel(x_mm, y_mm, angle_rad)
    hand.descend(x_mm, y_mm, angle_rad)


def _grasp_node(table: Table) -> Node:
    """The root's squeeze with the jaws wide, and one outcome that any width is."""
    opening_um = table.gripper.opening_um
    squeeze = table.nodes[0].squeeze._replace(opening_um=opening_um)
    widest_um = max(branch.high_um for node in table.nodes for branch in node.branches)
    return table.nodes[0]._replace(squeeze=squeeze, branches=(Branch(0, 0, widest_um, PPM, ~0),))


def _check_held(hand: Hand, count: int) -> None:
    state = hand.gripper.state()
    if state.object_flag != CLOSING_CONTACT or abs(state.position_counts - count) > OPENED_COUNTS:
        raise GripperStateError("the part slipped out of the fingers while it was carried; find it")


def _within(limits: Limits, area_um: tuple[int, int, int, int]) -> Limits:
    return replace(limits, work_area_um=area_um)


def _numbers(where: str, name: str, value: object) -> tuple[float, ...]:
    items: list[object] = value if isinstance(value, list) else [value]
    wanted = KEYS[name]
    if isinstance(value, list) != bool(wanted) or len(items) != max(wanted, 1):
        raise UsageError(f"{where}: {name} takes {wanted or 'one'} number{'s' if wanted else ''}")
    numbers = []
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int | float) or not math.isfinite(item):
            raise UsageError(f"{where}: {name} holds {item!r}, which is no number")
        numbers.append(float(item))
    return tuple(numbers)


def _pose(values: tuple[float, ...]) -> Pose2:
    x, y, theta = values
    return x, y, theta
