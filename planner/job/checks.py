"""Checks of a job that concern several values, or the geometry of one."""

import math
from typing import Any

import numpy as np
import shapely

from planner.arrays import Array
from planner.errors import FitError
from planner.job.schema import MOST_OFF_MM
from planner.job.surface_file import check_ellipsoid
from planner.part import outline, symmetry, tips
from runtime.shell.errors import InputError
from runtime.table import PROFILES, TableError, doubt_um, profile_of

Values = dict[str, Any]

LEAST_DOF = 3  # Least degrees of freedom of a random ellipsoid, whose matrix is 3 x 3
ON_PART_MM = 1e-3  # Tolerated distance of a support point outside the outline, for rounded drawings
LEAST_STEPS = 8  # Steps of a reading between open and closed jaws


def place_outline(points: Array, drawn: bool) -> outline.Canonical:
    """Returns the outline in the part's frame, and its shift from the drawing.

    An outline that is not `drawn`, but in the canonical form, is only checked: its shift is 0.

    Raises:
        InputError: the outline is not a simple polygon, or is neither drawn nor centred counter-clockwise.
    """
    try:
        if drawn:
            return outline.canonical(points)
        return outline.Canonical(outline.checked(points), np.zeros(2))
    except InputError as error:
        raise error.at(section="part", key="outline_mm") from None


def place_supports(pressure: dict[str, Any], part_outline: outline.Outline, shift: Array) -> None:
    """Moves the support points by the shift of the outline and normalises their weights (in place).

    Points without weights get equal ones.

    Raises:
        InputError: points lie off the part or all in one place, their number differs from that of the
            weights, or a stated ellipsoid is not symmetric positive definite.
    """
    if pressure["kind"] == "stated":
        check_ellipsoid(pressure["ellipsoid"], "pressure")
    if pressure["kind"] != "points":
        return
    points = pressure["points_mm"] + shift + 0.0
    _check_supports(points, part_outline)
    weights = pressure["weights"]
    if weights is None:
        weights = np.ones(len(points))
    if len(weights) != len(points):
        problem = f"has {len(weights)} entries for {len(points)} points; give one weight a point"
        raise _conflict("pressure", "weights", problem)
    total = math.fsum(weights)
    # Weights that are normalised already stay the same to the last bit.
    if abs(total - 1.0) > 1e-12:
        weights = weights / total
    points.setflags(write=False)
    weights.setflags(write=False)
    pressure.update(points_mm=points, weights=weights)


def complete_gripper(gripper: dict[str, Any]) -> None:
    """Fills in the values that the gripper of a job leaves out, from the profile of its model (in place).

    Raises:
        InputError: the model is unknown.
    """
    try:
        profile = profile_of(gripper["model"])
    except TableError as error:
        known = ", ".join(PROFILES)
        problem = f"is {gripper['model'][:40]!r}, which is not known; there are {known}"
        raise _conflict("gripper", "model", problem) from error
    if gripper["force_n"] is None:
        gripper["force_n"] = profile.usual_force_n
    usual = {
        "opening_mm": profile.stroke_um / 1e3,
        "noise_mm": profile.noise_um / 1e3,
        "speed_mm_s": profile.usual_speed_mm_s(gripper["force_n"]),
    }
    gripper |= {key: value for key, value in usual.items() if gripper[key] is None}
    if gripper["resolution_mm"] is None:
        gripper["resolution_mm"] = gripper["opening_mm"] / profile.steps


def doubt_mm(resolution_mm: float, noise_mm: float) -> float:
    """Default bound of the constant error of a gripper's widths [mm], rounded to two significant digits."""
    return min(float(f"{doubt_um(resolution_mm, noise_mm):.2g}"), MOST_OFF_MM)


def check_conflicts(values: Values) -> None:
    """Refuses values that are valid alone but conflict with each other.

    Raises:
        InputError: two values conflict; names both.
        FitError: the part is wider than the jaws open, at any angle.
    """
    _check_symmetry(values["part"])
    if values["part"]["picks"] is not None and values["part"]["datum"] is None:
        raise _conflict(
            "part", "picks", "need a datum, in whose frame they are; state it, [0, 0, 0] if need be"
        )
    low, high = values["friction"]["finger_part_min"], values["friction"]["finger_part_max"]
    if low > high:
        problem = f"is {low:g}, above finger_part_max = {high:g}; exchange them"
        raise _conflict("friction", "finger_part_min", problem)
    _check_gripper(values["gripper"], values["cell"])
    _check_doubt(values["doubt"], values["pressure"])
    _check_heights(values["part"]["height_mm"], values["cell"])
    _check_actions(values["actions"], values["cell"])
    if values["actions"]["pushes"] == "belief":
        _check_pushes(values["search"]["method"], values["actions"]["proposals"])
    _check_fit(values["part"]["outline_mm"], values["gripper"]["opening_mm"])
    if values["delivery"] is not None:
        _check_delivery(values)


