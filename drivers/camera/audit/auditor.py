"""Audits one part: takes a picture, checks the camera, and compares measured and predicted pose."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.camera.audit import overlay
from drivers.camera.audit.subject import Subject
from drivers.camera.calibration import drift
from drivers.camera.calibration.file import CameraCalibration
from drivers.camera.calibration.measure import Measured, measure
from drivers.camera.vision import explain
from drivers.camera.vision.sources import Source
from drivers.camera.vision.tags import find
from drivers.planar import Pose2
from runtime.shell.errors import ExpectedError
from runtime.table import GoalSpec, distance, residual, threshold

PASS, FAIL, UNKNOWN = "pass", "fail", "unknown"
COVERAGE = 3.0  # standard deviations that a measurement has to be clear of the threshold


@dataclass(frozen=True, slots=True)
class Answer:
    """Verdict of the audit on one part, with the reason and what was measured."""

    verdict: str  # "pass", "fail" or "unknown"
    reason: str  # one sentence
    # Pose of the part: mm, mm, rad; None without a measurement.
    measured: Pose2 | None = None
    # Measured minus predicted pose; the angle modulo the part's symmetry.
    residual: Pose2 | None = None
    # Error of the predicted pose: by eq. 9, mm, for goals "pose" and "modes"; for "tolerances" and
    # "orientation" the largest ratio of a deviation to its tolerance.
    distance: float | None = None
    error: float | None = None  # `COVERAGE` standard deviations of `distance`
    moved_mm: float | None = None  # greatest motion of a reference tag since the calibration
    # Name of the part whose tag is seen, if the table is for several parts.
    hypothesis: str | None = None
    picture: str | None = None  # file of the overlay, None without one

    def fields(self) -> dict[str, object]:
        """Returns the known fields of the answer for a JSON object, with units in their names."""
        record: dict[str, object] = {"verdict": self.verdict, "reason": self.reason}
        for prefix, pose in (("measured", self.measured), ("residual", self.residual)):
            if pose is not None:
                names = (f"{prefix}_{name}" for name in ("x_mm", "y_mm", "theta_rad"))
                record |= dict(zip(names, (round(value, 6) for value in pose), strict=True))
        figures = {"distance": self.distance, "error": self.error, "moved_mm": self.moved_mm}
        record |= {name: round(value, 6) for name, value in figures.items() if value is not None}
        texts = {"hypothesis": self.hypothesis, "picture": self.picture}
        return record | {name: text for name, text in texts.items() if text is not None}


def judge(
    goal: GoalSpec, predicted: Iterable[Pose2], measured: Pose2, sigma_mm: float, sigma_rad: float
) -> Answer:
    """Judges whether a measured pose is within the goal about the nearest of the predicted poses.

    Args:
        goal: goal of the table.
        predicted: the leaf's pose and its alternatives, mm, mm, rad.
        measured: pose measured by the camera, mm, mm, rad.
        sigma_mm: standard deviation of the measured place, in each direction.
        sigma_rad: standard deviation of the measured angle.

    Returns:
        The answer, with the verdict "pass", "fail" or "unknown". The verdict is "unknown" for a goal of kind
        "identity", which asks for no pose, and if the distance of the poses is within `COVERAGE` standard
        deviations of the goal's limit.
    """
    if goal.kind == "identity":
        return Answer(
            UNKNOWN, "the goal asks which part it is, which its tag does not tell", measured
        )
    pose = min(predicted, key=lambda pose: distance(goal, pose, measured))
    off, bound = distance(goal, pose, measured), threshold(goal)
    if goal.kind in ("pose", "modes"):
        sigma, unit = math.hypot(sigma_mm, goal.rho_um / 1e3 * sigma_rad), " mm"
    else:
        allowed, shift = goal.tolerance, 0.0
        if goal.kind == "tolerances":
            shift = sigma_mm / (min(allowed.x_um, allowed.y_um) / 1e3)
        sigma, unit = max(shift, sigma_rad / (allowed.theta_urad / 1e6)), " of the tolerance"
    error, verdict, words = COVERAGE * sigma, UNKNOWN, "too close to call"
    if off + error < bound:
        verdict, words = PASS, "within the goal"
    elif off - error >= bound:
        verdict, words = FAIL, "not within the goal"
    x, y, theta = left = residual(goal, pose, measured)
    reason = (
        f"{words}: {off:.2f} +- {error:.2f}{unit}, allowed {bound:g} "
        f"(x {x:+.2f} mm, y {y:+.2f} mm, angle {math.degrees(theta):+.2f} deg off)"
    )
    return Answer(verdict, reason, measured, left, off, error)


@dataclass(frozen=True, slots=True, eq=False)
class Auditor:
    """Audits parts with one camera."""

    source: Source
    calibration: CameraCalibration
    subjects: Sequence[Subject]  # one for each part that may lie on the table
    limit_mm: float = drift.LIMIT_MM  # tolerated motion of reference tags
    # Folder for overlays of parts that did not pass; None: no overlays.
    pictures: Path | None = None

    def audit(self, part: int, predicted: Pose2, until: float, name: str | None = None) -> Answer:
        """Takes a picture and judges one part.

        The verdict is "fail" if the picture shows the tag of a part of `subjects` that is not the named part.
        For a goal of kind "identity" it is "pass" if the picture shows the tag of the named part. For other
        goals, `judge` compares the poses. The verdict is "unknown", with a reason, if the named part has no
        tag file, or if the camera or the measurement fails.

        Args:
            part: number of the part.
            predicted: pose that the leaf states, mm, mm, rad.
            until: time by which a picture must arrive (`time.monotonic`).
            name: part that the leaf names; None if the table is for one part.
        """
        subject = next((each for each in self.subjects if each.name == name), None)
        if subject is None:
            known = ", ".join(str(each.name) for each in self.subjects)
            problem = f"no tag file is for the part {name}, only for: {known}; name it by --tag"
            return Answer(UNKNOWN, problem)
        try:
            picture = self.source.picture(until)
        except ExpectedError as error:
            return Answer(UNKNOWN, str(error))
        result: Measured | None = None
        view = self.calibration.view
        try:
            self.calibration.check_size(picture.shape)
            explain.check_exposure(picture)
            seen = find(picture)
            moved_mm = drift.check(self.calibration.references, seen, view, self.limit_mm)
            carried = self._carrier({sighting.number for sighting in seen})
            result = measure(picture, seen, self.calibration, (carried or subject).tag, predicted)
            if carried is not None and carried is not subject:
                answer = Answer(FAIL, f"it is {carried.name}, not {name}", result.pose)
            elif carried is not None and subject.goal.kind == "identity":
                answer = Answer(PASS, f"it is {name}", result.pose)
            else:
                allowed = subject.poses_of(predicted)
                sigma = result.sigma_mm, result.sigma_rad
                answer = judge(subject.goal, allowed, result.pose, *sigma)
            carrier = None if carried is None else carried.name
            answer = replace(answer, moved_mm=moved_mm, hypothesis=carrier)
        except ExpectedError as error:
            answer = Answer(UNKNOWN, str(error))
        if self.pictures is None or answer.verdict == PASS:
            return answer
        sentence = f"{answer.verdict}: {answer.reason}"
        drawn = overlay.draw(picture, view, subject, predicted, result, sentence)
        path = overlay.keep(self.pictures, part, answer.verdict, drawn)
        return answer if path is None else replace(answer, picture=str(path))

    def _carrier(self, seen: Collection[int]) -> Subject | None:
        """Returns the part whose tag is seen; None if the tags of no part, or of several parts, are seen."""
        having = [each for each in self.subjects if each.tag.number in seen]
        return having[0] if len(having) == 1 else None
