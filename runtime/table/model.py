"""The decision table in memory: frozen records with the content of the table's file.

The annotation of a field gives its meaning and range. Lengths are in um, angles in urad, forces in mN,
speeds in um/s, shares in ppm.
"""

from dataclasses import dataclass, replace
from math import hypot
from typing import Annotated, NamedTuple, Self

from drivers.ports import TURN_RADIUS_MM, GripperProfile
from runtime.shell.plain_text import LONGEST
from runtime.table.fields import FAR, FLAG, LINE, MAX_BYTES, MAX_LEAVES, MAX_NODES, TEXT, Field
from runtime.table.grippers import known

PPM = 1_000_000

MAX_DEPTH = 64
MAX_HYPOTHESES = 16
MAX_ANGLE_URAD = 3_142_000
MAX_TRIALS = 10**10
WIDE = 1_000_000
# Ranges of values that several records have.
X = ("limits.work_area_um.x_min", "limits.work_area_um.x_max")
Y = ("limits.work_area_um.y_min", "limits.work_area_um.y_max")
TURN = (-MAX_ANGLE_URAD, MAX_ANGLE_URAD)
WIDTH = (0, "gripper.opening_um")

MOST_BINS = 300  # most bins of a histogram of readings
# Least expected width at which the jaws hold a part; the hand then drags the part to `Node.release`.
HELD_UM = 2000

# In place of the index of a branch: no branch has the reading.
REJECT = -1

KINDS = ("pose", "tolerances", "modes", "orientation", "identity")


class Place(NamedTuple):
    """Position of the hand's centre in the world."""

    x_um: Annotated[int, Field("hand's centre", *X)]
    y_um: Annotated[int, Field("hand's centre", *Y)]


class Area(NamedTuple):
    """A rectangle along the axes of the world, um."""

    x_min: Annotated[int, Field("of hand's centre and located parts", -FAR)]
    y_min: Annotated[int, Field("the same", -FAR)]
    x_max: Annotated[int, Field("the same", "limits.work_area_um.x_min")]
    y_max: Annotated[int, Field("the same", "limits.work_area_um.y_min")]

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Whether the point (x_mm, y_mm) lies in the rectangle or on its edge."""
        return (
            self.x_min / 1000 <= x_mm <= self.x_max / 1000
            and self.y_min / 1000 <= y_mm <= self.y_max / 1000
        )


class Tolerance(NamedTuple):
    """The largest deviations of a pose that a goal allows; 0 if the goal's kind does not use them."""

    x_um: Annotated[int, Field("bound of abs(dx)")]
    y_um: Annotated[int, Field("bound of abs(dy)")]
    theta_urad: Annotated[int, Field("bound of abs(dtheta)")]


NO_TOLERANCE = Tolerance(0, 0, 0)


class Covariance(NamedTuple):
    """Covariance of the poses of the parts that end at a leaf, about the leaf's pose.

    Each number is the mean product of two deviations: of x and y in units of 0.1 mm, of the angle t in units
    of 10 mrad.
    """

    xx: Annotated[int, Field("in 0.1 mm and 10 mrad")]
    xy: Annotated[int, Field("the same", -FAR)]
    yy: Annotated[int, Field("the same")]
    xt: Annotated[int, Field("the same", -FAR)]
    yt: Annotated[int, Field("the same", -FAR)]
    tt: Annotated[int, Field("the same")]


class Squeeze(NamedTuple):
    """One squeeze: pose of the hand in the world, opening of the jaws, speed and force of closing."""

    x_um: Annotated[int, Field("hand's centre", *X)]
    y_um: Annotated[int, Field("hand's centre", *Y)]
    angle_urad: Annotated[int, Field("of the hand", *TURN)]
    opening_um: Annotated[int, Field("before the squeeze", 1, "gripper.opening_um")]
    speed_um_s: Annotated[int, Field("of closing", 1, "limits.max_speed_um_s")]
    force_mn: Annotated[int, Field("of closing", 1, "limits.max_force_mn")]
    clearance_um: Annotated[int, Field("open fingers to any believed pose", 0, WIDE)]

    @property
    def place(self) -> Place:
        """The place where the hand closes."""
        return Place(self.x_um, self.y_um)

    @property
    def commands(self) -> tuple[int, int, int, int, int, int]:
        """The values that a controller needs: x, y, angle, opening, speed and force, in the table's units."""
        return self[:6]


class Push(NamedTuple):
    """One push: the hand comes down beside the part and slides straight along the hand's x axis."""

    x_um: Annotated[int, Field("hand's centre at the start", *X)]
    y_um: Annotated[int, Field("the same", *Y)]
    angle_urad: Annotated[int, Field("of hand and way", *TURN)]
    opening_um: Annotated[int, Field("of the jaws", *WIDTH)]
    length_um: Annotated[int, Field("of the way", 1, WIDE)]
    speed_um_s: Annotated[int, Field("of the hand", 1, "limits.arm_speed_um_s")]