def check_parts(job: Any, names: list[str]) -> None:
    """Refuses values that conflict with the number or the names of the parts that may lie on the table.

    Raises:
        InputError: the goal is to identify a single part, two parts have one name, or a value does not
            apply to several parts.
    """
    if len(names) == 1 and job.goal.kind == "identity":
        problem = (
            'is "identity", but only one part may lie there; add [[hypothesis]], or ask for a pose'
        )
        raise _conflict("goal", "kind", problem)
    if len(names) == 1:
        return
    if len(set(names)) < len(names):
        raise _conflict("hypothesis", "name", "stands twice; give each part a name of its own")
    if job.goal.kind == "identity" and job.goal.identify is False:
        raise _conflict(
            "goal", "identify", 'is false, but kind = "identity" asks for nothing else; drop it'
        )
    if job.search.method != "closed-loop":
        raise _conflict(
            "search", "method", 'of the paper plans for one part; leave it at "closed-loop"'
        )
    if job.delivery is not None:
        raise _conflict(
            "delivery", "drop", "is of one part; leave the section out for several hypotheses"
        )


def _check_symmetry(part: dict[str, Any]) -> None:
    n = part["symmetry"]
    if not symmetry.has_order(part["outline_mm"], n):
        result = symmetry.order(part["outline_mm"])
        problem = (
            f'is {n}, but the outline has order {result}; write "auto", or a divisor of {result}'
        )
        raise _conflict("part", "symmetry", problem)


def _check_gripper(gripper: dict[str, Any], cell: dict[str, Any]) -> None:
    step_mm, opening_mm = gripper["resolution_mm"], gripper["opening_mm"]
    if opening_mm < LEAST_STEPS * step_mm:
        problem = f"is {step_mm:g}, more than 1/{LEAST_STEPS} of opening_mm = {opening_mm:g}"
        raise _conflict("gripper", "resolution_mm", f"{problem}: no width could be read")
    speed, most = gripper["speed_mm_s"], cell["max_speed_mm_s"]
    if speed > most:
        problem = f"is {speed:g}, above max_speed_mm_s = {most:g} of [cell]; lower it"
        raise _conflict("gripper", "speed_mm_s", problem)
    profile = profile_of(gripper["model"])
    for key, (least, most) in (("speed_mm_s", profile.speed_mm_s), ("force_n", profile.force_n)):
        if not least <= gripper[key] <= most:
            problem = f"is {gripper[key]:g}, but a {gripper['model']} does {least:g} to {most:g}"
            raise _conflict("gripper", key, f"{problem}; correct it, or the model")
    most = profile.fastest_grip_mm_s(gripper["force_n"])
    if speed > most:
        model, force = gripper["model"], gripper["force_n"]
        problem = (
            f"is {speed:g}, but a {model} grips with {force:g} N at {most:g} at most; lower it"
        )
        raise _conflict("gripper", "speed_mm_s", problem)


def _check_doubt(doubt: dict[str, Any], pressure: dict[str, Any]) -> None:
    for key in ("finger_share", "middle_mm", "encoder_mm", "encoder_gain"):
        low, high = doubt[key]
        if low > high:
            raise _conflict("doubt", key, f"is [{low:g}, {high:g}]; write the lower bound first")
    least = doubt["least_dof"]
    if 0 < least < LEAST_DOF:
        raise _conflict(
            "doubt", "least_dof", f"is {least}; write 0 for no doubt, or {LEAST_DOF} or more"
        )
    if doubt["limit_surface"] == "any" and pressure.get("limit_surface") is None:
        problem = (
            f'is "any", but [pressure] kind = "{pressure["kind"]}" states the surface; leave it out'
        )
        raise _conflict("doubt", "limit_surface", problem)


def _check_heights(height_mm: float | None, cell: dict[str, Any]) -> None:
    """Checks that the tips meet the part where they squeeze and clear it where they travel."""
    squeeze_mm, retreat_mm = cell["squeeze_height_mm"], cell["retreat_height_mm"]
    regrasp_mm = cell["regrasp_height_mm"]
    if regrasp_mm is not None:
        least_mm = max(squeeze_mm, height_mm or 0.0)
        if not least_mm < regrasp_mm <= retreat_mm:
            of = "squeeze_height_mm" if least_mm == squeeze_mm else "height_mm of [part]"
            problem = (
                f"is {regrasp_mm:g}, which does not clear the part; it belongs above {of} = {least_mm:g} "
                f"and at most at retreat_height_mm = {retreat_mm:g}"
            )
            raise _conflict("cell", "regrasp_height_mm", problem)
    if height_mm is None:
        return
    if squeeze_mm > height_mm - tips.MARGIN_MM:
        problem = (
            f"is {squeeze_mm:g}, which closes the tips above or at the rim of a part of height_mm = "
            f"{height_mm:g}; lower it to {height_mm - tips.MARGIN_MM:g} or less, or leave it out"
        )
        raise _conflict("cell", "squeeze_height_mm", problem)
    if retreat_mm <= height_mm:
        problem = f"is {retreat_mm:g}, not above height_mm = {height_mm:g} of [part]; raise it"
        raise _conflict("cell", "retreat_height_mm", problem)


