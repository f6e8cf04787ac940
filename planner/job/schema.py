"""The sections of a job: meaning, type, range and default of each key."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias, get_type_hints

from planner.arrays import Array
from planner.job.fields import Field, Flag, Integer, Number, Numbers, Poses, Text
from planner.part.outline import MOST_VERTICES, Outline
from planner.part.pressure import Pressure
from planner.part.symmetry import MOST_ORDER
from runtime.table import DEFAULT_MODEL, GripperProfile, profile_of

PLACE = Number(-10_000, 10_000)  # a coordinate, mm
MOST_FRICTION = 2.0
# Tables hold integers in um, urad, um/s and mN; the least goal, speed or force is at least ten units.
LEAST_MM, LEAST_DEG, LEAST_RATE = 0.01, 0.001, 0.1
LEAST_STEP_MM = 0.001  # least step of a reading, which a table states in um
MOST_OFF_MM = 20.0  # largest constant error of a width
MM = 1_000.0  # larger than any part, gripper or height of such a cell


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The part on the table."""

    name: Annotated[str, Text()]  # name of the part
    # (N, 2) vertices, counter-clockwise, area centroid at the origin, read-only.
    outline_mm: Annotated[Outline, Numbers(PLACE, columns=2, most=MOST_VERTICES)]
    # Rotational order n: turns by 2 pi / n look the same, 1 = none.
    symmetry: Annotated[int, Integer(1, MOST_ORDER, default="auto", word="auto")]
    # Distance of real contours from the drawn one: moulded about 0.2, cut 0.1, cast 0.5; 0 = none.
    tolerance_mm: Annotated[float, Number(0, 10, default=0.0)]
    # Height of the part's top above the table where the fingers close; None: not stated.
    height_mm: Annotated[float | None, Number(1, MM, above=True, default=None)]
    # (3,) datum of the drawing: x, y [mm] and angle [deg] in the frame of the outline; None: not
    # stated.
    datum: Annotated[Array | None, Numbers(PLACE, least=3, most=3, default=None)] = None
    # Named points at which to take the part: x, y [mm] and angle [deg] of the hand in the datum's
    # frame.
    picks: Annotated[dict[str, list[float]] | None, Poses(PLACE, default=None)] = None


@dataclass(frozen=True, slots=True)
class Friction:
    """Coefficient of friction between finger and part: uniform between two bounds."""

    finger_part_min: Annotated[float, Number(0, MOST_FRICTION)]
    finger_part_max: Annotated[float, Number(0, MOST_FRICTION)]
    # Share of the particles whose friction lies outside the bounds, so that a part that violates
    # them ends in an unresolved leaf.
    doubt: Annotated[float, Number(0, 1, default=0.3)]


@dataclass(frozen=True, slots=True)
class Gripper:
    """A parallel-jaw gripper."""

    model: Annotated[str, Text(default=DEFAULT_MODEL)]
    finger_length_mm: Annotated[float, Number(0, MM, above=True)]  # along x of the hand frame
    finger_width_mm: Annotated[float, Number(0, MM, above=True)]  # along y, the closing direction
    # Distance of the inner faces of fully open jaws. None, here and in the next two: the model's value.
    opening_mm: Annotated[float, Number(0, MM, above=True, default=None)]
    resolution_mm: Annotated[float, Number(LEAST_STEP_MM, MM, default=None)]  # step of a reading
    noise_mm: Annotated[float, Number(0, 10, default=None)]  # std of a reading before its rounding
    # Rate at which the opening closes; each finger moves at half of it. None, here and in the next: the
    # usual value of the model.
    speed_mm_s: Annotated[float, Number(LEAST_RATE, MM, default=None)]
    force_n: Annotated[float, Number(LEAST_RATE, 10_000, default=None)]  # grip force
    # Share of the closing motion that the finger at +y makes; 0.5 = both alike, 1 = only this finger
    # moves.
    upper_finger_share: Annotated[float, Number(0, 1, default=0.5)]

    @property
    def profile(self) -> GripperProfile:
        """The profile of the gripper's model, with the values that the job states in place of the model's."""
        preset, stroke_um = profile_of(self.model), round(1e3 * self.opening_mm)
        steps = round(self.opening_mm / self.resolution_mm)
        counts = preset.counts and (preset.counts if steps == preset.steps else None)
        return replace(
            preset,
            model=self.model,
            stroke_um=stroke_um,
            resolution_um=stroke_um / steps,
            noise_um=round(1e3 * self.noise_mm),
            counts=counts,
        )


