"""Trials of a table in a world: squeezes parts, reads widths and looks up branches as the runtime does.

All parts of a chunk are squeezed in one batch, each at its own node.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import Encoder, encoder_of
from planner.belief.particles import initial
from planner.belief.transition import read_as
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.outcome import CRASHED, NOWHERE, REJECTED, Evaluation
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import beside_mm
from planner.mechanics.squeeze import GRASPED, JAMMED, STATUS_NAMES
from planner.mechanics.traits import Traits, by_hypothesis, ordinary
from planner.world import Assorted, ContactWorld, World, of_hypothesis
from runtime.shell.errors import UsageError
from runtime.table import HELD_UM, REJECT, Push, Segments, Squeeze, Table, decision_map

RUNNING = -2
DISMISSED = int(np.iinfo(np.int64).min)  # target of a width that fits no branch
HOLDING = (STATUS_NAMES[GRASPED], STATUS_NAMES[JAMMED])
SPAN = 1 << 21  # um, wider than any gripper opens


def placement_of(action: Squeeze | Push) -> Array:
    """Pose (3,) of the hand frame in the world at a squeeze, or at the start of a push [mm, mm, rad]."""
    return np.array([action.x_um / 1e3, action.y_um / 1e3, action.angle_urad / 1e6])


class Lookup(NamedTuple):
    """Step functions from width to branch, stored as arrays so that many widths are looked up at once."""

    start: IntArray  # (s,) ascending: first width of each segment [um], plus `SPAN` for each row before
    branch: IntArray  # (s,) the branch of widths from there on, or `REJECT`

    @classmethod
    def of(cls, rows: Sequence[Segments]) -> Self:
        """The lookup whose rows are the step functions `rows`."""
        starts = [SPAN * row + np.array(each.starts_um) for row, each in enumerate(rows)]
        return cls(np.concatenate(starts), np.concatenate([each.branches for each in rows]))

    def segment(self, row: IntArray, width_um: IntArray) -> IntArray:
        """Indices (n,) of the segments that contain non-negative widths (n,) [um] in rows (n,)."""
        return np.searchsorted(self.start, SPAN * row + width_um, side="right") - 1


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A table of N nodes as arrays."""

    table: Table  # the source
    placement: Array  # (N, 3) the hand frame in the world [mm, mm, rad]
    opening_mm: Array  # (N,) before the squeeze
    # From widths to a branch or `REJECT` (`runtime.table.decision_map`); two rows for each node:
    # without and with an object felt.
    lookup: Lookup
    target: IntArray  # (s,) target of each segment: a node, ~leaf, or `DISMISSED`
    carries: BoolArray  # (s,) whether the hand then carries the part, since the jaws hold it
    drag: Array  # (N, 2) how far the hand carries a held part before the jaws open [mm]
    pushes: BoolArray  # (N,) whether parts are pushed before the squeeze
    encoder: Encoder  # of the table's gripper

    @classmethod
    def of(cls, table: Table) -> Self:
        """The arrays of a table, with the nominal widths of its gripper."""
        maps = [decision_map(node, table.gripper) for node in table.nodes]
        target, carries = list[int](), list[bool]()
        drag = np.zeros((len(table.nodes), 2))
        for index, node in enumerate(table.nodes):
            if node.release is not None:
                drag[index] = np.array(node.release) / 1e3 - placement_of(node.squeeze)[:2]
            for number in (number for segments in maps[index] for number in segments.branches):
                meant = None if number == REJECT else node.branches[number]
                target.append(DISMISSED if meant is None else meant.target)
                carries.append(meant is not None and meant.expected_um >= HELD_UM)
        return cls(
            table=table,
            placement=np.array([placement_of(node.squeeze) for node in table.nodes]),
            opening_mm=np.array([node.squeeze.opening_um / 1e3 for node in table.nodes]),
            lookup=Lookup.of([segments for each in maps for segments in each]),
            target=np.array(target, np.int64),
            carries=np.array(carries),
            drag=drag,
            pushes=np.array([bool(node.pushes) for node in table.nodes]),
            encoder=encoder_of_table(table),
        )

    def segment(self, node: IntArray, reading: IntArray) -> IntArray:
        """Indices (n,) of the segments of `lookup` for readings (n,), as in `Step.reading`, at nodes (n,)."""
        width_um = self.encoder.width_um(reading >> 1)
        return self.lookup.segment(2 * node + (reading & 1), width_um)


def encoder_of_table(table: Table) -> Encoder:
    """The encoder of a table's gripper."""
    gripper = table.gripper
    return Encoder(gripper.opening_um / 1e3, gripper.steps, gripper.noise_um / 1e3)


