"""One audit: take a picture, check the camera, measure the part, compare it with what the leaf says."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.camera.audit import explain, overlay
from drivers.camera.audit.judge import FAIL, PASS, UNKNOWN, Judgement, judge
from drivers.camera.calibration import drift
from drivers.camera.calibration.file import CameraCalibration
from drivers.camera.errors import CameraError
from drivers.camera.vision.arrays import Array, Picture
from drivers.camera.vision.measure import Measured, measure
from drivers.camera.vision.sources import Source
from drivers.camera.vision.tag_file import PartTag, Pose
from drivers.camera.vision.tags import Finder
from runtime.table import GoalSpec


@dataclass(frozen=True, slots=True)
class Answer:
    """What the audit says of one part.

    Attributes:
        verdict: "pass", "fail" or "unknown".
        reason: one sentence.
        measured: pose of the part: mm, mm, rad; None where there is no measurement.
        residual: measured less predicted, under the symmetry.
        distance: eq. 9 in mm; for tolerances the largest deviation in units of its own.
        error: by how much it may be off.
        moved_mm: greatest motion of a reference tag.
        picture: file of the overlay, None where none was kept.
    """

    verdict: str
    reason: str
    measured: Pose | None = None
    residual: Pose | None = None
    distance: float | None = None
    error: float | None = None
    moved_mm: float | None = None
    picture: str | None = None

    def fields(self) -> dict[str, object]:
        """The answer as JSON holds it, units in the names, what is not known left out."""
        told: dict[str, object] = {"verdict": self.verdict, "reason": self.reason}
        for prefix, pose in (("measured", self.measured), ("residual", self.residual)):
            if pose is not None:
                names = (f"{prefix}_{name}" for name in ("x_mm", "y_mm", "theta_rad"))
                told |= dict(zip(names, (round(value, 6) for value in pose), strict=True))
        for name in ("distance", "error", "moved_mm"):
            value = getattr(self, name)
            if value is not None:
                told[name] = round(value, 6)
        if self.picture is not None:
            told["picture"] = self.picture
        return told


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is audited.

    Attributes:
        goal: of the table.
        tag: the part's.
        outline_mm: (n, 2) in the part's frame, for overlays; None: not known.
        poses_of: further poses that the leaf of a predicted pose allows.
    """

    goal: GoalSpec
    tag: PartTag
    outline_mm: Array | None = None
    poses_of: Callable[[Pose], Sequence[Pose]] = field(default=lambda pose: (pose,))


class Auditor:
    """Audits parts with one camera.

    Args:
        source: takes the pictures.
        calibration: of the camera.
        subject: what is audited.
        limit_mm: by how much reference tags may have moved.
        pictures: folder for overlays of what did not pass, None: none are kept.
    """

    def __init__(
        self,
        source: Source,
        calibration: CameraCalibration,
        subject: Subject,
        limit_mm: float = drift.LIMIT_MM,
        pictures: Path | None = None,
    ) -> None:
        self._source = source
        self._calibration = calibration
        self._subject = subject
        self._limit_mm = limit_mm
        self._album = None if pictures is None else overlay.Album(pictures)
        self._finder = Finder()

    def audit(self, part: int, predicted: Pose, until: float) -> Answer:
        """Judge one part. Whatever is wrong with the camera, the verdict is "unknown" and says why.

        Args:
            part: its number.
            predicted: pose at its leaf: mm, mm, rad.
            until: `time.monotonic` at which a picture must be there.
        """
        try:
            picture = self._source.picture(until)
        except CameraError as error:
            return Answer(UNKNOWN, str(error))
        found: Measured | None = None
        try:
            found, moved_mm = self._measured(picture, predicted)
            answer = self._answer(found, moved_mm, predicted)
        except CameraError as error:
            answer = Answer(UNKNOWN, str(error))
        return self._kept(answer, part, picture, found, predicted)

    def _measured(self, picture: Picture, predicted: Pose) -> tuple[Measured, float]:
        self._calibration.check_size(picture.shape)
        explain.check_exposure(picture)
        seen = self._finder.find(picture)
        view, references = self._calibration.view, self._calibration.references
        moved_mm = drift.check(references, seen, view, self._limit_mm)
        return measure(picture, seen, self._calibration, self._subject.tag, predicted), moved_mm

    def _answer(self, found: Measured, moved_mm: float, predicted: Pose) -> Answer:
        allowed = self._subject.poses_of(predicted)
        judged = judge(self._subject.goal, allowed, found.pose, found.sigma_mm, found.sigma_rad)
        return Answer(
            judged.verdict,
            sentence(judged, self._subject.goal),
            found.pose,
            judged.residual,
            judged.distance,
            judged.error,
            moved_mm,
        )

    def _kept(
        self, answer: Answer, part: int, picture: Picture, found: Measured | None, predicted: Pose
    ) -> Answer:
        if self._album is None or answer.verdict == PASS:
            return answer
        drawn = overlay.draw(
            picture,
            self._calibration.view,
            self._subject,
            predicted,
            found,
            f"{answer.verdict}: {answer.reason}",
        )
        path = self._album.keep(part, answer.verdict, drawn)
        return answer if path is None else replace(answer, picture=str(path))


def sentence(judged: Judgement, goal: GoalSpec) -> str:
    """What a judgement says, in words."""
    x, y, theta = judged.residual
    off = f"x {x:+.2f} mm, y {y:+.2f} mm, angle {math.degrees(theta):+.2f} deg off"
    unit = " mm" if goal.kind in ("pose", "modes") else " of the tolerance"
    distance = f"{judged.distance:.2f} +- {judged.error:.2f}{unit}, allowed {judged.threshold:g}"
    words: Mapping[str, str] = {PASS: "within the goal", FAIL: "not within the goal"}
    return f"{words.get(judged.verdict, 'too close to call')}: {distance} ({off})"
