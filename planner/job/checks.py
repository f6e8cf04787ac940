"""Checks of a job that compare several values, or concern the geometry of one value."""

import math
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
import shapely

from planner.arrays import Array
from planner.errors import FitError
from planner.frames import to_world
from planner.job.schema import MOST_OFF_MM
from planner.job.surface_file import check_ellipsoid
from planner.part import outline, symmetry, tips
from runtime.shell.errors import InputError
from runtime.table import PROFILES, TableError, doubt_um, profile_of

Values = dict[str, Any]
Conflicts: TypeAlias = Iterator[tuple[str, str, str]]
"""For each conflict: section and key of the value at fault, and the problem with what to do."""

LEAST_DOF = 3  # Least degrees of freedom of a random ellipsoid, whose matrix is 3 x 3
ON_PART_MM = 1e-3  # Tolerated distance of a support point outside the outline, for rounded drawings
LEAST_STEPS = 8  # Steps of a reading between open and closed jaws


def place_outline(points: Array, drawn: bool) -> outline.Canonical:
    """Returns an outline in the part's frame, and the shift from the drawing to this frame.

    If `drawn` is False, the outline should already be canonical: it is only checked, and the shift is 0.

    Raises:
        InputError: the outline crosses or touches itself; or `drawn` is False, and the outline is clockwise
            or off centre.
    """
    try:
        if drawn:
            return outline.canonical(points)
        return outline.Canonical(outline.checked(points), np.zeros(2))
    except InputError as error:
        raise error.at(section="part", key="outline_mm") from None


