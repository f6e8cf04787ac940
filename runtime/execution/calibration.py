"""Calibration of one gripper's widths with gauge blocks, stored in one JSON file per gripper."""

import json
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

from drivers.ports import Gripper, GripperProfile, ObjectState, Settled
from runtime.errors import GripperStateError
from runtime.execution.middle import Middle
from runtime.execution.reading import CLOSED_UM, check_fresh
from runtime.execution.safety import stroke
from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import writing
from runtime.table import PROFILES, Calibration
from runtime.table.grippers import known

FORMAT = 2
LEAST_BLOCKS = 3
LOOSE_UM = 9_400  # how far the jaws open beyond the block between two grips
# Number of intervals of a calibration from 0 to the stroke, and of further ones beyond either end.
POINTS, BEYOND = 64, 8
OTHER = 0.02  # difference of two strokes, as a share, from which they are of two models


class Gauge(NamedTuple):
    """Readings of one gauge block."""

    width_mm: float  # 0 for closed fingers
    readings_um: tuple[int, ...]  # settled, one for each grip

    @property
    def mean(self) -> float:
        """Mean of the readings, um."""
        return sum(self.readings_um) / len(self.readings_um)

    @property
    def spread_um(self) -> int:
        """Largest difference between two readings, um."""
        return max(self.readings_um) - min(self.readings_um)


@dataclass(frozen=True, slots=True)
class GripperCalibration:
    """The measured calibration of one gripper: the gauged blocks, and the widths derived from them."""

    gripper: str  # name or serial number of the gripper, as the operator gave it
    date: str  # date of the calibration, ISO 8601
    gauges: tuple[Gauge, ...]  # the blocks, in order of ascending width
    points_um: tuple[tuple[int, int], ...]  # nominal and true widths
    # link and offset of the tips' arc, mm, if measured
    tips_mm: tuple[float, float] | None = None
    # least and greatest current at rest on a part, if measured
    current_ma: tuple[int, int] | None = None
    middle: Middle | None = None  # where the fingers meet, if measured

    def of(self, profile: GripperProfile) -> Calibration:
        """Builds the map from nominal to true widths, for a gripper with this profile.

        Raises:
            InputError: the calibrated jaws open by more or less than those of the profile's model.
        """
        preset = known(profile.model)
        stroke_um = self.points_um[-1][0] * POINTS / (POINTS + BEYOND)
        if preset is not None and abs(stroke_um - preset.stroke_um) > OTHER * preset.stroke_um:
            opens = f"opens {stroke_um / 1000:.3g} mm, a {profile.model} {preset.stroke_um / 1000:.3g} mm"
            raise InputError(
                f"the gripper of the calibration ({self.gripper}) {opens}; name its own"
            )
        return Calibration(profile, self.points_um)


def measure(
    gripper: Gripper, widths_mm: Sequence[float], grips: int, ask: Callable[[str], object]
) -> Iterator[Gauge]:
    """Grips each block `grips` times, and yields the readings of each block as a gauge.

    Args:
        gripper: the gripper to measure.
        widths_mm: widths of the blocks, in ascending order; 0: the fingers close on nothing.
        grips: how often each block is gripped.
        ask: shows a request to the operator, and waits until it is fulfilled.

    Raises:
        GripperStateError: the gripper is not ready, or closed without meeting the block.
    """
    profile = gripper.profile
    for width_mm in widths_mm:
        _open(gripper)
        if width_mm > 0.0:
            ask(f"Hold the {width_mm:g} mm block between the fingers and press Enter.")
        else:
            ask("Take everything out from between the fingers and press Enter.")
        readings_um = []
        for _ in range(grips):
            settled = _stroke(gripper, CLOSED_UM)
            if width_mm > 0.0 and settled.object is not ObjectState.CLOSING:
                raise GripperStateError(
                    f"the fingers closed without meeting the {width_mm:g} mm block; begin again"
                )
            readings_um.append(settled.width_um)
            loose_um = min(settled.width_um + LOOSE_UM, profile.stroke_um)
            _stroke(gripper, profile.reading_um(profile.step(loose_um)))
        yield Gauge(width_mm, tuple(readings_um))
    _open(gripper)


def _open(gripper: Gripper) -> None:
    _stroke(gripper, gripper.profile.stroke_um, fast=True)


def _stroke(gripper: Gripper, width_um: int, *, fast: bool = False) -> Settled:
    """Moves the jaws with the least force, gently or (`fast`) at the greatest speed; returns the reading."""
    profile = gripper.profile
    speed_mm_s = profile.speed_mm_s[1] if fast else profile.gentle_mm_s
    settled = stroke(gripper, width_um, speed_mm_s, profile.force_n[0])
    check_fresh(settled, width_um)
    return settled


