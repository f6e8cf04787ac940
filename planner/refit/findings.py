"""Findings about a cell from its posterior: a sentence for each quantity, and the changes of the job."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.doubts import closing_mm
from planner.job.model import Job
from planner.mechanics.limit_surface import LimitSurface
from planner.refit.cells import Cells, Quantity
from planner.refit.posterior import Posterior

LEARNED = 0.4  # spread, as a share of the prior's, below which a quantity counts as learned
ENDS = (0.05, 0.95)  # quantiles that bound the interval in sentences and jobs
KEPT_DOUBT = 0.1  # `friction.doubt` in the job, at most, once both bounds are learned
SURE = 0.8  # least probability of another limit surface that replaces the job's
OFF_MM = 0.5  # distance of the fingers' meeting point from the middle that asks for repair
OFF = 0.02  # error of the upper finger's share that asks for repair
# Decimals of the values in a job.
DIGITS = {"finger_share": 4, "middle_mm": 3, "encoder_mm": 3, "encoder_gain": 5}


class Finding(NamedTuple):
    """Posterior mean and 90 % interval of one quantity, in the form of the JSON output.

    For `least_dof` the mean is the geometric one. For `pressure`, `mean` and `low_5` are both the
    probability of the job's limit surface, and `high_95` is the greatest probability of any surface.
    """

    quantity: str  # key in [doubt] or [friction], or "pressure"
    mean: float
    low_5: float
    high_95: float
    learned: bool  # whether the journals determine the quantity
    sentence: str  # the finding, for people


def findings(posterior: Posterior, cells: Cells) -> list[Finding]:
    """Returns a finding for each quantity of the space, then one for the pressure if it may differ."""
    results = [_finding(quantity, posterior, cells.job) for quantity in posterior.space.quantities]
    return results + ([_pressed(posterior)] if posterior.space.surfaces > 1 else [])


def _finding(quantity: Quantity, posterior: Posterior, job: Job) -> Finding:
    values = posterior.of(quantity.key)
    mean, spread = float(values.mean()), float(values.std())
    low, high = (float(end) for end in np.quantile(values, ENDS))
    sorted_pair = "finger_part" in quantity.key
    prior = (quantity.high - quantity.low) / np.sqrt(18.0 if sorted_pair else 12.0)
    learned = bool(spread < LEARNED * prior)
    if quantity.key == "least_dof":
        mean, low, high = np.exp([mean, low, high]).tolist()
    sentence = f"the journals do not tell {NAMES[quantity.key]}; what the job says stays"
    if learned:
        sentence = _sentence(quantity.key, mean, low, high, job)
    return Finding(quantity.key, mean, low, high, learned, sentence)


def _sentence(key: str, mean: float, low: float, high: float, job: Job) -> str:
    half = 0.5 * (high - low)
    if key == "finger_share":
        share = 100.0 * (job.gripper.upper_finger_share + mean)
        fault = min(abs(low), abs(high)) > OFF and low * high > 0.0
        advice = ": have the gripper looked at" if fault else ""
        return f"the upper finger makes {share:.1f} +- {100.0 * half:.1f} % of the closing{advice}"
    if key == "middle_mm":
        message = f"the fingers meet {mean:+.2f} +- {half:.2f} mm off the hand's middle on the narrowest side"
        # Where the hand was never centred on them, an uneven share of the closing has the same
        # effect.
        share = job.gripper.upper_finger_share - mean / closing_mm(job)
        uneven = f"{100.0 * share:.1f} +- {100.0 * half / closing_mm(job):.1f} %"
        fault = min(abs(low), abs(high)) > OFF_MM and low * high > 0.0
        as_if = f", as if the upper one made {uneven} of the closing: have the gripper looked at"
        return message + as_if * fault
    if key == "encoder_mm":
        return f"widths read {mean:+.2f} +- {half:.2f} mm too much"
    if key == "encoder_gain":
        return f"widths read {100.0 * mean:+.2f} +- {100.0 * half:.2f} % too much"
    if key == "least_dof":
        dof = job.pressure.wishart_dof
        return f"friction with the table scatters by {low:.0f} to {high:.0f} degrees of freedom, not {dof}"
    name = "least" if key == "finger_part_min" else "greatest"
    believed = getattr(job.friction, key)
    agrees = f", as stated ({believed:g})" if low <= believed <= high else f", not {believed:g}"
    return f"the {name} friction between finger and part is {low:.2f} to {high:.2f}{agrees}"


NAMES = {
    "finger_share": "how the fingers share the closing",
    "middle_mm": "where the fingers meet",
    "encoder_mm": "what widths read too much",
    "encoder_gain": "the encoder's gain",
    "least_dof": "how friction with the table scatters",
    "finger_part_min": "the least friction between finger and part",
    "finger_part_max": "the greatest friction between finger and part",
}


def _pressed(posterior: Posterior) -> Finding:
    shares = surface_shares(posterior)
    stated, best = float(shares[0]), float(shares.max())
    learned = bool(stated > 0.95 or stated < 0.05)
    sentence = f"the journals do not tell how parts press on the table (as stated: {stated:.0%})"
    if stated > 0.95:
        sentence = "parts press on the table as the job says"
    elif stated < 0.05:
        feet = "they may stand on feet or on a rim"
        sentence = f"parts do not press on the table as the job says: {feet}"
    return Finding("pressure", stated, stated, best, learned, sentence)


def surface_shares(posterior: Posterior) -> Array:
    """The probabilities (surfaces,) of the limit surfaces, the job's first."""
    numbers = posterior.cells[:, -1].astype(np.int64)
    return np.bincount(numbers, minlength=posterior.space.surfaces) / len(numbers)