def _check_actions(actions: dict[str, Any], cell: dict[str, Any]) -> None:
    low, high = cell["work_area_mm"]
    if not (low < high).all():
        problem = "must be [[x_min, y_min], [x_max, y_max]] with min below max"
        raise _conflict("cell", "work_area_mm", problem)
    for key in ("angles_deg", "centers_mm"):
        if len(np.unique(actions[key], axis=0)) < len(actions[key]):
            raise _conflict("actions", key, "has an entry twice; drop one")
    centers = actions["centers_mm"]
    outside = ((centers < low) | (centers > high)).any(axis=1)
    if outside.any():
        x, y = centers[int(np.argmax(outside))]
        problem = f"({x:g}, {y:g}) lies outside work_area_mm of [cell]; move it or widen the area"
        raise _conflict("actions", "centers_mm", problem)


def _check_pushes(method: str, proposals: str) -> None:
    if method != "closed-loop":
        problem = 'which the paper\'s methods do not know; leave method at "closed-loop"'
    elif proposals == "none":
        problem = 'and grasp poses must follow what was pushed; leave proposals at "belief", too'
    else:
        return
    raise _conflict("actions", "pushes", f'is "belief", {problem}')


def _grasp(delivery: dict[str, Any], part: dict[str, Any]) -> tuple[float, float]:
    """The point (x, y) at which the hand holds the part for delivery, in the part's frame [mm].

    This is the position of the pick that [delivery] names, or the centroid if it names none.

    Raises:
        InputError: the grasp is none of the part's picks.
    """
    name, picks = delivery["grasp"], part["picks"] or {}
    if name is None:
        return 0.0, 0.0
    if name not in picks:
        problem = f"is {name!r}, none of [part] picks: {', '.join(picks) or 'there are none'}"
        raise _conflict("delivery", "grasp", problem)
    x, y, angle = part["datum"]
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    across, along, _ = picks[name]
    return x + c * across - s * along, y + s * across + c * along


def _check_delivery(values: Values) -> None:
    """Checks the width and the area of [delivery], and that the hand is inside the area at the drop.

    The hand has to be inside for one of the turns that the part's symmetry allows.
    """
    delivery, opening = values["delivery"], values["gripper"]["opening_mm"]
    width = delivery["width_mm"]
    if width is not None and width >= opening:
        problem = f"is {width:g}, not below opening_mm = {opening:g} of [gripper]; lower it"
        raise _conflict("delivery", "width_mm", problem)
    area = values["cell"]["work_area_mm"] if delivery["area_mm"] is None else delivery["area_mm"]
    low, high = np.reshape(area, (2, 2))
    if not (low < high).all():
        problem = "must be [x_min, y_min, x_max, y_max] with min below max"
        raise _conflict("delivery", "area_mm", problem)
    order = values["part"]["symmetry"]
    turns = math.radians(delivery["drop"][2]) + np.arange(order) * math.tau / order
    x, y = _grasp(delivery, values["part"])
    across = np.column_stack(
        [np.cos(turns) * x - np.sin(turns) * y, np.sin(turns) * x + np.cos(turns) * y]
    )
    hands = delivery["drop"][:2] + across
    if not ((low <= hands) & (hands <= high)).all(axis=1).any():
        outside = "work_area_mm of [cell]" if delivery["area_mm"] is None else "area_mm"
        place = f"({hands[0, 0]:g}, {hands[0, 1]:g})"
        problem = f"brings the hand to {place}, outside {outside}; move it or widen the area"
        raise _conflict("delivery", "drop", problem)


def _check_fit(part_outline: outline.Outline, opening_mm: float) -> None:
    narrowest = outline.min_width(part_outline)
    if narrowest >= opening_mm:
        problem = (
            f"part larger than the opening: its narrowest width is {narrowest:.4g} mm, the jaws open "
            f"{opening_mm:.4g} mm; take a wider gripper"
        )
        raise FitError(problem, section="gripper", key="opening_mm")


def _check_supports(points: Array, part_outline: outline.Outline) -> None:
    beside = ~shapely.dwithin(shapely.polygons(part_outline), shapely.points(points), ON_PART_MM)
    if beside.any():
        entry = int(np.argmax(beside)) + 1
        problem = f"entry {entry} lies outside the outline; a part stands on points below it"
        raise _conflict("pressure", "points_mm", problem)
    if np.ptp(points, axis=0).max() <= ON_PART_MM:
        problem = (
            "lie all in one place, where friction resists no turning; give at least two places"
        )
        raise _conflict("pressure", "points_mm", problem)


def _conflict(section: str, key: str, problem: str) -> InputError:
    return InputError(problem, section=section, key=key)
