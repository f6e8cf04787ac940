"""Lists of cases: a case is a named simulated world that differs from the plan's assumptions.

Each use of cases, such as a sweep or a control chart, has its own list.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from planner.belief.doubts import ROUGH, SLIPPERY, closing_mm
from planner.belief.observation import encoder_of
from planner.evaluation.disturbance import NONE, Disturbance
from planner.job.model import Job
from planner.job.schema import MOST_FRICTION
from planner.part.outline import grown
from planner.part.pressure import stances
from runtime.shell.errors import InputError

OFFSET = 2.0  # offset of the encoder's zero, in units of the scatter of readings (`grain_mm`)
SLIGHTLY_UNEVEN = 0.02  # change of the upper finger's share of the closing: 1.3 mm of 64 mm
STEADY_DOF = 1_000_000  # degrees of freedom above which the limit surface no longer scatters
FACTORS = (0.5, 0.7, 1.15, 1.3, 1.6)
"""Factors of the friction between finger and part, for control charts.

The charts of all factors share one rate of false alarms, so that each additional factor delays the alarms of
the others. The charts of the outermost factors also detect friction beyond them soon enough.
"""
BEYOND = {min(FACTORS): " or less", max(FACTORS): " or more"}
PLANNED = "as planned"
EVERYTHING = "all of them"


class Condition(NamedTuple):
    """An assumption about the cell that rules out a case: a quantity stays on one side of a bound."""

    quantity: str
    side: str = ""  # "above" or "below"; "" where the quantity is the whole condition
    bound: float = 0.0
    unit: str = ""

    def text(self) -> str:
        """The condition as a clause: "friction stays below 1.35"."""
        return f"{self.quantity} stays {self.side} {self.value()}" if self.side else self.quantity

    def value(self) -> str:
        """The bound with its unit, as text."""
        return f"{self.bound:.3g}{self.unit}"

    def stricter(self, other: "Condition") -> bool:
        """Whether this condition is stricter than another one on the same quantity and side."""
        return self.bound < other.bound if self.side == "below" else self.bound > other.bound


class Case(NamedTuple):
    """A simulated world that differs from the plan's assumptions."""

    name: str  # the difference, in words
    changes: Mapping[str, Mapping[str, Any]] = MappingProxyType({})  # in the form of `Job.replaced`
    disturbance: Disturbance = NONE  # errors of the cell
    broken: Condition | None = None  # the assumption that the world violates

    def job(self, planned: Job) -> Job:
        """The job with the changes of this case: it states the true parts and gripper of the world.

        Raises:
            InputError: the changed job is invalid.
        """
        return planned.replaced(f"the world with {self.name}", **self.changes)

    def stated(self) -> dict[str, str]:
        """The changes as values of the option `--world-set`: the text of each value, by "section.key"."""
        return {
            f"{section}.{key}": str(value)
            for section, values in self.changes.items()
            for key, value in values.items()
        }


def standard_cases(job: Job) -> list[Case]:
    """Cases of `plan-evaluate --sweep`: the plan's world, then other pressures, frictions, encoders etc."""
    gripper, low, high = job.gripper, job.friction.finger_part_min, job.friction.finger_part_max
    share = gripper.upper_finger_share
    aside = [*_beside(share, 0.1), *_beside(share, 0.05)]
    return [
        Case(PLANNED),
        *(_pressure(kind) for kind in ("boundary", "uniform") if job.pressure.kind != kind),
        *([] if job.hypothesis else [on_three_feet(job)]),  # several parts have different corners
        *_other_surface(job),
        Case("10 degrees of freedom", {"pressure": {"wishart_dof": 10}}),
        friction(0.4 * low, 0.6 * low),
        friction(0.6 * low, low),
        friction(high, 1.5 * high),
        *(_encoder_off(mm) for mm in (-1.0, 1.0)),
        Case("encoder noise x 3", {"gripper": {"noise_mm": 3.0 * gripper.noise_mm}}),
        *(uneven(job, other, centred=False) for other in _beside(share, 0.02)),
        *(uneven(job, other, centred=True) for other in aside),
        Case("placement 0.5 mm, 0.5 deg", {}, Disturbance(placement_mm=0.5, placement_deg=0.5)),
        Case("arm off by 0.7 mm, 0.5 deg", {}, Disturbance(bias_mm=(0.5, 0.5), bias_deg=0.5)),
        *(outline_off(job, mm) for mm in (-0.3, 0.3) if not job.hypothesis),
    ]