def changes(posterior: Posterior, cells: Cells) -> Mapping[str, Mapping[str, Any]]:
    """The new values of the job by section and key; without values that the journals do not determine."""
    every = findings(posterior, cells)
    record = {finding.quantity: finding for finding in every if finding.learned}
    doubt: dict[str, Any] = {
        key: [round(record[key].low_5, digits), round(record[key].high_95, digits)]
        for key, digits in DIGITS.items()
        if key in record
    }
    if "least_dof" in record:
        doubt["least_dof"] = max(3, int(record["least_dof"].low_5))
    sections: dict[str, dict[str, Any]] = {"doubt": doubt, "friction": _friction(record, cells.job)}
    if "pressure" in record:
        sections["pressure"], doubt["pressure"] = _pressure(posterior, cells)
    return {section: values for section, values in sections.items() if values}


def _friction(learned: Mapping[str, Finding], job: Job) -> dict[str, Any]:
    """The new values of [friction] by key; none if the journals determine neither bound.

    The new bounds are the 5 % quantile of the least and the 95 % quantile of the greatest friction. A bound
    that the journals do not determine stays the same. If they determine both, the key `doubt` of [friction]
    becomes at most `KEPT_DOUBT`.
    """
    keys = ("finger_part_min", "finger_part_max")
    if not any(key in learned for key in keys):
        return {}
    low, high = (getattr(job.friction, key) for key in keys)
    low = round(learned[keys[0]].low_5, 3) if keys[0] in learned else low
    high = round(learned[keys[1]].high_95, 3) if keys[1] in learned else high
    doubt = job.friction.doubt
    if all(key in learned for key in keys):
        doubt = min(doubt, KEPT_DOUBT)
    return {keys[0]: min(low, high), keys[1]: max(low, high), "doubt": doubt}


def _pressure(posterior: Posterior, cells: Cells) -> tuple[dict[str, Any], str]:
    """Returns the new values of [pressure] by key, and the new value of the key `pressure` in [doubt]."""
    shares = surface_shares(posterior)
    best = int(np.argmax(shares))
    if best == 0:
        return {}, "stated"
    surface = cells.simulator.others[best - 1]
    if shares[best] < SURE:
        return {}, "any"
    if isinstance(surface, LimitSurface):
        matrix = [[round(float(entry), 6) for entry in row] for row in surface.A]
        return {"kind": "stated", "ellipsoid": matrix, "rho_mm": round(surface.rho_mm, 6)}, "stated"
    form = {"quartic": surface.coefficients.tolist(), "certificate": surface.certificate.tolist()}
    return {"kind": "identified", **form, "rho_mm": surface.rho_mm}, "stated"
