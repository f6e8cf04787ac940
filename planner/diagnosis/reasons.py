"""Classifies why a part cannot be located: because of the part, the gripper or the search."""

from typing import NamedTuple

from planner.belief.observation import encoder_of
from planner.diagnosis.advice import PINCHED, Advice
from planner.diagnosis.alike import BOTH_SIDES
from planner.errors import NoPlanError
from planner.job.model import Job
from planner.part.outline import canonical, convex_hull
from planner.part.symmetry import nearest_turn

TOO_LARGE = "too large for the gripper"
BELOW = "feature below one count"
THIN = "rim thinner than one count"
REACH = "feature out of the fingers' reach"
ALIKE = "poses not told apart"
TIME = "search cut short"
DEPTH = "longest path reached"
SCATTER = "scatter about a pose"
REJECTED = "widths that no branch has"
NO_START = "no first squeeze"


class Reason(NamedTuple):
    """Why a part is not located."""

    kind: str  # one of the constants of this module
    text: str  # what was measured, as a sentence without its full stop


def likeness(job: Job, cut: bool = False) -> Reason | None:
    """Finds a turn after which the gripper cannot distinguish the part from its former pose.

    The outline is compared with itself after the turn, and then the convex hull with the turned hull. A hull
    that looks the same is only a hint, since fingers may reach the rest of the outline. So the hull is not
    compared if the search was `cut` short.

    Returns:
        The reason; None if every turn changes the compared shapes by more than the gripper resolves.
    """
    outline, grain_mm = job.part.outline_mm, encoder_of(job).grain_mm
    hull = canonical(convex_hull(outline)).outline_mm  # about its own centroid
    shapes = [(BELOW, outline, "it"), (REACH, hull, "its convex hull")]
    for kind, shape, what in shapes[: 1 if cut else 2]:
        turn = nearest_turn(shape, job.part.symmetry)
        if BOTH_SIDES * turn.apart_mm < grain_mm:
            read = f"the gripper resolves {grain_mm:.2f} mm"
            differs = f"{what} differs by {turn.apart_mm:.2f} mm a side at most; {read}"
            return Reason(kind, f"turned by {turn.degrees:.0f} degrees {differs}")
    return None


def no_plan(job: Job, error: NoPlanError) -> Reason:
    """Returns the reason why the search for a plan raised `error`."""
    if result := likeness(job, error.cut_short):
        return result
    if error.cut_short:
        return Reason(TIME, str(error))
    return Reason(NO_START if "first squeeze" in str(error) else ALIKE, str(error))


def reason(job: Job, advice: Advice, cut: bool) -> Reason:
    """Returns the reason why a plan locates too few parts; `cut`: its search was cut short."""
    several = [leaf for leaf in advice.open_poses if len(leaf.where.poses) > 1]
    if several and (result := likeness(job, cut)):
        return result
    if advice.pinched > 0.5 * advice.failing:
        return Reason(THIN, f"{advice.pinched:.1%} of the parts are rejected, {PINCHED}")
    if advice.rejected > 0.5 * advice.failing:
        parts = f"{advice.rejected:.1%} of the parts"
        return Reason(REJECTED, f"{parts} are rejected for a width that is not planned")
    if cut:
        parts = f"{advice.unresolved:.1%} of the parts"
        return Reason(TIME, f"{parts} were still open when the time was over")
    if advice.at_depth_limit > 0.5 * advice.failing:
        return Reason(DEPTH, f"{advice.at_depth_limit:.1%} of the parts end there")
    if several:
        return Reason(ALIKE, several[0].line())
    if advice.open_poses:
        return Reason(SCATTER, advice.open_poses[0].line())
    parts = f"{advice.failing - advice.unresolved:.1%} of the parts"
    return Reason(SCATTER, f"{parts} are answered wrongly or rejected")