class Branch(NamedTuple):
    """One outcome of a squeeze: an interval of widths and its target."""

    low_um: Annotated[int, Field("least width", *WIDTH)]
    expected_um: Annotated[int, Field("expected width", *WIDTH)]
    high_um: Annotated[int, Field("greatest width", *WIDTH)]
    probability_ppm: Annotated[int, Field("share of the node's outcomes", 0, PPM)]
    target: Annotated[int, Field(">= 0: node, < 0: leaf ~target", -MAX_LEAVES, MAX_NODES - 1)]

    @property
    def grip(self) -> bool:
        """Whether the branch means that the jaws hold something; if so, a width of 0 never selects it."""
        return self.low_um > 0 or self.expected_um >= HELD_UM


class Node(NamedTuple):
    """Inner node of the tree: the pushes before a squeeze, the squeeze, and its branches by rising width."""

    squeeze: Squeeze
    branches: tuple[Branch, ...]
    release: Place | None = None  # None: the jaws open where they closed
    pushes: tuple[Push, ...] = ()
    # None: unknown; the jaws close at the squeeze's speed all the way
    contact_um: Annotated[int | None, Field("greatest width of a contact", *WIDTH)] = None

    @property
    def let_go(self) -> Place:
        """The place of the hand where the jaws release a held part."""
        return self.release or self.squeeze.place

    def release_point(self, branch: int) -> Place | None:
        """Place to which the hand drags a held part before it releases it, if the reading selected `branch`.

        Returns:
            None where no part is dragged: after `REJECT`, at a branch that holds nothing, or if the node has
            no `release`.
        """
        held = branch != REJECT and self.branches[branch].expected_um >= HELD_UM
        return self.release if held else None

    def branch_to(self, target: object) -> int | None:
        """The index of the branch that leads to `target` (a node, or ~leaf); None where none does."""
        return next((k for k, branch in enumerate(self.branches) if branch.target == target), None)


class LeafPose(NamedTuple):
    """One possible pose of the part at a leaf, and which part it is (its hypothesis)."""

    x_um: Annotated[int, Field("pose", -FAR)]
    y_um: Annotated[int, Field("pose", -FAR)]
    theta_urad: Annotated[int, Field("pose", *TURN)]
    hypothesis: Annotated[int, Field("number of the part", 0, MAX_HYPOTHESES - 1)] = 0


class Leaf(NamedTuple):
    """Leaf of the tree: the predicted pose of the part in the world, and its success rate in trials."""

    x_um: Annotated[int, Field("predicted pose", -FAR)]
    y_um: Annotated[int, Field("predicted pose", -FAR)]
    theta_urad: Annotated[int, Field("predicted pose", *TURN)]
    covariance: Covariance
    success_ppm: Annotated[int, Field("trials here that met the goal", 0, PPM)]
    trials: Annotated[int, Field("0: success not known", 0, MAX_TRIALS)]
    resolved: Annotated[bool, Field("0: the outcome is UNRESOLVED", 0, 1, FLAG)]
    alternatives: tuple[LeafPose, ...] = ()
    error_median_um: Annotated[int, Field("of these trials")] = 0
    error_p95_um: Annotated[int, Field("95th percentile")] = 0
    hypothesis: Annotated[int, Field("number of the part", 0, MAX_HYPOTHESES - 1)] = 0

    @property
    def poses(self) -> tuple[LeafPose, ...]:
        """The predicted pose and its alternatives."""
        first = LeafPose(self.x_um, self.y_um, self.theta_urad, self.hypothesis)
        return (first, *self.alternatives)

    @property
    def success(self) -> float | None:
        """Share of the leaf's trials that met the goal; None without trials."""
        return self.success_ppm / PPM if self.trials else None


