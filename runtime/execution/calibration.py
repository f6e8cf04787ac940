"""A gripper's own count-to-width table, made with gauge blocks; one JSON file a gripper."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

from drivers.ports import Gripper
from runtime.errors import GripperStateError
from runtime.execution.middle import Middle
from runtime.execution.reading import CLOSED_COUNTS, check_fresh
from runtime.execution.safety import stroke
from runtime.execution.strokes import GENTLE_FORCE, GENTLE_SPEED
from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import read_regular, writing
from runtime.table import COUNTS, Calibration, GripperSpec
from runtime.traversal.decision import CLOSING_CONTACT

FORMAT = 1
LEAST_BLOCKS = 3


class Gauge(NamedTuple):
    """One gauge block as the gripper read it."""

    width_mm: float  # 0 for closed fingers
    counts: tuple[int, ...]  # settled, one a grip

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
    """What is known of one gripper."""

    gripper: str  # its name or serial number, as the operator gave it
    date: str  # of the calibration, ISO 8601
    gauges: tuple[Gauge, ...]  # the blocks, in the order of rising width
    widths_um: tuple[int, ...]  # 256 widths
    # link and offset of the tips' arc, mm, where they were measured
    tips_mm: tuple[float, float] | None = None
    # least and greatest current at rest on a part, where they were measured
    current_ma: tuple[int, int] | None = None
    middle: Middle | None = None  # where the fingers meet, where that was measured

    @property
    def table(self) -> Calibration:
        """Counts to widths, as the look-up takes them."""
        return Calibration(self.widths_um)


def measure(
    gripper: Gripper, widths_mm: Sequence[float], grips: int, ask: Callable[[str], object]
) -> Iterator[Gauge]:
    """Grip each block so many times, and yield a gauge for each.

    The blocks come in rising order, 0 for none; `ask` shows the operator a sentence and waits.

    Raises:
        GripperStateError: the gripper is not ready, or closed without meeting the block.
    """
    for width_mm in widths_mm:
        _stroke(gripper, 0, 255)
        if width_mm > 0.0:
            ask(f"Hold the {width_mm:g} mm block between the fingers and press Enter.")
        else:
            ask("Take everything out from between the fingers and press Enter.")
        counts = []
        for _ in range(grips):
            count, flag = _stroke(gripper, CLOSED_COUNTS, GENTLE_SPEED)
            if width_mm > 0.0 and flag != CLOSING_CONTACT:
                raise GripperStateError(
                    f"the fingers closed without meeting the {width_mm:g} mm block; begin again"
                )
            counts.append(count)
            _stroke(gripper, max(count - 25, 0), 0)
        yield Gauge(width_mm, tuple(counts))
    _stroke(gripper, 0, 255)


def _stroke(gripper: Gripper, position_counts: int, speed_counts: int) -> tuple[int, int]:
    settled = stroke(gripper, position_counts, speed_counts, GENTLE_FORCE)
    check_fresh(settled, position_counts)
    return settled.position_counts, settled.object_flag


def fit(gauges: Sequence[Gauge], gripper: str, date: str) -> GripperCalibration:
    """The calibration that passes through gauged widths, at least `LEAST_BLOCKS` of them.

    Raises:
        InputError: too few blocks, or a wider one that did not read a smaller count.
    """
    ordered = sorted(gauges)
    if len({gauge.width_mm for gauge in ordered}) < max(LEAST_BLOCKS, len(ordered)):
        raise InputError(
            f"{len(ordered)} gauge blocks; measure at least {LEAST_BLOCKS} of different widths"
        )
    for narrow, wide in pairwise(ordered):
        if wide.mean >= narrow.mean:
            raise InputError(
                f"the {wide.width_mm:g} mm block read count {wide.mean:.1f} and the {narrow.width_mm:g} mm "
                f"block {narrow.mean:.1f}; a wider one reads less, measure both again"
            )
    curve = Curve(ordered)
    widths = (max(round(1000 * curve.at(count)), 0) for count in range(COUNTS))
    # A block's mean count is rarely whole; rounding must not make a width rise by a micrometre.
    return GripperCalibration(gripper, date, tuple(ordered), tuple(accumulate(widths, min)))


def residuals_mm(calibration: GripperCalibration) -> list[float]:
    """For each block but the outermost: what the fit without it says at its count, less its width, mm."""
    gauges = calibration.gauges
    return [
        Curve([*gauges[:k], *gauges[k + 1 :]]).at(gauges[k].mean) - gauges[k].width_mm
        for k in range(1, len(gauges) - 1)
    ]


def against_linear_mm(calibration: GripperCalibration, spec: GripperSpec) -> list[float]:
    """For each block: what the linear map of a table's gripper says at its count, less its width, mm."""
    linear = Calibration.linear(spec)
    return [
        linear.width_um(round(gauge.mean)) / 1000 - gauge.width_mm for gauge in calibration.gauges
    ]


def save(calibration: GripperCalibration, path: Path) -> None:
    """Write the file.

    Raises:
        OutputError: it cannot be written.
    """
    body = _body(calibration)
    text = json.dumps({**body, "sha256": strict_json.digest(body)}, indent=1) + "\n"
    with writing(path) as draft:
        draft.write_text(text, encoding="ascii")


def load(path: Path) -> GripperCalibration:
    """Read and check a file.

    Raises:
        InputError: it cannot be read, was changed by hand, or is not monotone.
    """

    def refused(problem: str) -> InputError:
        return InputError(
            f"calibration {path}: {problem}; make it again with grasp-calibrate width"
        )

    record = strict_json.load(path, refused)
    try:
        return _parsed(record)
    except (LookupError, TypeError, ValueError, InputError) as error:
        raise refused(str(error)) from error


def bytes_of(path: Path) -> bytes:
    """The bytes of a file that `load` accepts.

    Raises:
        InputError: as `load`.
    """
    load(path)
    try:
        return read_regular(path, strict_json.MOST_BYTES)[0]
    except OSError as error:
        raise InputError(f"calibration {path}: cannot be read: {error.strerror}") from error


def _parsed(record: object) -> GripperCalibration:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"is no calibration of format {FORMAT}")
    body = {name: value for name, value in record.items() if name != "sha256"}
    if record.get("sha256") != strict_json.digest(body):
        raise InputError("does not have its digest: it was changed after it was measured")
    gauges = tuple(Gauge(float(row["width_mm"]), tuple(row["counts"])) for row in record["gauges"])
    tips, current = record["tips_mm"], record["current_ma"]
    result = GripperCalibration(
        str(record["gripper"]),
        str(record["date"]),
        gauges,
        tuple(record["widths_um"]),
        None if tips is None else (float(tips[0]), float(tips[1])),
        None if current is None else (int(current[0]), int(current[1])),
        Middle.parsed(record.get("middle")),
    )
    Calibration(result.widths_um)
    return result


def _body(calibration: GripperCalibration) -> dict[str, object]:
    gauges = [gauge._asdict() for gauge in calibration.gauges]
    middle = None if calibration.middle is None else calibration.middle._asdict()
    return {"format": FORMAT, **asdict(calibration), "gauges": gauges, "middle": middle}


class Curve:
    """The monotone cubic through gauged (count, width in mm), straight beyond its ends.

    Its slope is continuous, as that of the fingers' arc is (Fritsch, Carlson, SIAM J. Numer. Anal. 17, 1980).
    """

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
