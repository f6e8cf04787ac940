"""The decision table in memory: frozen records of its file's content.

`runtime.table.fields` has the meaning and the range of each field. Lengths are in um, angles in
urad, forces in mN, speeds in um/s, shares in ppm.
"""

from dataclasses import dataclass, replace
from math import hypot
from typing import NamedTuple, Self

from drivers.ports import TURN_RADIUS_MM, GripperProfile
from runtime.table.grippers import known

PPM = 1_000_000

MOST_BINS = 300  # of a histogram of readings
HELD_UM = 2000
"""Expected width above which the jaws hold a part, which the hand then drags to `Node.release`."""

REJECT = -1
"""In place of the index of a branch: no branch."""

KINDS = ("pose", "tolerances", "modes", "orientation", "identity")


class Place(NamedTuple):
    """A place of the hand's centre in the world."""

    x_um: int
    y_um: int


class Area(NamedTuple):
    """A rectangle in the world along its axes, um."""

    x_min: int
    y_min: int
    x_max: int
    y_max: int

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Whether a place lies in the rectangle or on its edge."""
        return (
            self.x_min / 1000 <= x_mm <= self.x_max / 1000
            and self.y_min / 1000 <= y_mm <= self.y_max / 1000
        )


class Tolerance(NamedTuple):
    """The largest deviations of a pose that a goal allows; 0 where its kind does not ask."""

    x_um: int
    y_um: int
    theta_urad: int


NO_TOLERANCE = Tolerance(0, 0, 0)


class Covariance(NamedTuple):
    """Second moments of the parts at a leaf about its pose, in units of 0.1 mm and 10 mrad."""

    xx: int
    xy: int
    yy: int
    xt: int
    yt: int
    tt: int


class Squeeze(NamedTuple):
    """One squeeze: place of the hand in the world, opening, speed and force of closing."""

    x_um: int
    y_um: int
    angle_urad: int
    opening_um: int
    speed_um_s: int
    force_mn: int
    clearance_um: int

    @property
    def place(self) -> Place:
        """The place where the hand closes."""
        return Place(self.x_um, self.y_um)

    @property
    def commands(self) -> tuple[int, int, int, int, int, int]:
        """Commands for a controller: place, angle, opening, speed and force."""
        return (
            self.x_um,
            self.y_um,
            self.angle_urad,
            self.opening_um,
            self.speed_um_s,
            self.force_mn,
        )


class Push(NamedTuple):
    """One push: the hand comes down beside the part and goes straight on along its own x axis."""

    x_um: int
    y_um: int
    angle_urad: int
    opening_um: int
    length_um: int
    speed_um_s: int


class Branch(NamedTuple):
    """One outcome of a squeeze: an interval of widths and its target."""

    low_um: int
    expected_um: int
    high_um: int
    probability_ppm: int
    target: int

    @property
    def grip(self) -> bool:
        """Whether something is between the jaws: the branch excludes readings of closed jaws."""
        return self.low_um > 0 or self.expected_um >= HELD_UM


class Node(NamedTuple):
    """One decision: a squeeze and its outcomes, ordered by width; and the pushes before it."""

    squeeze: Squeeze
    branches: tuple[Branch, ...]
    release: Place | None = None  # None: the jaws open where they closed
    pushes: tuple[Push, ...] = ()
    # None: unknown; the jaws close at the squeeze's speed all the way
    contact_um: int | None = None

    @property
    def let_go(self) -> Place:
        """Where a held part is released."""
        return self.release or self.squeeze.place

    def release_point(self, branch: int) -> Place | None:
        """Where a part that took a branch is released; None: where the hand stands.

        An unknown part, whose branch is `REJECT`, is not dragged.
        """
        held = branch != REJECT and self.branches[branch].expected_um >= HELD_UM
        return self.release if held else None

    def branch_to(self, target: object) -> int | None:
        """The branch with a target; None where there is none."""
        return next((k for k, branch in enumerate(self.branches) if branch.target == target), None)


class LeafPose(NamedTuple):
    """A pose of a part at a leaf, and the hypothesis that goes with it."""

    x_um: int
    y_um: int
    theta_urad: int
    hypothesis: int = 0


class Leaf(NamedTuple):
    """An end of the tree: the predicted pose of the part in the world, and its success rate."""

    x_um: int
    y_um: int
    theta_urad: int
    covariance: Covariance
    success_ppm: int
    trials: int
    resolved: bool
    alternatives: tuple[LeafPose, ...] = ()
    error_median_um: int = 0
    error_p95_um: int = 0
    hypothesis: int = 0

    @property
    def poses(self) -> tuple[LeafPose, ...]:
        """The predicted pose and its alternatives."""
        first = LeafPose(self.x_um, self.y_um, self.theta_urad, self.hypothesis)
        return (first, *self.alternatives)

    @property
    def success(self) -> float | None:
        """Share of its trials that met the goal; None without trials."""
        return self.success_ppm / PPM if self.trials else None


@dataclass(frozen=True, slots=True)
class GripperSpec:
    """The gripper of a table: its model's profile, and the fingers."""

    model: str
    opening_um: int
    finger_length_um: int
    finger_width_um: int
    steps: int
    noise_um: int
    empty_um: int
    least_speed_um_s: int
    most_speed_um_s: int
    least_force_mn: int
    most_force_mn: int
    streams: bool

    @classmethod
    def of(cls, profile: GripperProfile, finger_length_um: int, finger_width_um: int) -> Self:
        """The gripper of a profile, with its fingers."""
        return cls(
            model=profile.model,
            opening_um=profile.stroke_um,
            finger_length_um=finger_length_um,
            finger_width_um=finger_width_um,
            steps=profile.steps,
            noise_um=profile.noise_um,
            empty_um=min(profile.empty_um, profile.stroke_um),
            least_speed_um_s=round(1000 * profile.speed_mm_s[0]),
            most_speed_um_s=round(1000 * profile.speed_mm_s[1]),
            least_force_mn=round(1000 * profile.force_n[0]),
            most_force_mn=round(1000 * profile.force_n[1]),
            streams=profile.streams,
        )

    @property
    def bins(self) -> int:
        """Number of bins of a histogram of readings, with one or several steps of a reading in each."""
        return self.steps // self.steps_a_bin + 1

    def bin_of(self, width_um: int) -> int:
        """The bin of a histogram that a nominal width falls into, from 0 for closed jaws."""
        step = self.profile.step(min(max(width_um, 0), self.opening_um))
        return step // self.steps_a_bin

    @property
    def steps_a_bin(self) -> int:
        """Steps of a reading in one bin."""
        return self.steps // MOST_BINS + 1

    @property
    def profile(self) -> GripperProfile:
        """The profile that the table was planned with, completed from the known model."""
        preset = known(self.model)
        counts = None if preset is None else preset.counts
        if counts is not None and counts[1] - counts[0] != self.steps:
            counts = None
        return GripperProfile(
            model=self.model,
            stroke_um=self.opening_um,
            resolution_um=self.opening_um / self.steps,
            noise_um=self.noise_um,
            speed_mm_s=(self.least_speed_um_s / 1000, self.most_speed_um_s / 1000),
            force_n=(self.least_force_mn / 1000, self.most_force_mn / 1000),
            empty_um=self.empty_um,
            streams=self.streams,
            arc_mm=() if preset is None else preset.arc_mm,
            counts=counts,
            radius_mm=TURN_RADIUS_MM if preset is None else preset.radius_mm,
        )

    @property
    def turn_radius_mm(self) -> float:
        """Distance of the open gripper's farthest point, fingers included, from its axis."""
        aside_um = self.opening_um / 2 + self.finger_width_um
        return max(self.profile.radius_mm, hypot(aside_um, self.finger_length_um / 2) / 1e3)


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """When a part counts as located: tolerances, symmetry and confidence."""

    distance_um: int
    confidence_ppm: int
    rho_um: int
    symmetry: int
    kind: str = "pose"  # one of `KINDS`
    tolerance: Tolerance = NO_TOLERANCE
    modes: int = 1
    identify: bool = True