def place_supports(pressure: dict[str, Any], part_outline: outline.Outline, shift: Array) -> None:
    """Moves the support points by the shift of the outline, and normalises their weights (in place).

    Points without weights get equal weights. If the pressure is an ellipsoid that the job states, only the
    ellipsoid is checked.

    Raises:
        InputError: points lie off the part or all in one place, their number differs from the number of
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
        raise InputError(problem, section="pressure", key="weights")
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
        raise InputError(problem, section="gripper", key="model") from error
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


def refuse(conflicts: Conflicts) -> None:
    """Raises an `InputError` for the first conflict, if there is any."""
    for section, key, problem in conflicts:
        raise InputError(problem, section=section, key=key)


def conflicts(values: Values) -> Conflicts:
    """Yields the conflicts between the values of a job; each value is valid alone.

    Raises:
        FitError: the part is wider than the jaws open, at any angle.
    """
    part, gripper, cell = values["part"], values["gripper"], values["cell"]
    if not symmetry.has_order(part["outline_mm"], part["symmetry"]):
        result = symmetry.order(part["outline_mm"])
        problem = f"is {part['symmetry']}, but the outline has order {result}"
        yield "part", "symmetry", f'{problem}; write "auto", or a divisor of {result}'
    if part["picks"] is not None and part["datum"] is None:
        needed = "need a datum, in whose frame they are"
        yield "part", "picks", f"{needed}; state it, [0, 0, 0] if need be"
    low, high = values["friction"]["finger_part_min"], values["friction"]["finger_part_max"]
    if low > high:
        problem = f"is {low:g}, above finger_part_max = {high:g}; exchange them"
        yield "friction", "finger_part_min", problem
    yield from _of_gripper(gripper, cell)
    yield from _of_doubt(values["doubt"])
    yield from _of_heights(part["height_mm"], cell)
    yield from _of_actions(values["actions"], cell)
    if values["actions"]["pushes"] == "belief":
        yield from _of_pushes(values["search"]["method"], values["actions"]["proposals"])
    _check_fit(part["outline_mm"], gripper["opening_mm"])
    if values["delivery"] is not None:
        yield from _of_delivery(values)


def of_parts(job: Any, names: list[str]) -> Conflicts:
    """Yields the conflicts of a job that depend on how many hypotheses it has, and on their names.

    Some settings suit one hypothesis only, others need several. Names must differ.
    """
    if len(names) == 1:
        if job.goal.kind == "identity":
            problem = 'is "identity", but only one part may lie there'
            yield "goal", "kind", f"{problem}; add [[hypothesis]], or ask for a pose"
        return
    if len(set(names)) < len(names):
        yield "hypothesis", "name", "stands twice; give each part a name of its own"
    if job.goal.kind == "identity" and job.goal.identify is False:
        yield "goal", "identify", 'is false, but kind = "identity" asks for nothing else; drop it'
    if job.search.method != "closed-loop":
        yield "search", "method", 'is one that plans for one part; leave it at "closed-loop"'
    if job.delivery is not None:
        yield "delivery", "drop", "is of one part; leave the section out for several hypotheses"


def _of_gripper(gripper: Values, cell: Values) -> Conflicts:
    step_mm, opening_mm = gripper["resolution_mm"], gripper["opening_mm"]
    if opening_mm < LEAST_STEPS * step_mm:
        problem = f"is {step_mm:g}, more than 1/{LEAST_STEPS} of opening_mm = {opening_mm:g}"
        yield "gripper", "resolution_mm", f"{problem}: no width could be read"
    speed, most = gripper["speed_mm_s"], cell["max_speed_mm_s"]
    if speed > most:
        problem = f"is {speed:g}, above max_speed_mm_s = {most:g} of [cell]; lower it"
        yield "gripper", "speed_mm_s", problem
    model = gripper["model"]
    profile = profile_of(model)
    for key, (least, most) in (("speed_mm_s", profile.speed_mm_s), ("force_n", profile.force_n)):
        if not least <= gripper[key] <= most:
            problem = f"is {gripper[key]:g}, but a {model} does {least:g} to {most:g}"
            yield "gripper", key, f"{problem}; correct it, or the model"
    force = gripper["force_n"]
    most = profile.fastest_grip_mm_s(force)
    if speed > most:
        problem = f"is {speed:g}, but a {model} grips with {force:g} N at {most:g} at most"
        yield "gripper", "speed_mm_s", f"{problem}; lower it"


def _of_doubt(doubt: Values) -> Conflicts:
    for key in ("finger_share", "middle_mm", "encoder_mm", "encoder_gain"):
        low, high = doubt[key]
        if low > high:
            yield "doubt", key, f"is [{low:g}, {high:g}]; write the lower bound first"
    least = doubt["least_dof"]
    if 0 < least < LEAST_DOF:
        problem = f"is {least}; write 0 for no doubt, or {LEAST_DOF} or more"
        yield "doubt", "least_dof", problem


def _of_heights(height_mm: float | None, cell: Values) -> Conflicts:
    """Yields conflicts of heights: the tips miss the part in a squeeze, or meet it while the arm travels."""
    squeeze_mm, retreat_mm = cell["squeeze_height_mm"], cell["retreat_height_mm"]
    regrasp_mm = cell["regrasp_height_mm"]
    least_mm = max(squeeze_mm, height_mm or 0.0)
    if regrasp_mm is not None and not least_mm < regrasp_mm <= retreat_mm:
        of = "squeeze_height_mm" if least_mm == squeeze_mm else "height_mm of [part]"
        problem = f"is {regrasp_mm:g}, which does not clear the part; it belongs above {of}"
        most = f"at most at retreat_height_mm = {retreat_mm:g}"
        yield "cell", "regrasp_height_mm", f"{problem} = {least_mm:g} and {most}"
    if height_mm is None:
        return
    highest_mm = height_mm - tips.MARGIN_MM
    if squeeze_mm > highest_mm:
        place = "above or at the rim of a part of height_mm"
        problem = f"is {squeeze_mm:g}, which closes the tips {place}"
        remedy = f"lower it to {highest_mm:g} or less, or leave it out"
        yield "cell", "squeeze_height_mm", f"{problem} = {height_mm:g}; {remedy}"
    if retreat_mm <= height_mm:
        problem = f"is {retreat_mm:g}, not above height_mm = {height_mm:g} of [part]; raise it"
        yield "cell", "retreat_height_mm", problem


def _of_actions(actions: Values, cell: Values) -> Conflicts:
    low, high = np.array(cell["work_area_mm"])
    if not (low < high).all():
        problem = "must be [[x_min, y_min], [x_max, y_max]] with min below max"
        yield "cell", "work_area_mm", problem
    for key in ("angles_deg", "centers_mm"):
        if len(np.unique(actions[key], axis=0)) < len(actions[key]):
            yield "actions", key, "has an entry twice; drop one"
    centers = actions["centers_mm"]
    outside = ((centers < low) | (centers > high)).any(axis=1)
    if outside.any():
        x, y = centers[int(np.argmax(outside))]
        problem = f"({x:g}, {y:g}) lies outside work_area_mm of [cell]; move it or widen the area"
        yield "actions", "centers_mm", problem


def _of_pushes(method: str, proposals: str) -> Conflicts:
    if method != "closed-loop":
        remedy = 'which the paper\'s methods do not know; leave method at "closed-loop"'
        yield "actions", "pushes", f'is "belief", {remedy}'
    if proposals == "none":
        remedy = 'and grasp poses must follow what was pushed; leave proposals at "belief", too'
        yield "actions", "pushes", f'is "belief", {remedy}'


def _of_delivery(values: Values) -> Conflicts:
    """Yields conflicts of [delivery]: a bad width, grasp or area, or a drop with the hand outside the area.

    At the drop, the part may be turned by its symmetry; the hand has to be inside for at least one such turn.
    """
    delivery, part, opening = values["delivery"], values["part"], values["gripper"]["opening_mm"]
    width = delivery["width_mm"]
    if width is not None and width >= opening:
        problem = f"is {width:g}, not below opening_mm = {opening:g} of [gripper]; lower it"
        yield "delivery", "width_mm", problem
    area = values["cell"]["work_area_mm"] if delivery["area_mm"] is None else delivery["area_mm"]
    low, high = np.reshape(area, (2, 2))
    if not (low < high).all():
        problem = "must be [x_min, y_min, x_max, y_max] with min below max"
        yield "delivery", "area_mm", problem
    name, picks = delivery["grasp"], part["picks"] or {}
    if name is not None and name not in picks:
        problem = f"is {name!r}, none of [part] picks: {', '.join(picks) or 'there are none'}"
        yield "delivery", "grasp", problem
    # Where the hand holds the part, in the part's frame: its centroid, or the pick.
    grasp = np.zeros(3)
    if name is not None:
        x, y, angle = part["datum"]
        grasp = to_world(np.array(picks[name]), np.array([x, y, math.radians(angle)]))
    x, y, angle = delivery["drop"]
    turns = math.radians(angle) + np.arange(part["symmetry"]) * math.tau / part["symmetry"]
    hands = to_world(grasp, np.stack(np.broadcast_arrays(x, y, turns)))[:, :2]
    if not ((low <= hands) & (hands <= high)).all(axis=1).any():
        outside = "work_area_mm of [cell]" if delivery["area_mm"] is None else "area_mm"
        place = f"({hands[0, 0]:g}, {hands[0, 1]:g})"
        problem = f"brings the hand to {place}, outside {outside}; move it or widen the area"
        yield "delivery", "drop", problem


def _check_fit(part_outline: outline.Outline, opening_mm: float) -> None:
    narrowest = outline.min_width(part_outline)
    if narrowest >= opening_mm:
        larger = f"its narrowest width is {narrowest:.4g} mm, the jaws open {opening_mm:.4g} mm"
        problem = f"part larger than the opening: {larger}; take a wider gripper"
        raise FitError(problem, section="gripper", key="opening_mm")


def _check_supports(points: Array, part_outline: outline.Outline) -> None:
    beside = ~shapely.dwithin(shapely.polygons(part_outline), shapely.points(points), ON_PART_MM)
    problem = None
    if beside.any():
        entry = int(np.argmax(beside)) + 1
        problem = f"entry {entry} lies outside the outline; a part stands on points below it"
    elif np.ptp(points, axis=0).max() <= ON_PART_MM:
        problem = "lie all in one place, where friction resists no turning"
        problem += "; give at least two places"
    if problem:
        raise InputError(problem, section="pressure", key="points_mm")
