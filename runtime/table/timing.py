"""Model of how long the motions of a cell take, for plans, evaluations, runs and their deadlines.

The arm accelerates, travels at a constant speed, and brakes; on a short way it brakes before it reaches the
speed. In a turn of the hand, the hand's farthest point moves on an arc; the turn takes as long as a straight
way that is as long as this arc. Jaws move at constant speeds. The response time of a device is added to each
of its motions. Lengths are in mm, angles in rad, times in s.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf, isfinite, sqrt
from typing import Any, NamedTuple, Self

from runtime.errors import TableError
from runtime.table.embedded import number, parts_of, section
from runtime.table.model import GripperSpec, Limits

# Distance that jaws open before they are clear of what they held.
CLEAR_MM = 5.0
# Distance before the first possible contact at which jaws have slowed to the squeeze's speed.
APPROACH_MM = 2.0
# Distance before the end of a stroke at which the next one is sent, for jaws that accept it in motion.
LEAD_MM = 1.5
# Height of the tips above the top of the part between two squeezes of the part.
ABOVE_MM = 4.0

# Longest way on which a hand at the retreat height descends while it travels; farther off may be obstacles.
NEAR_MM = 30.0

# Defaults of the section `cell` of a job. The acceleration is a limit; the rest are guesses, which
# `plan-refit` replaces by values from a journal.
DEFAULTS: Mapping[str, float] = {
    "arm_acceleration_mm_s2": 2_000.0,
    "arm_answer_s": 0.014,
    "jaw_answer_s": 0.062,
    "poll_s": 0.015,
}


def trapezoid_s(way_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Least time, s, for a way from rest to rest at the given greatest speed and acceleration."""
    if way_mm <= 0.0:
        return 0.0
    ramps_mm = speed_mm_s**2 / acceleration_mm_s2
    if way_mm < ramps_mm:
        return 2.0 * sqrt(way_mm / acceleration_mm_s2)
    return way_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


class Phases(NamedTuple):
    """How long each phase of one squeeze takes, in seconds."""

    push_s: float = 0.0  # the pushes before the squeeze
    travel_s: float = 0.0  # travel above the squeeze's place, while the jaws move to the opening
    lower_s: float = 0.0
    close_s: float = 0.0  # the strokes, until the reading is accepted
    release_s: float = 0.0  # a drag, and the jaws until they are clear of the part
    rise_s: float = 0.0  # the rise of the hand; the jaws may continue to open meanwhile

    @property
    def total_s(self) -> float:
        """Sum of all phases."""
        return sum(self)


def phases_of(record: object) -> Phases:
    """Parses the phases of a squeeze from a journal record.

    Raises:
        ValueError: the phases are invalid.
    """
    if not isinstance(record, Mapping) or set(record) != set(Phases._fields):
        raise ValueError(f"phases are not {', '.join(Phases._fields)}")
    return Phases(**{name: time_of(value) for name, value in record.items()})