class Step(NamedTuple):
    """Result of squeezing n parts once, each at its own node: poses, readings and branches taken."""

    before: Array  # (n, 3) poses in the world before it [mm, mm, rad]
    after: Array  # (n, 3) poses after it, with the jaws closed
    released: Array  # (n, 3) poses where the jaws open, after the drag of held parts
    width_mm: Array  # (n,) true openings
    reading: IntArray  # (n,) twice the encoder's reading, plus 1 if the gripper feels a part
    branch: IntArray  # (n,) the branch of that reading, or `REJECT`
    target: IntArray  # (n,) its target: a node, ~leaf, or `DISMISSED`

    @property
    def steps(self) -> IntArray:
        """(n,) the encoder's readings alone."""
        return self.reading >> 1

    def through(self, branch: int) -> Array:
        """Poses (m, 3), after the release, of the parts that take a branch, which may be `REJECT`."""
        return np.asarray(self.released[self.branch == branch])


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A cell that runs a table as the runtime would.

    Attributes:
        program: the table.
        job: states the true parts and gripper.
        world: squeezes and pushes the parts; it has randomness of its own.
        disturbance: errors of the cell.
        rng: draws initial poses, latent parameters, encoder noise and errors of the arm.
    """

    program: Program
    job: Job
    world: World
    disturbance: Disturbance
    rng: np.random.Generator

    def come_down(
        self, node: IntArray, poses: Array, traits: Traits
    ) -> tuple[Array, Array, BoolArray]:
        """Pushes each part as its node states, and lowers the open hand to squeeze it.

        Args:
            node: (n,) the node that each part is at.
            poses: (n, 3) where the parts lie in the world [mm, mm, rad].
            traits: (n,) of the parts.

        Returns:
            Poses (n, 3) of the parts after the pushes, poses (n, 3) of the hand, and a mask (n,) of the parts
            that a finger came down on, which stops the arm; False where the world cannot say.
        """
        program = self.program
        poses, pushed_on = self.pushed(node, poses, traits)
        placement = self.disturbance.placed(program.placement[node], traits, self.rng)
        hand, opening_mm = to_hand(poses, placement.T), program.opening_mm[node]
        return poses, placement, pushed_on | self._standing_on(hand, opening_mm, traits)

    def pushed(self, node: IntArray, poses: Array, traits: Traits) -> tuple[Array, BoolArray]:
        """Poses (n, 3) after the pushes at the parts' nodes; mask (n,) of parts that a finger came down on.

        Arguments as of `come_down`.

        Raises:
            UsageError: the world cannot push.
        """
        after, stopped = poses.copy(), np.zeros(len(node), np.bool_)
        for index in np.flatnonzero(self.program.pushes):
            for push in self.program.table.nodes[index].pushes:
                rows = np.flatnonzero((node == index) & ~stopped)
                planned = np.tile(placement_of(push), (len(rows), 1))
                hand = self.disturbance.placed(planned, traits[rows], self.rng)
                lying = to_hand(after[rows], hand.T)
                opening_mm = np.full(len(rows), push.opening_um / 1e3)
                way_mm = np.full(len(rows), push.length_um / 1e3)
                stopped[rows] = self._standing_on(lying, opening_mm, traits[rows])
                end = _push_all(self.world, lying, opening_mm, way_mm, traits[rows])
                after[rows] = to_world(end, hand.T)
        return after, stopped

    def squeezed(self, node: IntArray, poses: Array, placement: Array, traits: Traits) -> Step:
        """Squeezes each part once, reads the encoder, looks up the branch and releases the part.

        Args:
            node: (n,) the node that each part is at.
            poses: (n, 3) where the parts lie in the world [mm, mm, rad].
            placement: (n, 3) poses of the hand: those of the nodes, with the arm's errors.
            traits: (n,) of the parts.
        """
        program = self.program
        final, width_mm, held = _squeeze_all(self.world, to_hand(poses, placement.T), traits)
        reading = encoder_of(self.job).read(read_as(width_mm, traits), self.rng)
        reading = 2 * reading + (width_mm > 0.0)  # a part is felt if it keeps the jaws apart
        segment = program.segment(node, reading)
        drag = np.where(program.carries[segment][:, None], program.drag[node], 0.0)
        after = to_world(final, placement.T)
        released = after.copy()
        released[:, :2] += np.where(held[:, None], drag, 0.0)
        branch, target = program.lookup.branch[segment], program.target[segment]
        return Step(poses, after, released, width_mm, reading, branch, target)

    def run(self, trials: int) -> Evaluation:
        """Runs the table on a number of parts, at least 1."""
        poses, depth = initial(self.job, trials, self.rng), self.program.table.limits.max_depth
        nowhere, node = np.full((trials, depth), NOWHERE, np.int64), np.zeros(trials, np.int64)
        foreign = not isinstance(of_hypothesis(self.world, 0), ContactWorld)
        traits = self.disturbance.traits(self.job, trials, self.rng, foreign=foreign)
        result = Evaluation(
            self.program.table,
            leaf=np.full(trials, RUNNING, np.int64),
            squeezes=np.zeros(trials, np.int64),
            poses=poses.copy(),
            initial=poses,
            traits=traits,
            path=nowhere,
            reading=nowhere.copy(),
            branch=nowhere.copy(),
        )
        while len(members := np.flatnonzero(node >= 0)):
            arrived = self.come_down(node[members], result.poses[members], traits[members])
            result.poses[members], placement, stopped = arrived
            result.leaf[members[stopped]], node[members[stopped]] = CRASHED, NOWHERE
            members, placement = members[~stopped], placement[~stopped]
            if not len(members):
                break
            at, row = node[members], (members, result.squeezes[members])
            after = self.squeezed(at, result.poses[members], placement, traits[members])
            result.path[row], result.branch[row] = at, after.branch
            result.reading[row] = after.reading
            result.poses[members] = after.released
            result.squeezes[members] += 1
            leaf = np.where(after.target == DISMISSED, REJECTED, ~after.target)
            result.leaf[members] = np.where(after.target < 0, leaf, RUNNING)
            node[members] = np.maximum(after.target, NOWHERE)
        result.poses[:] -= self.disturbance.bias
        return result

    def _standing_on(self, hand: Array, opening_mm: Array, traits: Traits) -> BoolArray:
        """Mask (n,) of parts, at poses (n, 3) in the hand frame, that a finger comes down on.

        It is False where the world cannot say.
        """
        gripper, alone = self.job.gripper, self.job.alone
        stopped = np.zeros(len(hand), np.bool_)
        share = gripper.upper_finger_share + traits["share"]
        hand = hand.copy()
        hand[:, 1] -= beside_mm(share, gripper.opening_mm - opening_mm)
        for k, rows in by_hypothesis(traits):
            collides = getattr(of_hypothesis(self.world, k), "collides", None)
            if collides is None:
                continue
            reach = float(np.max(np.hypot(*alone[k].part.outline_mm.T)))
            near = np.abs(hand[rows, 1]) + reach > 0.5 * opening_mm[rows]
            near &= np.abs(hand[rows, 0]) < reach + gripper.finger_length_mm
            for part in np.arange(len(hand))[rows][near]:
                stopped[part] = collides(tuple(hand[part]), float(opening_mm[part]))
        return stopped


def _push_all(world: World, hand: Array, opening_mm: Array, way_mm: Array, traits: Traits) -> Array:
    """Final poses of parts pushed from poses (n, 3) in the hand frame, as a batch if the world can."""
    final = np.empty_like(hand)
    for k, rows in by_hypothesis(traits):
        part_world, each = of_hypothesis(world, k), (hand[rows], opening_mm[rows], way_mm[rows])
        many, one = (getattr(part_world, name, None) for name in ("push_many", "push"))
        if many is not None:
            alone = traits[rows].copy()
            alone["hypothesis"] = 0
            final[rows] = many(*each, alone)
        elif one is not None:
            pushes = zip(*(column.tolist() for column in each), strict=True)
            ends = [one(tuple(pose), opening, way) for pose, opening, way in pushes]
            final[rows] = np.reshape(ends, (-1, 3))
        else:
            message = f"the world {type(part_world).__name__} has no push()"
            raise UsageError(f"the table pushes parts, and {message}; name another world")
    return final


def _squeeze_all(world: World, hand: Array, traits: Traits) -> tuple[Array, Array, BoolArray]:
    """Squeezes parts at poses (n, 3) in the hand frame, as a batch if the world can.

    Returns:
        Final poses (n, 3) in the hand frame, true openings (n,) [mm], and mask (n,) of parts held at the end.
    """
    if isinstance(world, Assorted):
        final, width, held = np.empty_like(hand), np.empty(len(hand)), np.empty(len(hand), np.bool_)
        for k, rows in by_hypothesis(traits):
            alone = traits[rows].copy()
            alone["hypothesis"] = 0
            final[rows], width[rows], held[rows] = _squeeze_all(world.worlds[k], hand[rows], alone)
        return final, width, held
    many = getattr(world, "squeeze_many", None)
    if many is not None:
        rolled = many(hand) if ordinary(traits).all() else many(hand, traits)
        return rolled.poses, rolled.width_mm, np.isin(rolled.status, (GRASPED, JAMMED))
    results = [world.squeeze((float(x), float(y), float(theta))) for x, y, theta in hand]
    final = np.array([result[0] for result in results], dtype=np.float64).reshape(-1, 3)
    width = np.array([result[1] for result in results], dtype=np.float64)
    return final, width, np.array([result[2] in HOLDING for result in results])