class Hypothesis(NamedTuple):
    """One of the parts that may lie on the table."""

    name: str
    share_ppm: int
    rho_um: int
    symmetry: int


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits for all motions of a table."""

    max_depth: int
    max_force_mn: int
    max_speed_um_s: int
    work_area_um: Area
    retreat_height_um: int
    squeeze_height_um: int
    arm_speed_um_s: int


@dataclass(frozen=True, slots=True)
class Prediction:
    """Results of the evaluation at compile time for the whole table."""

    success_ppm: int
    trials: int
    mean_squeezes_ppm: int
    reject_ppm: int = 0
    error_median_um: int = 0
    error_p95_um: int = 0


@dataclass(frozen=True, slots=True)
class Table:
    """A decision table. Nodes and leaves are numbered breadth first; node 0 is the root."""

    tool: str
    job_digest: bytes
    gripper: GripperSpec
    goal: GoalSpec
    limits: Limits
    nodes: tuple[Node, ...]
    leaves: tuple[Leaf, ...]
    predicted: Prediction
    job: str | None  # None: stripped
    hypotheses: tuple[Hypothesis, ...] = ()  # empty for a single part

    @property
    def pushing(self) -> int | None:
        """The first node with pushes before its squeeze; None if there are none."""
        return next((index for index, node in enumerate(self.nodes) if node.pushes), None)

    def goal_of(self, hypothesis: int) -> GoalSpec:
        """The goal for a part, under its own symmetry."""
        if not self.hypotheses:
            return self.goal
        part = self.hypotheses[hypothesis]
        return replace(self.goal, rho_um=part.rho_um, symmetry=part.symmetry)

    def name_of(self, leaf: Leaf) -> str | None:
        """The part that a leaf names; None for a single part."""
        return self.hypotheses[leaf.hypothesis].name if self.hypotheses else None