def time_of(value: object) -> float:
    """Parses a value of a record as a time, s; it must be finite and not negative.

    Raises:
        ValueError: the time is invalid.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < inf:
        raise ValueError(f"{value!r} is no time")
    return float(value)


class Visit(NamedTuple):
    """Motions of hand and jaws in one squeeze, from which `Timing.squeeze` computes its time."""

    way_mm: float  # way of the hand from its last place
    turn_rad: float  # turn of the hand on that way, of either sign
    opening_mm: float  # opening of the jaws before the squeeze
    # greatest width at which the jaws may meet the part; None: it is not known
    contact_mm: float | None
    width_mm: float  # width at which the jaws stop
    speed_mm_s: float  # speed of closing where the jaws may meet the part
    next_mm: float  # opening of the jaws after the squeeze
    drag_mm: float = 0.0  # drag of a held part before its release
    from_retreat: bool = False  # whether the hand comes down from the retreat height
    to_retreat: bool = False  # whether the hand returns to the retreat height
    jaws_s: float = 0.0  # seconds for which the jaws go on moving after the hand starts


@dataclass(frozen=True, slots=True)
class Timing:
    """Speeds, heights and response times of a cell; the methods compute from them how long motions take."""

    arm_speed_mm_s: float
    arm_acceleration_mm_s2: float
    # time from the request of an arm motion to the confirmation of its end, less the motion itself
    arm_answer_s: float
    jaw_answer_s: float  # the same for a stroke of the jaws, which ends with three equal readings
    poll_s: float  # time to read the jaws once, or to send them a request
    turn_radius_mm: float  # a turn takes as long as a straight way of this radius times its angle
    fastest_mm_s: float  # speed of jaws that touch nothing
    streams: bool  # whether the jaws take another stroke while they move
    squeeze_mm: float  # heights of the tips
    regrasp_mm: float
    retreat_mm: float

    @classmethod
    def of(cls, limits: Limits, gripper: GripperSpec, job: Mapping[str, Any] | None) -> Self:
        """Computes the timing from a table's limits, its gripper and, if the table has one, its job.

        Raises:
            TableError: the gripper is unknown, or the job's figures are impossible.
        """
        (stated, regrasp_um), profile = checked(limits, job), gripper.profile
        return cls(
            arm_speed_mm_s=limits.arm_speed_um_s / 1e3,
            turn_radius_mm=gripper.turn_radius_mm,
            fastest_mm_s=min(profile.speed_mm_s[1], limits.max_speed_um_s / 1e3),
            streams=profile.streams,
            squeeze_mm=limits.squeeze_height_um / 1e3,
            regrasp_mm=regrasp_um / 1e3,
            retreat_mm=limits.retreat_height_um / 1e3,
            **stated,
        )

    def move_s(
        self, way_mm: float, turn_rad: float = 0.0, speed_mm_s: float | None = None
    ) -> float:
        """Seconds of one motion of the arm over a way and a turn of the hand; 0 without way and turn."""
        way_mm = max(way_mm, self.turn_radius_mm * abs(turn_rad))
        if way_mm <= 0.0:
            return 0.0
        speed_mm_s = min(speed_mm_s or self.arm_speed_mm_s, self.arm_speed_mm_s)
        return self.arm_answer_s + trapezoid_s(way_mm, speed_mm_s, self.arm_acceleration_mm_s2)

    def comes_down(self, way_mm: float, turn_rad: float) -> bool:
        """Whether a hand at the retreat height descends to the regrasp height while it travels to a squeeze.

        It does so only on a short way (`NEAR_MM`), and only if the descent takes no longer than the travel.
        """
        aside_mm = max(way_mm, self.turn_radius_mm * abs(turn_rad))
        return way_mm <= NEAR_MM and self.retreat_mm - self.regrasp_mm <= aside_mm

    def approach_mm(self, opening_mm: float, contact_mm: float | None, speed_mm_s: float) -> float:
        """Opening, mm, at which closing jaws slow down from full speed to the squeeze's speed.

        If fast closing saves no time, or `contact_mm` is unknown, the jaws are slow from the start: the
        result is `opening_mm`.

        Args:
            opening_mm: opening from which the jaws close.
            contact_mm: greatest width at which the jaws may meet the part; None: unknown.
            speed_mm_s: the squeeze's speed.
        """
        if contact_mm is None:
            return opening_mm
        near_mm = min(contact_mm + APPROACH_MM, opening_mm)
        faster = 1.0 / speed_mm_s - 1.0 / max(self.fastest_mm_s, speed_mm_s)
        saved_s = (opening_mm - near_mm) * faster
        return near_mm if saved_s > self._between_s else opening_mm

    def close_s(
        self, opening_mm: float, contact_mm: float | None, width_mm: float, speed_mm_s: float
    ) -> float:
        """Seconds from the start of closing until the jaws stop at `width_mm` and the reading is accepted."""
        near_mm = max(self.approach_mm(opening_mm, contact_mm, speed_mm_s), width_mm)
        fast_s = (opening_mm - near_mm) / max(self.fastest_mm_s, speed_mm_s)
        between_s = self._between_s if near_mm < opening_mm else 0.0
        return fast_s + between_s + max(near_mm - width_mm, 0.0) / speed_mm_s + self.jaw_answer_s

    def free_s(self, width_mm: float, next_mm: float, speed_mm_s: float) -> float:
        """Seconds that jaws opening from `width_mm` to `next_mm` take until they are clear of the part."""
        answer_s = 3.0 * self.poll_s if next_mm > width_mm + CLEAR_MM else self.jaw_answer_s
        return CLEAR_MM / speed_mm_s + answer_s

    def opening_s(self, width_mm: float, next_mm: float, speed_mm_s: float) -> float:
        """Seconds that jaws, once clear of a part of `width_mm`, take to reach their next opening.

        The hand may move meanwhile.
        """
        stroke_mm = abs(next_mm - width_mm - CLEAR_MM)
        return stroke_mm / (max(self.fastest_mm_s, speed_mm_s) if self.streams else speed_mm_s)

    def push_s(
        self,
        way_mm: float,
        turn_rad: float,
        *,
        stroke_mm: float,
        stroke_mm_s: float,
        push_mm: float,
        push_mm_s: float,
    ) -> float:
        """Seconds of one push, during which the hand starts at the retreat height and returns to it.

        Args:
            way_mm: way of the hand to the place where it descends.
            turn_rad: turn of the hand on that way.
            stroke_mm: stroke of the jaws before the push.
            stroke_mm_s: speed of that stroke.
            push_mm: length of the push.
            push_mm_s: speed of the hand during the push.
        """
        lift_s = self.move_s(self.retreat_mm - self.squeeze_mm)
        return (
            stroke_mm / stroke_mm_s
            + self.jaw_answer_s
            + self.move_s(way_mm, turn_rad)
            + 2.0 * lift_s
            + self.move_s(push_mm, 0.0, push_mm_s)
        )

    def squeeze(self, visit: Visit) -> Phases:
        """Computes how long each phase of one squeeze takes; the last phase is the rise above the part."""
        high_mm = self.retreat_mm if visit.from_retreat else self.regrasp_mm
        way_mm = visit.way_mm
        if visit.from_retreat and self.comes_down(way_mm, visit.turn_rad):
            way_mm, high_mm = hypot(way_mm, self.retreat_mm - self.regrasp_mm), self.regrasp_mm
        top_mm = self.retreat_mm if visit.to_retreat else self.regrasp_mm
        rise_s = self.move_s(top_mm - self.squeeze_mm)
        left_s = self.opening_s(visit.width_mm, visit.next_mm, visit.speed_mm_s)
        return Phases(
            travel_s=max(self.move_s(way_mm, visit.turn_rad), visit.jaws_s) + self.poll_s,
            lower_s=self.move_s(high_mm - self.squeeze_mm),
            close_s=self.close_s(
                visit.opening_mm, visit.contact_mm, visit.width_mm, visit.speed_mm_s
            ),
            release_s=self.move_s(visit.drag_mm)
            + self.free_s(visit.width_mm, visit.next_mm, visit.speed_mm_s),
            rise_s=max(rise_s, left_s) + self.poll_s if visit.to_retreat else rise_s,
        )

    @property
    def _between_s(self) -> float:
        """Seconds that closing jaws lose at the change from the fast stroke to the slow one."""
        return self.poll_s if self.streams else self.jaw_answer_s


def checked(limits: Limits, job: Mapping[str, Any] | None) -> tuple[dict[str, float], int]:
    """Reads and checks the timing in a job's section `cell`.

    Returns:
        The value for each key of `DEFAULTS`, as the job states it or by default, and the regrasp height, um.

    Raises:
        TableError: a value of the job is impossible.
    """
    cell = section(job or {}, "cell")
    stated = {key: _positive(cell, key, default) for key, default in DEFAULTS.items()}
    return stated, _regrasp_height_um(limits, job)


def _regrasp_height_um(limits: Limits, job: Mapping[str, Any] | None) -> int:
    """Height of the tips, um, between two squeezes of one part (regrasp height).

    It is the height that the job states; else `ABOVE_MM` above the tallest part; else, if the job does not
    state the heights of all parts, the retreat height.

    Raises:
        TableError: the stated height is not above parts and squeeze height, or is above the retreat height.
    """
    heights_mm = [number(section(entry, "part"), "height_mm") for entry in parts_of(job or {})]
    known = [height for height in heights_mm if height is not None]
    stated_mm = number(section(job or {}, "cell"), "regrasp_height_mm")
    if stated_mm is None:
        if not known or len(known) < len(heights_mm):
            return limits.retreat_height_um
        return min(round(1e3 * (max(known) + ABOVE_MM)), limits.retreat_height_um)
    least_um = max([limits.squeeze_height_um, *(round(1e3 * height) for height in known)])
    if not least_um < round(1e3 * stated_mm) <= limits.retreat_height_um:
        raise TableError(
            f"cell.regrasp_height_mm of the embedded job is {stated_mm:g}; it belongs above the part, "
            f"{least_um / 1e3:g}, and at most at the retreat height, {limits.retreat_height_um / 1e3:g}: "
            "correct it and recompile"
        )
    return round(1e3 * stated_mm)


def _positive(cell: Mapping[str, Any], key: str, default: float) -> float:
    value = number(cell, key)
    if value is None:
        return default
    if not (isfinite(value) and value >= 0.0 and (value > 0.0 or key.endswith("_s"))):
        raise TableError(
            f"cell.{key} of the embedded job is {value:g}, which no motion can keep; recompile it"
        )
    return value