Interval: TypeAlias = tuple[float, float]


def _pair(low: float, high: float, default: float = 0.0) -> Numbers:
    return Numbers(Number(low, high), least=2, most=2, default=[default] * 2, plain=True)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Constant errors that a cell may have, relative to the values in the rest of the job.

    With probability `chance`, one error is chosen at random and drawn from its interval, more often near the
    ends. All other errors are at the middle of their intervals.
    """

    chance: Annotated[float, Number(0, 1, default=0.8)]  # probability of an error
    # Error of the upper finger's share of the closing, beyond `upper_finger_share`.
    finger_share: Annotated[Interval, _pair(-1, 1)]
    # Distance of the place where the fingers meet, on the part's narrowest side, from the hand's middle.
    middle_mm: Annotated[Interval, _pair(-20, 20)]
    # Constant error of widths. In a job that states other doubts, the default bound is three steps of a
    # reading or three standard deviations of it, whichever is larger.
    encoder_mm: Annotated[Interval, _pair(-MOST_OFF_MM, MOST_OFF_MM)]
    # Error of widths in proportion to them.
    encoder_gain: Annotated[Interval, _pair(-0.2, 0.2)]
    # "any": parts may press with their rim, their area, its middle or three feet, whatever [pressure] says.
    pressure: Annotated[str, Text(("stated", "any"), default="stated")]
    # Least degrees of freedom of the limit surface's scatter; the greatest are `wishart_dof` of [pressure].
    # 0: no doubt.
    least_dof: Annotated[int, Integer(0, 1_000_000, default=0)]


@dataclass(frozen=True, slots=True)
class Release:
    """Motion of a held part when the jaws open: standard deviations of a normal distribution."""

    shift_mm: Annotated[float, Number(0, 10, default=0.0)]  # deviation of x and of y
    turn_deg: Annotated[float, Number(0, 45, default=0.0)]  # deviation of the angle


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Possible poses of the part before the first squeeze, about the origin of the world."""

    radius_mm: Annotated[float, Number(0, MM)]  # the centroid is uniform in this disc
    # The orientation is uniform within plus or minus this; 180 = unknown.
    orientation_halfwidth_deg: Annotated[float, Number(0, 180, default=None)]


@dataclass(frozen=True, slots=True, eq=False)
class Actions:
    """Actions from which each node of the tree chooses: grasp poses for squeezes, and optional pushes.

    The grasp poses are all pairs of an angle and a centre, and poses that the node's belief suggests.
    """

    # Angles of the hand's x axis in the world.
    angles_deg: Annotated[tuple[float, ...], Numbers(Number(-360, 360), most=1_000, plain=True)]
    # (K, 2) positions of the hand in the world, read-only.
    centers_mm: Annotated[Array, Numbers(PLACE, columns=2, most=1_000)]
    # "belief": every node also considers grasp poses that it derives from its belief.
    proposals: Annotated[str, Text(("belief", "none"), default="belief")]
    # "belief": the hand may push the part before a squeeze, as the belief suggests; None: it does not.
    pushes: Annotated[str | None, Text(("belief", "none"), default=None)]


