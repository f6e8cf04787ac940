"""A gripper's own count-to-width table, made with gauge blocks; one JSON file a gripper.

Between the gauged widths the table follows a monotone cubic (Fritsch and Carlson, SIAM J. Numer. Anal. 17,
1980): it passes through every block, never rises with the count, and its slope is continuous, as that of the
fingers' arc is. Beyond the outermost blocks it goes on straight, and ends at zero.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from runtime.errors import CalibrationError, TableError
from runtime.shell import strict_json
from runtime.shell.files import writing
from runtime.table import Calibration, GripperSpec

FORMAT = 1
COUNTS = 256
LEAST_BLOCKS = 3
MAX_FILE_BYTES = 1 << 20


class Gauge(NamedTuple):
    """One gauge block as the gripper read it.

    Attributes:
        width_mm: the block, mm; 0 for closed fingers.
        counts: settled counts, one a grip.
    """

    width_mm: float
    counts: tuple[int, ...]

    @property
    def mean(self) -> float:
        """Mean count."""
        return sum(self.counts) / len(self.counts)

    @property
    def spread(self) -> int:
        """Greatest difference between two grips, counts."""
        return max(self.counts) - min(self.counts)


@dataclass(frozen=True, slots=True)
class GripperCalibration:
    """What is known of one gripper.

    Attributes:
        gripper: its name or serial number, as the operator gave it.
        made: when, ISO 8601.
        gauges: the blocks, in the order of rising width.
        widths_um: 256 widths.
        tips: link and offset of the tips' arc, mm, where they were measured.
        current_ma: least and greatest current at rest on a part, where they were measured.
    """

    gripper: str
    made: str
    gauges: tuple[Gauge, ...]
    widths_um: tuple[int, ...]
    tips: tuple[float, float] | None = None
    current_ma: tuple[int, int] | None = field(default=None)

    @property
    def table(self) -> Calibration:
        """Counts to widths, as the look-up takes them."""
        return Calibration(self.widths_um)


def fit(gauges: Sequence[Gauge], gripper: str, made: str) -> GripperCalibration:
    """The calibration that passes through gauged widths.

    Args:
        gauges: at least `LEAST_BLOCKS` of different widths.
        gripper: name or serial number.
        made: when.

    Raises:
        CalibrationError: too few blocks, or a wider one that did not read a smaller count.
    """
    ordered = sorted(gauges)
    if len({gauge.width_mm for gauge in ordered}) < max(LEAST_BLOCKS, len(ordered)):
        raise CalibrationError(
            f"{len(ordered)} gauge blocks; measure at least {LEAST_BLOCKS} of different widths"
        )
    for narrow, wide in pairwise(ordered):
        if wide.mean >= narrow.mean:
            raise CalibrationError(
                f"the {wide.width_mm:g} mm block read count {wide.mean:.1f} and the {narrow.width_mm:g} mm "
                f"block {narrow.mean:.1f}; a wider one reads less, measure both again"
            )
    widths = _interpolated(ordered)
    return GripperCalibration(gripper, made, tuple(ordered), widths)


def residuals_mm(calibration: GripperCalibration) -> list[float]:
    """For each block but the outermost: what the fit without it says at its count, less its width, mm."""
    gauges = calibration.gauges
    found = []
    for index in range(1, len(gauges) - 1):
        others = [*gauges[:index], *gauges[index + 1 :]]
        found.append(Curve(others).at(gauges[index].mean) - gauges[index].width_mm)
    return found


def against_linear_mm(calibration: GripperCalibration, spec: GripperSpec) -> list[float]:
    """For each block: what the linear map of a table's gripper says at its count, less its width, mm."""
    linear = Calibration.linear(spec)
    return [linear.width_um(round(gauge.mean)) / 1000 - gauge.width_mm for gauge in calibration.gauges]


def save(calibration: GripperCalibration, path: Path) -> None:
    """Write the file.

    Raises:
        CalibrationError: it cannot be written.
    """
    body = _body(calibration)
    text = json.dumps({**body, "sha256": _digest(body)}, indent=1) + "\n"
    try:
        with writing(path) as draft:
            draft.write_text(text, encoding="ascii")
    except OSError as error:
        raise CalibrationError(f"calibration {error}") from error


