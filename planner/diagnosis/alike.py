"""Finds poses that no squeeze distinguishes, from outline and goal alone, before any search."""

import math
from typing import NamedTuple

import numpy as np

from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of
from planner.errors import NoPlanError
from planner.job.model import Job
from planner.part import symmetry

BOTH_SIDES = 2.0  # largest difference of widths, in distances of outlines: two fingers touch
ALL = 1.0 - 1e-9  # least share that counts as all parts
ANGLES = 3600  # number of angles sampled within the uncertainty


class Alike(NamedTuple):
    """A turn of a part that changes no reading, although the goal distinguishes the two poses."""

    name: str  # name of the part
    degrees: float  # angle of the turn
    apart_mm: float  # largest distance between the outline and the turned outline
    grain_mm: float  # scatter of the readings of one width
    share: float  # share of the parts that stay within the uncertainty after the turn
    order: int  # the outline's rotational order
    stated: int  # rotational order that the job states
    exact: bool  # whether outline and pressure are the same after the turn

    @property
    def hopeless(self) -> bool:
        """Whether no search can find a plan: the turned part is the same, and no turned pose is ruled out."""
        return self.exact and self.share >= ALL

    def line(self) -> str:
        """States which poses look alike and what to change, for people."""
        differs = "its outline is the same"
        if self.apart_mm > symmetry.TOLERANCE_MM:
            differs = f"its outline differs by {self.apart_mm:.2f} mm at most"
            differs += f", and the gripper resolves {self.grain_mm:.2f} mm"
        turn = f"{self.degrees:.4g} degrees"
        message = f"{self.name}: no squeeze distinguishes a pose from the same turned by {turn}"
        half, modes = 0.5 * self.degrees, round(360.0 / self.degrees)
        ways = f'[goal] kind = "modes" with modes = {modes}'
        ways += f", or orientation_halfwidth_deg below {half:.4g}"
        if self.order > self.stated:
            auto = f'[part] symmetry = "auto", which is {self.order} and counts them as one'
            ways = f"{auto}, or {ways}"
        some = "" if self.share >= ALL else f" ({self.share:.0%} of the parts may lie either way)"
        return f"{message}: {differs}{some}; state {ways}"


def alike(job: Job) -> list[Alike]:
    """Finds, for each part of a job, a turn that no squeeze detects but that the goal distinguishes.

    Parts without such a turn are left out of the list.
    """
    return [result for k, alone in enumerate(job.alone) if (result := _of_part(job, alone, k))]


def refuse_alike(job: Job) -> None:
    """Refuses a job for which no search can find a plan.

    Raises:
        NoPlanError: for every pose of every part there is a second pose that gives the same readings in all
            squeezes, and the goal distinguishes the two.
    """
    result = alike(job)
    if len(result) == len(job.alone) and all(each.hopeless for each in result):
        raise NoPlanError(result[0].line())


def _of_part(job: Job, alone: Job, index: int) -> Alike | None:
    """Finds a turn of one part that no squeeze detects but that the goal distinguishes; None without one.

    Of several such turns, the result is the one after which most parts are still within the uncertainty. If
    the outline has no rotational symmetry, the turn that changes it least is examined.

    Args:
        job: the job with all its parts.
        alone: the job of this part alone.
        index: number of the part in `job`.
    """
    outline, stated = alone.part.outline_mm, alone.part.symmetry
    order, grain_mm = symmetry.order(outline), encoder_of(job).grain_mm
    turns = [(math.tau * k / order, 0.0) for k in range(1, order // 2 + 1) if k * stated % order]
    if not turns:
        near = symmetry.nearest_turn(outline, stated)
        if BOTH_SIDES * near.apart_mm >= grain_mm:
            return None
        turns = [(math.radians(near.degrees), near.apart_mm)]
    halfwidth = math.radians(job.uncertainty.orientation_halfwidth_deg)
    metric = metric_of(job)
    pose = np.array([0.0, 0.0, 0.0, float(index)])
    asked = [
        (_share(turn, halfwidth), math.degrees(turn), apart)
        for turn, apart in turns
        if job.goal.kind != "identity"
        and not metric.reached(pose, pose + np.array([0.0, 0.0, turn, 0.0]))
        and metric.modes < round(math.tau / turn)
    ]
    share, degrees, apart = max(asked, default=(0.0, 0.0, 0.0))
    if share == 0.0:
        return None
    exact = apart == 0.0 and alone.pressure.kind in ("boundary", "uniform")
    return Alike(alone.part.name, degrees, apart, grain_mm, share, order, stated, exact)


def _share(turn: float, halfwidth: float) -> float:
    """Share of the angles in +-`halfwidth` that stay there if turned by +`turn` or by -`turn` [rad]."""
    if halfwidth >= math.pi:
        return 1.0
    angles = np.linspace(-halfwidth, halfwidth, ANGLES)
    turned = np.abs(np.angle(np.exp(1j * (angles + np.array([[-turn], [turn]])))))
    return float((turned <= halfwidth).any(axis=0).mean())