@dataclass(frozen=True, slots=True)
class Goal:
    """When a part counts as located.

    Kind "pose": sqrt(dx^2 + dy^2) + rho dtheta < distance (paper eq. 9), with rho the part's radius of
    gyration. "tolerances": x, y and theta are each within a tolerance (paper, VII). "modes": the pose is
    within the distance of one of at most `modes` poses. "orientation": theta is within its tolerance, at any
    position. "identity": the hypothesis is known, at any pose. Angles that differ by a turn of the part's
    symmetry are equal.
    """

    kind: Annotated[
        str, Text(("pose", "tolerances", "modes", "orientation", "identity"), default="pose")
    ]
    distance_mm: Annotated[float, Number(LEAST_MM, 100)]  # for "pose" and "modes"
    # Least probability that a part at a leaf is located.
    confidence: Annotated[float, Number(0, 1, above=True, below=True)]
    # Bounds on x and y, for "tolerances".
    tolerance_mm: Annotated[tuple[float, float], _pair(LEAST_MM, 100, 2.5)]
    # Bound on theta, for "tolerances" and "orientation".
    tolerance_deg: Annotated[float, Number(LEAST_DEG, 180, default=5.0)]
    modes: Annotated[int, Integer(1, 8, default=1)]  # most poses that a leaf may leave open
    # Largest share of the parts on which an open finger may come down if no placement clears all parts,
    # since the uncertainty is wider than the jaws open.
    crash_share: Annotated[float, Number(0, 0.05, default=0.0)]
    # What a plan minimises.
    minimise: Annotated[str, Text(("seconds", "squeezes"), default="seconds")] = "seconds"
    # Whether an answer must name the hypothesis, if there are several; None: yes.
    identify: Annotated[bool | None, Flag(default=None)] = None


@dataclass(frozen=True, slots=True)
class Search:
    """Method, number of particles and greatest depth of the search for the tree.

    The methods "paper" (Algorithms 1 to 3) and "sensorless" (no branching) are the paper's, for comparison.
    """

    method: Annotated[str, Text(("closed-loop", "paper", "sensorless"), default="closed-loop")]
    particles: Annotated[int, Integer(10, 10_000_000, default=20_000)]  # number that grows the tree
    max_depth: Annotated[int, Integer(1, 100, default=12)]  # longest path of the tree, in squeezes


@dataclass(frozen=True, slots=True)
class Cell:
    """Limits of the cell, which the runtime enforces, and values of the model of time."""

    # ((x_min, y_min), (x_max, y_max)) that the hand may be placed in, world frame.
    work_area_mm: Annotated[
        tuple[tuple[float, float], tuple[float, float]],
        Numbers(PLACE, columns=2, least=2, most=2, default=[[-150] * 2, [150] * 2], plain=True),
    ]
    # Height of the tips above the table while the arm travels.
    retreat_height_mm: Annotated[float, Number(0, MM, above=True, default=60.0)]
    squeeze_height_mm: Annotated[float, Number(0, MM, default=None)]  # of tips in a squeeze
    arm_speed_mm_s: Annotated[float, Number(LEAST_RATE, 10_000, default=250.0)]
    max_speed_mm_s: Annotated[float, Number(LEAST_RATE, MM, default=150.0)]  # closing speed
    # None, here and below: the value of `runtime.table.timing.DEFAULTS`, which the job's text leaves out.
    arm_acceleration_mm_s2: Annotated[float | None, Number(LEAST_RATE, 100_000, default=None)]
    # Height of the tips between two squeezes of one part; None: just above the part.
    regrasp_height_mm: Annotated[float | None, Number(0, MM, above=True, default=None)]
    arm_answer_s: Annotated[float | None, Number(0, 10, default=None)]  # overhead of each motion
    jaw_answer_s: Annotated[float | None, Number(0, 10, default=None)]  # overhead of each stroke
    poll_s: Annotated[float | None, Number(0, 1, default=None)]  # time between two polls


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """Where to deliver a located part; the runtime reads this section from the job that a table contains."""

    # (3,) target of the part's frame in the world: x, y [mm] and angle [deg].
    drop: Annotated[Array, Numbers(PLACE, least=3, most=3)]
    # Name of a pick in [part]; None: the origin of the part's frame.
    grasp: Annotated[str | None, Text(default=None)]
    # Width that the fingers have to read; None: any width but an empty hand's.
    width_mm: Annotated[float | None, Number(0, MM, above=True, default=None)]
    # (4,) x min, y min, x max, y max: area of the hand while it carries a part; None: the work area.
    area_mm: Annotated[Array | None, Numbers(PLACE, least=4, most=4, default=None)]