def believed_cases(job: Job) -> list[Case]:
    """Cases that the job's doubts allow: each has one uncertain quantity at an end of its interval."""
    doubt, share, tolerance_mm = job.doubt, job.gripper.upper_finger_share, job.part.tolerance_mm
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    cases = [uneven(job, share + off, centred=True) for off in filter(None, doubt.finger_share)]
    for off in filter(None, doubt.middle_mm):
        broken = Condition("the fingers' distance from the hand's middle", "below", abs(off), " mm")
        cases.append(Case(f"fingers meet {off:+g} mm off", {}, Disturbance(across_mm=off), broken))
    cases += [_encoder_off(off) for off in filter(None, doubt.encoder_mm)]
    cases += [outline_off(job, off) for off in (-tolerance_mm, tolerance_mm) if off]
    if job.friction.doubt:
        cases += [
            friction(round(SLIPPERY * low, 3), low, Condition("friction", "above", low)),
            friction(high, round(ROUGH * high, 3), Condition("friction", "below", high)),
        ]
    if doubt.pressure != "stated" and job.pressure.limit_surface is not None:
        cases.append(on_three_feet(job))
    if job.pressure.limit_surface == "any":
        cases += _other_surface(job)
    if doubt.least_dof:
        name = f"{doubt.least_dof} degrees of freedom"
        broken = Condition(f"friction with the table scatters less than at {name}")
        cases.append(Case(name, {"pressure": {"wishart_dof": doubt.least_dof}}, broken=broken))
    return [case for case in cases if _stands(case, job)]


def _stands(case: Case, job: Job) -> bool:
    """Whether `job` is valid with the changes of a case; a finger share above 1 is not, for instance."""
    try:
        case.job(job)
    except InputError:
        return False
    return True


def offset_cases(job: Job) -> list[Case]:
    """Two cases in which the encoder's zero is shifted down or up by `OFFSET` times `Encoder.grain_mm`.

    The grain is the scatter of the readings of one width.
    """
    offset = OFFSET * encoder_of(job).grain_mm
    return [Case(f"encoder {mm:+.2f} mm", {}, Disturbance(mm)) for mm in (-offset, offset)]


def noise_cases(job: Job) -> list[Case]:
    """Cases without noise: each switches off one source of the job's noise, the last one all of them."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    sources = [Case("pressure", {"pressure": {"wishart_dof": STEADY_DOF}})]
    if high > low:
        sources.append(Case("friction", _bounds(0.5 * (low + high), 0.5 * (low + high))))
    if job.gripper.noise_mm > 0.0:
        sources.append(Case("encoder noise", {"gripper": {"noise_mm": 0.0}}))
    if job.release.shift_mm > 0.0 or job.release.turn_deg > 0.0:
        sources.append(Case("release", {"release": {"shift_mm": 0.0, "turn_deg": 0.0}}))
    everything = {name: part for case in sources for name, part in case.changes.items()}
    return [*sources, Case(EVERYTHING, everything)]


def friction_cases(job: Job) -> list[Case]:
    """Cases for control charts: the planned friction, then its interval multiplied by each of `FACTORS`."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    cases = [Case(PLANNED)]
    for factor in FACTORS:
        case = friction(round(low * factor, 6), round(high * factor, 6))
        cases.append(case._replace(name=case.name + BEYOND.get(factor, "")))
    return cases