def fit(
    gauges: Sequence[Gauge], profile: GripperProfile, gripper: str, date: str
) -> GripperCalibration:
    """Computes the calibration whose curve passes through the mean reading of every block.

    Args:
        gauges: the readings of at least `LEAST_BLOCKS` blocks.
        profile: profile of the gripper.
        gripper: name or serial number of the gripper.
        date: date of the calibration, ISO 8601.

    Raises:
        InputError: too few blocks, two blocks of one width, or a wider block without a larger reading.
    """
    ordered = sorted(gauges)
    if len({gauge.width_mm for gauge in ordered}) < max(LEAST_BLOCKS, len(ordered)):
        raise InputError(
            f"{len(ordered)} gauge blocks; measure at least {LEAST_BLOCKS} of different widths"
        )
    for narrow, wide in pairwise(ordered):
        if wide.mean <= narrow.mean:
            raise InputError(
                f"the {wide.width_mm:g} mm block read {wide.mean / 1000:.2f} mm and the "
                f"{narrow.width_mm:g} mm block {narrow.mean / 1000:.2f} mm; a wider one reads more, "
                "measure both again"
            )
    width_mm = curve(ordered)
    readings = [profile.stroke_um * k // POINTS for k in range(-BEYOND, POINTS + BEYOND + 1)]
    widths = (max(round(1000 * width_mm(reading)), 0) for reading in readings)
    # Rounded to um, a width might be less than the one before it: `accumulate` takes the larger.
    points = tuple(zip(readings, accumulate(widths, max), strict=True))
    return GripperCalibration(gripper, date, tuple(ordered), points)


def residuals_mm(calibration: GripperCalibration) -> list[float]:
    """How well the blocks agree: for each block, the error, mm, of a curve through the other blocks.

    The narrowest and the widest block are left out.
    """
    gauges = calibration.gauges
    return [
        curve([*gauges[:k], *gauges[k + 1 :]])(gauges[k].mean) - gauges[k].width_mm
        for k in range(1, len(gauges) - 1)
    ]


def save(calibration: GripperCalibration, path: Path) -> None:
    """Writes a calibration to a file.

    Raises:
        OutputError: the file cannot be written.
    """
    gauges = [gauge._asdict() for gauge in calibration.gauges]
    middle = None if calibration.middle is None else calibration.middle._asdict()
    body = {"format": FORMAT, **asdict(calibration), "gauges": gauges, "middle": middle}
    text = json.dumps({**body, "sha256": strict_json.digest(body)}, indent=1) + "\n"
    with writing(path) as draft:
        draft.write_text(text, encoding="ascii")


class CalibrationFile(NamedTuple):
    """A calibration, and the bytes of its file, which a signature may cover."""

    calibration: GripperCalibration
    data: bytes


def load(path: Path) -> CalibrationFile:
    """Reads a calibration from a file, and checks it.

    The file is read only once, so that the returned bytes are those that were checked.

    Raises:
        InputError: the file cannot be read, was changed by hand, or has widths that do not rise.
    """

    def refused(problem: str) -> InputError:
        remedy = "make it again with grasp-calibrate width"
        return InputError(f"calibration {path}: {problem}; {remedy}")

    data = strict_json.data_of(path, refused)
    record = strict_json.value_of(data, refused)
    try:
        return CalibrationFile(_parsed(record), data)
    except (LookupError, TypeError, ValueError, InputError) as error:
        raise refused(str(error)) from error


def _parsed(record: object) -> GripperCalibration:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"is no calibration of format {FORMAT}")
    body = {name: value for name, value in record.items() if name != "sha256"}
    if record.get("sha256") != strict_json.digest(body):
        raise InputError("does not have its digest: it was changed after it was measured")
    gauges = tuple(
        Gauge(float(row["width_mm"]), tuple(map(int, row["readings_um"])))
        for row in record["gauges"]
    )
    tips, current = record["tips_mm"], record["current_ma"]
    result = GripperCalibration(
        str(record["gripper"]),
        str(record["date"]),
        gauges,
        tuple((int(nominal), int(true)) for nominal, true in record["points_um"]),
        None if tips is None else (float(tips[0]), float(tips[1])),
        None if current is None else (int(current[0]), int(current[1])),
        Middle.parsed(record.get("middle")),
    )
    Calibration(next(iter(PROFILES.values())), result.points_um)  # refuses points that fall
    return result


def curve(gauges: Sequence[Gauge]) -> Callable[[float], float]:
    """The width, mm, as a function of the reading, um: a monotone cubic spline through the gauged points.

    The slope of the curve is continuous (Fritsch, Carlson, SIAM J. Numer. Anal. 17, 1980). Beyond the
    outermost points the curve continues straight.
    """
    points = sorted((gauge.mean, gauge.width_mm) for gauge in gauges)
    x = [reading_um for reading_um, _ in points]
    y = [width_mm for _, width_mm in points]
    secants = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(points)]
    # Harmonic means of the secants inside, the outermost secants at the ends.
    inner = [2.0 * a * b / (a + b) for a, b in pairwise(secants)]
    slope = [secants[0], *inner, secants[-1]]

    def at(reading_um: float) -> float:
        if reading_um <= x[0]:
            return y[0] + slope[0] * (reading_um - x[0])
        if reading_um >= x[-1]:
            return y[-1] + slope[-1] * (reading_um - x[-1])
        k = bisect_left(x, reading_um) - 1
        h = x[k + 1] - x[k]
        t = (reading_um - x[k]) / h
        return (
            y[k] * (1 + 2 * t) * (1 - t) ** 2
            + slope[k] * h * t * (1 - t) ** 2
            + y[k + 1] * t**2 * (3 - 2 * t)
            + slope[k + 1] * h * t**2 * (t - 1)
        )

    return at