@dataclass(frozen=True, slots=True)
class GripperSpec:
    """The gripper that a table was planned for: the profile of its model, and its fingers."""

    model: Annotated[str, Field("name of the model", 1, LONGEST, LINE)]
    opening_um: Annotated[int, Field("widest opening", 1, WIDE)]
    finger_length_um: Annotated[int, Field("along x", 1, WIDE)]
    finger_width_um: Annotated[int, Field("along y", 1, WIDE)]
    steps: Annotated[int, Field("of a reading from 0 to the opening", 1, WIDE)]
    noise_um: Annotated[int, Field("of a reading, standard deviation", *WIDTH)]
    empty_um: Annotated[int, Field("up to it the object flag may miss a part", *WIDTH)]
    least_speed_um_s: Annotated[int, Field("of closing")]
    most_speed_um_s: Annotated[int, Field("the same", "gripper.least_speed_um_s")]
    least_force_mn: Annotated[int, Field("of closing")]
    most_force_mn: Annotated[int, Field("the same", "gripper.least_force_mn")]
    streams: Annotated[bool, Field("1: takes another stroke on its way", 0, 1, FLAG)]

    @classmethod
    def of(cls, profile: GripperProfile, finger_length_um: int, finger_width_um: int) -> Self:
        """Builds the record of a gripper from the profile of its model and the size of its fingers."""
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
        """Number of bins in a histogram of the gripper's readings, `MOST_BINS` at most."""
        return self.steps // self.steps_a_bin + 1

    def bin_of(self, width_um: int) -> int:
        """Index of the bin in a histogram of readings into which a nominal width falls; 0 for closed jaws."""
        step = self.profile.step(min(max(width_um, 0), self.opening_um))
        return step // self.steps_a_bin

    @property
    def steps_a_bin(self) -> int:
        """Number of steps of the gripper's resolution in one bin of a histogram of readings."""
        return self.steps // MOST_BINS + 1

    @property
    def profile(self) -> GripperProfile:
        """The profile of the gripper for which the table was planned.

        A table does not state the tips' arc, the gripper's radius, and its counts with open and closed jaws.
        They are taken from the known model of the same name; the counts only if their difference is the
        number of steps that the table states.
        """
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
        """Distance, mm, of the open gripper's farthest point, fingers included, from the axis of the hand."""
        aside_um = self.opening_um / 2 + self.finger_width_um
        return max(self.profile.radius_mm, hypot(aside_um, self.finger_length_um / 2) / 1e3)


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """States when a part counts as located, and which share of the parts a plan should locate."""

    distance_um: Annotated[int, Field("bound of the error")]
    confidence_ppm: Annotated[int, Field("share of parts to locate", 0, PPM)]
    rho_um: Annotated[int, Field("weight of one radian")]
    symmetry: Annotated[int, Field("rotational order, 1: none", 1, 1000)]
    kind: Annotated[str, Field("see below", 1, LONGEST, LINE)] = "pose"  # one of `KINDS`
    tolerance: Tolerance = NO_TOLERANCE
    modes: Annotated[int, Field("poses that a leaf may name", 1, 64)] = 1
    identify: Annotated[bool, Field("1: leaves must name the right part", 0, 1, FLAG)] = True


class Hypothesis(NamedTuple):
    """One of the parts that may lie on the table."""

    name: Annotated[str, Field("of the part", 1, LONGEST, LINE)]
    share_ppm: Annotated[int, Field("of the parts that come", 0, PPM)]
    rho_um: Annotated[int, Field("as in `goal`")]
    symmetry: Annotated[int, Field("as in `goal`", 1, 1000)]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that apply to a whole table: number of squeezes, force, speeds, work area and heights."""

    max_depth: Annotated[int, Field("squeezes to any leaf", 1, MAX_DEPTH)]
    max_force_mn: Annotated[int, Field("closing force", 1)]
    max_speed_um_s: Annotated[int, Field("closing speed", 1)]
    work_area_um: Area
    retreat_height_um: Annotated[int, Field("of travelling tips", -FAR)]
    squeeze_height_um: Annotated[int, Field("of squeezing tips, below the former", -FAR)]
    arm_speed_um_s: Annotated[int, Field("speed of the arm", 1)]


@dataclass(frozen=True, slots=True)
class Prediction:
    """Results of the evaluation at compile time for the whole table."""

    success_ppm: Annotated[int, Field("trials that met the goal", 0, PPM)]
    trials: Annotated[int, Field("0: not evaluated", 0, MAX_TRIALS)]
    mean_squeezes_ppm: Annotated[int, Field("squeezes a part, millionths", 0, MAX_DEPTH * PPM)]
    reject_ppm: Annotated[int, Field("trials that ended in REJECT", 0, PPM)] = 0
    error_median_um: Annotated[int, Field("at resolved leaves", 0, "predicted.error_p95_um")] = 0
    error_p95_um: Annotated[int, Field("95th percentile")] = 0


@dataclass(frozen=True, slots=True)
class Table:
    """A decision table. Nodes and leaves are numbered breadth first; node 0 is the root."""

    tool: Annotated[str, Field("name and version", 1, LONGEST, LINE)]
    job_digest: Annotated[bytes, Field("SHA-256 of the job's text", 32, 32, "bytes")]
    gripper: GripperSpec
    goal: GoalSpec
    limits: Limits
    nodes: tuple[Node, ...]
    leaves: tuple[Leaf, ...]
    predicted: Prediction
    # None: stripped
    job: Annotated[str | None, Field("canonical text, a JSON object", 0, MAX_BYTES, TEXT)]
    hypotheses: tuple[Hypothesis, ...] = ()  # empty for a single part

    @property
    def pushing(self) -> int | None:
        """The index of the first node with pushes before its squeeze; None without pushes."""
        return next((index for index, node in enumerate(self.nodes) if node.pushes), None)

    def goal_of(self, hypothesis: int) -> GoalSpec:
        """The table's goal, with rho and symmetry of the part with index `hypothesis`."""
        if not self.hypotheses:
            return self.goal
        part = self.hypotheses[hypothesis]
        return replace(self.goal, rho_um=part.rho_um, symmetry=part.symmetry)

    def name_of(self, leaf: Leaf) -> str | None:
        """The name of the part that a leaf predicts; None for a table of a single part."""
        return self.hypotheses[leaf.hypothesis].name if self.hypotheses else None