def assumption_cases(job: Job) -> list[Case]:
    """Cases for a report: first the unchanged job, then cases that each break one assumption and name it."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    less, more = 0.5 * low, min(1.5 * high, MOST_FRICTION)
    noise, planned = 2.0 * job.gripper.noise_mm, job.gripper.upper_finger_share
    share = planned + (SLIGHTLY_UNEVEN if planned < 0.9 else -SLIGHTLY_UNEVEN)
    cases = [
        Case("as the job says"),
        _one_friction(f"friction only {low:g}", "above", low),
        _one_friction(f"friction only {high:g}", "below", high),
        _one_friction(f"friction {less:.3g}, half the lower bound", "above", less),
        _one_friction(f"friction {more:.3g}, 1.5 times the upper bound", "below", more),
        Case(
            f"encoder noise {noise:g} mm, twice as much",
            {"gripper": {"noise_mm": noise}},
            broken=Condition("the encoder's noise", "below", noise, " mm"),
        ),
        Case(
            f"the upper finger makes {100 * share:.3g} % of the way",
            {"gripper": {"upper_finger_share": share}},
            broken=_share(share, share > planned),
        ),
        Case(
            "parts shift by 0.5 mm and 1 degree when let go",
            {"release": {"shift_mm": 0.5, "turn_deg": 1.0}},
            broken=Condition("the shift of parts that are let go", "below", 0.5, " mm"),
        ),
    ]
    if job.pressure.kind in ("boundary", "uniform"):
        other = "uniform" if job.pressure.kind == "boundary" else "boundary"
        where = {"boundary": "with its rim", "uniform": "with its whole area"}[job.pressure.kind]
        pressed, broken = f"pressure {other}, not {job.pressure.kind}", f"parts press {where}"
        cases.append(_pressure(other)._replace(name=pressed, broken=Condition(broken)))
    return cases


def on_three_feet(job: Job) -> Case:
    """The case of a part that stands on three corners of its convex hull, those of the largest triangle."""
    corners = stances(job.part.outline_mm)
    widest = max(corners, key=lambda feet: abs(np.linalg.det(feet[1:] - feet[0])))
    points = {"kind": "points", "points_mm": np.round(widest, 6).tolist()}
    broken = Condition("parts do not stand on three feet")
    return Case("pressure on 3 feet", {"pressure": points}, broken=broken)


def friction(low: float, high: float, broken: Condition | None = None) -> Case:
    """The case in which the friction between finger and part lies from `low` to `high`.

    Both bounds are capped at `MOST_FRICTION`. `broken` is the assumption that the case violates, if any.
    """
    low, high = min(low, MOST_FRICTION), min(high, MOST_FRICTION)
    return Case(f"friction {low:g} to {high:g}", _bounds(low, high), broken=broken)


def _one_friction(name: str, side: str, mu: float) -> Case:
    """The case of constant friction `mu`; it is ruled out if friction stays on `side` of `mu`."""
    return Case(name, _bounds(mu, mu), broken=Condition("friction", side, mu))


def uneven(job: Job, share: float, centred: bool) -> Case:
    """The case of fingers that close unevenly: the upper one makes `share` of the closing.

    The fingers then meet beside the planned place, by (planned share - `share`) (opening - width). No width
    reveals this shift. If `centred`, the hand is calibrated such that the shift is 0 at the part's narrowest
    width, so that an uneven squeeze affects only how the part moves.
    """
    more = share - job.gripper.upper_finger_share
    name, changes = f"upper finger moves {share:.0%}", {"gripper": {"upper_finger_share": share}}
    case = Case(name, changes, broken=_share(share, more > 0.0))
    if not centred:
        return case
    across = Disturbance(across_mm=more * closing_mm(job))
    return case._replace(name=f"{name}, centred", disturbance=across)


def outline_off(job: Job, mm: float) -> Case:
    """The case of a part that is larger than planned by `mm` all around."""
    part = {"outline_mm": grown(job.part.outline_mm, mm), "symmetry": job.part.symmetry}
    broken = Condition("the distance of contours from the drawing", "below", abs(mm), " mm")
    return Case(f"outline {mm:+g} mm", {"part": part}, broken=broken)


def _encoder_off(mm: float) -> Case:
    """The case of an encoder that reads all widths too large by `mm`."""
    broken = Condition("the error of widths", "below" if mm > 0.0 else "above", mm, " mm")
    return Case(f"encoder {mm:+g} mm", {}, Disturbance(mm), broken)


def _share(share: float, more: bool) -> Condition:
    """The condition that the upper finger's share stays below `share`, or above it if `more` is false."""
    side = "below" if more else "above"
    return Condition("the upper finger's share of the way", side, 100.0 * share, " %")


def _beside(share: float, more: float) -> list[float]:
    """The two shares `share - more` and `share + more`, without a share outside 0 to 1."""
    return [round(other, 6) for other in (share - more, share + more) if 0.0 <= other <= 1.0]


def _other_surface(job: Job) -> list[Case]:
    """A list with the case of the other form of limit surface: quartic for an ellipsoid, or the reverse.

    The list is empty if the job states the limit surface itself.
    """
    form = job.pressure.limit_surface
    if form is None:
        return []
    form, other = ("quartic", "ellipsoid") if form == "quartic" else ("ellipsoid", "quartic")
    return [Case(f"{other}, not {form}", {"pressure": {"limit_surface": other}})]


def _pressure(kind: str) -> Case:
    return Case(f"pressure {kind}", {"pressure": {"kind": kind}})


def _bounds(low: float, high: float) -> dict[str, dict[str, float]]:
    return {"friction": {"finger_part_min": low, "finger_part_max": high}}