def load(path: Path) -> GripperCalibration:
    """Read and check a file.

    Raises:
        CalibrationError: it cannot be read, was changed by hand, or is not monotone.
    """
    try:
        with path.open("rb") as file:
            told = strict_json.parse(file.read(MAX_FILE_BYTES))
    except OSError as error:
        raise CalibrationError(f"calibration {path}: {error.strerror}") from error
    except ValueError as error:
        raise CalibrationError(f"calibration {path}: is {error}; measure again") from error
    try:
        return _parsed(told)
    except (LookupError, TypeError, ValueError, TableError, CalibrationError) as error:
        raise CalibrationError(
            f"calibration {path}: {error}; make it again with grasp-calibrate width"
        ) from error


def _parsed(told: object) -> GripperCalibration:
    if not isinstance(told, dict) or told.get("format") != FORMAT:
        raise CalibrationError(f"is no calibration of format {FORMAT}")
    body = {name: value for name, value in told.items() if name != "sha256"}
    if told.get("sha256") != _digest(body):
        raise CalibrationError("does not have its digest: it was changed after it was measured")
    gauges = tuple(Gauge(float(row["width_mm"]), tuple(row["counts"])) for row in told["gauges"])
    tips, current = told["tips_mm"], told["current_ma"]
    made = GripperCalibration(
        str(told["gripper"]),
        str(told["made"]),
        gauges,
        tuple(told["widths_um"]),
        None if tips is None else (float(tips[0]), float(tips[1])),
        None if current is None else (int(current[0]), int(current[1])),
    )
    Calibration(made.widths_um)
    return made


def _body(calibration: GripperCalibration) -> dict[str, object]:
    return {
        "format": FORMAT,
        "gripper": calibration.gripper,
        "made": calibration.made,
        "gauges": [
            {"width_mm": gauge.width_mm, "counts": list(gauge.counts)} for gauge in calibration.gauges
        ],
        "widths_um": list(calibration.widths_um),
        "tips_mm": None if calibration.tips is None else list(calibration.tips),
        "current_ma": None if calibration.current_ma is None else list(calibration.current_ma),
    }


def _digest(body: dict[str, object]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _interpolated(gauges: Sequence[Gauge]) -> tuple[int, ...]:
    curve = Curve(gauges)
    widths = [max(round(1000 * curve.at(count)), 0) for count in range(COUNTS)]
    # A block's mean count is rarely whole; rounding must not make a width rise by a micrometre.
    for count in range(1, COUNTS):
        widths[count] = min(widths[count], widths[count - 1])
    return tuple(widths)


class Curve:
    """The monotone cubic through gauged (count, width), straight beyond its ends. Widths in mm."""

    def __init__(self, gauges: Sequence[Gauge]) -> None:
        points = sorted((gauge.mean, gauge.width_mm) for gauge in gauges)
        self._x = [x for x, _ in points]
        self._y = [y for _, y in points]
        self._slope = _slopes(self._x, self._y)

    def at(self, count: float) -> float:
        """The width at a count, mm."""
        x, y, slope = self._x, self._y, self._slope
        if count <= x[0]:
            return y[0] + slope[0] * (count - x[0])
        if count >= x[-1]:
            return y[-1] + slope[-1] * (count - x[-1])
        k = next(k for k in range(len(x) - 1) if count <= x[k + 1])
        h = x[k + 1] - x[k]
        t = (count - x[k]) / h
        return (
            y[k] * (1 + 2 * t) * (1 - t) ** 2
            + slope[k] * h * t * (1 - t) ** 2
            + y[k + 1] * t**2 * (3 - 2 * t)
            + slope[k + 1] * h * t**2 * (t - 1)
        )


def _slopes(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Slopes at the points: harmonic means of the secants inside, the outermost secants at the ends."""
    secants = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(zip(x, y, strict=True))]
    inner = [2.0 * a * b / (a + b) for a, b in pairwise(secants)]
    return [secants[0], *inner, secants[-1]]
