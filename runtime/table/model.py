"""The decision table in memory: frozen records of the integers that its file holds; see `TABLE.md`.

Lengths in um, angles in urad, forces in mN, speeds in um/s, shares in ppm.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

PPM = 1_000_000

HELD_UM = 2000
"""From this expected width on the jaws hold a part, which the hand then drags to `Node.release`."""
UNDETECTED_UM = 5000
"""Up to this width the object flag may miss a grip (2F-85 manual, "object detection"); the width tells it."""

KINDS = ("pose", "tolerances", "modes", "orientation", "identity")
MAX_NODES = 1 << 12
MAX_LEAVES = 1 << 14
MAX_BRANCHES = 32
MAX_PUSHES = 4
MAX_ALTERNATIVES = 32
MAX_DEPTH = 64
MAX_HYPOTHESES = 16


class Squeeze(NamedTuple):
    """One squeeze: where the hand is placed in the world, how far open, how fast and how strong it closes."""

    x_um: int  # of the hand's centre in the world
    y_um: int
    angle_urad: int
    opening_um: int  # before the squeeze
    speed_um_s: int  # closing speed of the fingers
    force_mn: int  # closing force
    clearance_um: (
        int  # least distance between the open fingers and any believed pose of the part, >= 0
    )


class Push(NamedTuple):
    """One push: the hand comes down beside the part and goes straight on along its own x axis."""

    x_um: int  # of the hand's centre in the world, where it comes down
    y_um: int
    angle_urad: int
    opening_um: int  # of the jaws, 0: closed
    length_um: int  # of the way
    speed_um_s: int  # of the hand on it


class Branch(NamedTuple):
    """One outcome of a squeeze: an interval of widths and where it leads."""

    low_um: int
    expected_um: int  # expected width; the nearest one wins where intervals overlap
    high_um: int
    probability_ppm: int  # predicted share of this outcome among the node's outcomes
    target: int  # >= 0 an index into `Table.nodes`, < 0 a leaf: index ~target into `Table.leaves`

    @property
    def grip(self) -> bool:
        """Whether something is between the jaws: no reading of the branch is that of jaws that met."""
        return self.low_um > 0 or self.expected_um >= HELD_UM


class Node(NamedTuple):
    """One decision: a squeeze and its outcomes, ordered by width; and what is pushed before it."""

    squeeze: Squeeze
    branches: tuple[Branch, ...]
    # x, y of the hand centre, um, to which a held part (`HELD_UM`) is dragged at the same angle before the
    # jaws open, another place than the squeeze's; None: they open where they closed.
    release: tuple[int, int] | None = None
    pushes: tuple[Push, ...] = ()  # in this order, at most `MAX_PUSHES`
    # Greatest width at which the closing jaws may meet the part, by the belief there; None: nobody knows, so
    # they close at the squeeze's speed all the way.
    contact_um: int | None = None


class Leaf(NamedTuple):
    """An end of the tree: the predicted pose of the part in the world, and how often it holds."""

    x_um: int
    y_um: int
    theta_urad: int  # within half a turn of zero
    # xx, xy, yy, x theta, y theta, theta theta, in units of 0.1 mm and 10 mrad.
    covariance: tuple[int, int, int, int, int, int]
    success_ppm: int  # share of the evaluation's `trials` ending here that met the goal
    trials: int
    resolved: (
        bool  # whether the part may be taken to lie here; False ends in the outcome UNRESOLVED
    )
    # further poses the part may have, each x_um, y_um, theta_urad: the other modes of a goal of kind
    # "modes", or what an unresolved leaf cannot tell apart.
    alternatives: tuple[tuple[int, int, int], ...] = ()
    error_median_um: int = 0  # of the error of those trials (paper eq. 9)
    error_p95_um: int = 0  # its 95th percentile
    hypothesis: int = 0  # which of `Table.hypotheses` the part is, where there are several
    other_hypotheses: tuple[int, ...] = ()  # then also: which it is at each of the alternatives

    @property
    def success(self) -> float | None:
        """Share of its trials that met the goal; None where none ended here, which proves nothing."""
        return self.success_ppm / PPM if self.trials else None


@dataclass(frozen=True, slots=True)
class GripperSpec:
    """The gripper the table was made for; lengths in um, encoder ends in counts."""

    model: str
    opening_um: int
    finger_length_um: int
    finger_width_um: int
    count_open: int
    count_closed: int
    encoder_noise_um: int


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """When a part counts as located, under the symmetry and at a confidence."""

    distance_um: int
    confidence_ppm: int  # the share of parts that must meet it
    rho_um: int  # what one radian of error weighs
    symmetry: int  # rotational order of the part, 1 for none
    # "pose": sqrt(dx^2 + dy^2) + rho * dtheta < distance; "tolerances": x, y and theta each within its own;
    # "modes": as "pose", of one of a leaf's poses; "orientation": theta within its tolerance; "identity":
    # any pose, of the right part.
    kind: str = "pose"
    tolerance: tuple[int, int, int] = (
        0,
        0,
        0,
    )  # x_um, y_um, theta_urad, for "tolerances" and "orientation"
    modes: int = 1  # how many poses a leaf may leave open, for "modes"
    identify: bool = True  # whether the leaf must name the right one of several parts


class Hypothesis(NamedTuple):
    """One of the parts that may lie on the table."""

    name: str
    share_ppm: int  # of the parts that come
    rho_um: int  # what one radian of error weighs
    symmetry: int  # rotational order, 1 for none


@dataclass(frozen=True, slots=True)
class Limits:
    """What no motion of this table may exceed."""

    max_depth: int  # squeezes to any leaf, at most `MAX_DEPTH`
    max_force_mn: int  # of closing
    max_speed_um_s: int  # of closing
    work_area_um: tuple[
        int, int, int, int
    ]  # x min, y min, x max, y max of hand's centre and predicted poses
    retreat_height_um: int  # of the tips while the arm travels
    squeeze_height_um: int  # of the tips while squeezing
    arm_speed_um_s: int


@dataclass(frozen=True, slots=True)
class Prediction:
    """What the evaluation at compile time measured for the table as a whole."""

    success_ppm: (
        int  # parts within the goal among all `trials`, of which there are 0 without an evaluation
    )
    trials: int
    mean_squeezes_ppm: int  # mean number of squeezes a part, in millionths
    reject_ppm: int = 0  # trials that ended in REJECT
    error_median_um: int = 0  # of the parts that came to resolved leaves (paper eq. 9)
    error_p95_um: int = 0  # of the same


@dataclass(frozen=True, slots=True)
class Table:
    """A decision table. Nodes and leaves are numbered breadth first; node 0 is the root."""

    tool: str  # name and version of the compiler
    job_digest: bytes  # SHA-256 of the job's canonical text, 32 bytes
    gripper: GripperSpec
    goal: GoalSpec
    limits: Limits
    nodes: tuple[Node, ...]
    leaves: tuple[Leaf, ...]
    predicted: Prediction
    job: str | None  # the job's canonical text, or None where it was stripped
    # The parts that may lie there, where there are several: rho and symmetry of the goal are the first's.
    hypotheses: tuple[Hypothesis, ...] = ()

    @property
    def pushing(self) -> int | None:
        """The first node before whose squeeze parts are pushed; None where there is none."""
        return next((index for index, node in enumerate(self.nodes) if node.pushes), None)

    def goal_of(self, hypothesis: int) -> GoalSpec:
        """The goal for a part, under its own symmetry."""
        if not self.hypotheses:
            return self.goal
        part = self.hypotheses[hypothesis]
        return replace(self.goal, rho_um=part.rho_um, symmetry=part.symmetry)

    def name_of(self, leaf: Leaf) -> str | None:
        """Which part a leaf names; None where only one may lie there."""
        return self.hypotheses[leaf.hypothesis].name if self.hypotheses else None