_RECORDS: tuple[type[Any], ...] = (
    Part,
    Pressure,
    Friction,
    Gripper,
    Release,
    Doubt,
    Uncertainty,
    Actions,
    Goal,
    Search,
    Cell,
    Delivery,
)
SECTIONS: Mapping[str, type[Any]] = {record.__name__.lower(): record for record in _RECORDS}
"""The records of a job, in its order, by the names of its sections."""

TOP_LEVEL: Mapping[str, Field] = {"seed": Integer(0, 2**63 - 1, default=0)}

_STATED: Mapping[str, Mapping[str, Field]] = {
    "pressure": {
        "kind": Text(("boundary", "uniform", "points", "identified", "stated"), default="boundary"),
        "wishart_dof": Integer(3, 1_000_000, default=100),
    },
    "part": {"faces": Text(("either",), default=None)},
    "uncertainty": {"orientation": Text(("unknown",), default=None)},
}  # Keys of the job file that the records hold in another form, or lack


def _fields_of(record: type[Any]) -> dict[str, Field]:
    hints = get_type_hints(record, include_extras=True).items()
    return {key: hint.__metadata__[0] for key, hint in hints if hasattr(hint, "__metadata__")}


FIELDS: Mapping[str, Mapping[str, Field]] = {
    name: {**_STATED.get(name, {}), **_fields_of(record)} for name, record in SECTIONS.items()
}  # The keys of a job file, by section; [pressure] has further ones, by its kind

LIMIT_SURFACE: Mapping[str, Field] = {
    "ellipsoid": Numbers(Number(-1e6, 1e6), columns=3, least=3, most=3, default=None),
    "quartic": Numbers(Number(-1e9, 1e9), least=15, most=15, default=None),
    "certificate": Numbers(Number(-1e9, 1e9), columns=9, least=9, most=9, default=None),
    "rho_mm": Number(0, MM, above=True, default=None),
}  # An identified limit surface: rho, and an ellipsoid or a quartic with its certificate

_FITTED: Mapping[str, Field] = {
    "limit_surface": Text(("ellipsoid", "quartic", "any"), default="ellipsoid")
}

PRESSURE_FIELDS: Mapping[str, Mapping[str, Field]] = {
    "boundary": _FITTED,
    "uniform": _FITTED,
    "points": {
        **_FITTED,
        "points_mm": Numbers(PLACE, columns=2, least=2),
        "weights": Numbers(Number(0, 1e6, above=True), least=2, default=None),
    },
    "identified": {"surface_file": Text(longest=1_000, default=None), **LIMIT_SURFACE},
    "stated": {
        "ellipsoid": Numbers(Number(-1e6, 1e6), columns=3, least=3, most=3),
        "rho_mm": Number(0, MM, above=True),
    },
}  # Further keys of [pressure], by its kind

FORMER: Mapping[str, Mapping[str, str]] = {
    "doubt": {
        "limit_surface": 'is part of [pressure]; write limit_surface = "any" there, or drop it',
        "start_mm": "is an option; drop it, and give plan-simulate --start-mm",
    },
}  # Keys that jobs no longer have, by section, and what to write instead

OPTIONAL_SECTIONS = ("pressure", "release", "doubt", "search", "cell", "delivery")
ABSENT_SECTIONS = ("delivery",)
"""Optional sections without defaults, which are None in a job that leaves them out."""
