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
from planner.mechanics.traits import Traits, ordinary
from planner.part.outline import reach
from planner.world import World, by_world, is_contact
from runtime.shell.errors import UsageError
from runtime.table import REJECT, Push, Segments, Squeeze, Table, decision_map

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
        """Builds the lookup of several step functions; row k looks up in the function `rows[k]`."""
        starts = [SPAN * row + np.array(each.starts_um) for row, each in enumerate(rows)]
        return cls(np.concatenate(starts), np.concatenate([each.branches for each in rows]))

    def segment(self, row: IntArray, width_um: IntArray) -> IntArray:
        """Index (n,) of the segment that contains each width (n,) [um] in the step function of its row (n,).

        The widths must not be negative.
        """
        return np.searchsorted(self.start, SPAN * row + width_um, side="right") - 1


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A table of N nodes as arrays."""

    table: Table  # the source
    placement: Array  # (N, 3) the hand frame in the world [mm, mm, rad]
    opening_mm: Array  # (N,) opening of the jaws before the squeeze
    # From widths to a branch or `REJECT` (`runtime.table.decision_map`); two rows for each node:
    # without and with an object felt.
    lookup: Lookup
    target: IntArray  # (s,) target of each segment: a node, ~leaf, or `DISMISSED`
    drag: Array  # (s, 2) how far the hand then carries a held part before the jaws open [mm]
    encoder: Encoder  # encoder of the table's gripper

    @classmethod
    def of(cls, table: Table) -> Self:
        """Converts a table to arrays, with the nominal width that belongs to each reading of its gripper."""
        placement = np.array([placement_of(node.squeeze) for node in table.nodes])
        rows, target, drag = list[Segments](), list[int](), list[Array]()
        for node, place in zip(table.nodes, placement[:, :2], strict=True):
            for segments in decision_map(node, table.gripper):
                rows.append(segments)
                for number in segments.branches:
                    target.append(DISMISSED if number == REJECT else node.branches[number].target)
                    point = node.release_point(number)
                    drag.append(np.zeros(2) if point is None else np.array(point) / 1e3 - place)
        return cls(
            table=table,
            placement=placement,
            opening_mm=np.array([node.squeeze.opening_um / 1e3 for node in table.nodes]),
            lookup=Lookup.of(rows),
            target=np.array(target, np.int64),
            drag=np.array(drag),
            encoder=encoder_of_table(table),
        )

    def segment(self, node: IntArray, reading: IntArray) -> IntArray:
        """Index (n,) of the segment of `lookup` for each reading (as in `Step.reading`) at a node (n,)."""
        width_um = self.encoder.width_um(reading >> 1)
        return self.lookup.segment(2 * node + (reading & 1), width_um)


def encoder_of_table(table: Table) -> Encoder:
    """The encoder of a table's gripper."""
    gripper = table.gripper
    return Encoder(gripper.opening_um / 1e3, gripper.steps, gripper.noise_um / 1e3)


class Step(NamedTuple):
    """Result of squeezing n parts once, each at the node it has reached: poses, readings, branches."""

    before: Array  # (n, 3) poses in the world before the squeeze [mm, mm, rad]
    after: Array  # (n, 3) poses after the squeeze, with the jaws closed
    released: Array  # (n, 3) poses where the jaws open, after the drag of held parts
    width_mm: Array  # (n,) true openings
    reading: IntArray  # (n,) twice the encoder's reading, plus 1 if the gripper feels a part
    branch: IntArray  # (n,) the branch of that reading, or `REJECT`
    target: IntArray  # (n,) its target: a node, ~leaf, or `DISMISSED`

    @property
    def steps(self) -> IntArray:
        """(n,) the encoder's readings without the flag that the gripper feels a part."""
        return self.reading >> 1

    def through(self, branch: int) -> Array:
        """Poses (m, 3), after the release, of the parts that took a branch; `REJECT` counts as a branch."""
        return np.asarray(self.released[self.branch == branch])


class Split(NamedTuple):
    """Trials in which some parts are followed as several copies; each row is a part or one of its copies."""

    evaluation: Evaluation
    part: IntArray  # (n,) number of the part
    weight: Array  # (n,) weight of the row; the weights of one part add up to 1


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
            traits: (n,) latent parameters of the parts.

        Returns:
            Poses (n, 3) of the parts after the pushes, poses (n, 3) of the hand, and a mask (n,) of the parts
            that a finger came down on, which stops the arm. The mask is False where the world cannot detect
            this.
        """
        program = self.program
        poses, pushed_on = self.pushed(node, poses, traits)
        placement = self.disturbance.placed(program.placement[node], traits, self.rng)
        hand, opening_mm = to_hand(poses, placement.T), program.opening_mm[node]
        return poses, placement, pushed_on | self._standing_on(hand, opening_mm, traits)

    def pushed(self, node: IntArray, poses: Array, traits: Traits) -> tuple[Array, BoolArray]:
        """Pushes each part as its node states.

        See `come_down` for the arguments.

        Returns:
            Poses (n, 3) of the parts after the pushes, and a mask (n,) of the parts that a finger came down
            on.

        Raises:
            UsageError: the world cannot push.
        """
        after, stopped = poses.copy(), np.zeros(len(node), np.bool_)
        for index, planned_node in enumerate(self.program.table.nodes):
            for push in planned_node.pushes:
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
            placement: (n, 3) poses of the hand: the placements of the nodes, with the arm's errors.
            traits: (n,) latent parameters of the parts.
        """
        program = self.program
        final, width_mm, held = _squeeze_all(self.world, to_hand(poses, placement.T), traits)
        reading = encoder_of(self.job).read(read_as(width_mm, traits), self.rng)
        reading = 2 * reading + (width_mm > 0.0)  # a part is felt if it keeps the jaws apart
        segment = program.segment(node, reading)
        after = to_world(final, placement.T)
        released = after.copy()
        released[:, :2] += np.where(held[:, None], program.drag[segment], 0.0)
        branch, target = program.lookup.branch[segment], program.target[segment]
        return Step(poses, after, released, width_mm, reading, branch, target)

    def run(self, trials: int) -> Evaluation:
        """Runs the table on a number of parts, at least 1."""
        return self.split(trials, np.ones(len(self.program.table.nodes), np.int64)).evaluation

    def split(self, parts: int, copies: IntArray) -> Split:
        """Runs the table on parts, at least 1; from rare nodes on, each part is followed as several copies.

        Args:
            parts: number of parts.
            copies: (N,) total number of copies of a part at each node, including those made at earlier nodes;
                powers of two.
        """
        poses, nodes = initial(self.job, parts, self.rng), np.zeros(parts, np.int64)
        contact = is_contact(self.world)
        nowhere = np.full((parts, self.program.table.limits.max_depth), NOWHERE, np.int64)
        result = Evaluation(
            self.program.table,
            leaf=np.full(parts, REJECTED, np.int64),
            squeezes=np.zeros(parts, np.int64),
            poses=poses.copy(),
            initial=poses,
            traits=self.disturbance.traits(self.job, parts, self.rng, contact=contact),
            path=nowhere,
            reading=nowhere.copy(),
            branch=nowhere.copy(),
        )
        part, weight = np.arange(parts), np.ones(parts)
        while len(members := np.flatnonzero(nodes >= 0)):
            node, traits = nodes[members], result.traits[members]
            arrived, placement, stopped = self.come_down(node, result.poses[members], traits)
            result.poses[members] = arrived
            result.leaf[members[stopped]], nodes[members[stopped]] = CRASHED, NOWHERE
            members, node, arrived = members[~stopped], node[~stopped], arrived[~stopped]
            if not len(members):
                break
            after = self.squeezed(node, arrived, placement[~stopped], traits[~stopped])
            row = members, result.squeezes[members]
            result.path[row], result.branch[row] = node, after.branch
            result.reading[row] = after.reading
            result.poses[members] = after.released
            result.squeezes[members] += 1
            # Preliminary where another node follows.
            result.leaf[members] = np.where(after.target == DISMISSED, REJECTED, ~after.target)
            nodes[members] = np.maximum(after.target, NOWHERE)
            times = np.where(nodes >= 0, copies[nodes] * weight, 1.0)
            if times.max() > 1.0:
                rows = np.repeat(np.arange(len(nodes)), times.astype(np.int64))
                result, nodes, part = result.of_rows(rows), nodes[rows], part[rows]
                weight = (weight / times)[rows]
        result.poses[:] -= self.disturbance.bias
        return Split(result, part, weight)

    def _standing_on(self, hand: Array, opening_mm: Array, traits: Traits) -> BoolArray:
        """Mask (n,) of the parts, at poses (n, 3) in the hand frame, that a finger comes down on.

        The mask is False where the world cannot detect this.
        """
        gripper, stopped = self.job.gripper, np.zeros(len(hand), np.bool_)
        share, closed_mm = gripper.upper_finger_share, gripper.opening_mm - opening_mm
        hand = hand.copy()
        # A world knows the share that the job states; only an error of the share is left.
        hand[:, 1] -= beside_mm(0.5 + traits["share"], closed_mm)
        reaches = np.array([reach(alone.part.outline_mm) for alone in self.job.alone])
        far = reaches[traits["hypothesis"]]
        near = np.abs(hand[:, 1] - beside_mm(share, closed_mm)) + far > 0.5 * opening_mm
        near &= np.abs(hand[:, 0]) < far + gripper.finger_length_mm
        for world, rows, _ in by_world(self.world, traits):
            collides = getattr(world, "collides", None)
            if collides is not None:
                for k in rows[near[rows]]:
                    stopped[k] = collides(tuple(hand[k]), float(opening_mm[k]))
        return stopped


def _push_all(world: World, hand: Array, opening_mm: Array, way_mm: Array, traits: Traits) -> Array:
    """Pushes parts at poses (n, 3) in the hand frame, in a batch if the world can.

    Returns the final poses (n, 3), in the frame that the hand had at the start.
    """
    final = np.empty_like(hand)
    for part_world, rows, alone in by_world(world, traits):
        many, one = (getattr(part_world, name, None) for name in ("push_many", "push"))
        if many is not None:
            final[rows] = many(hand[rows], opening_mm[rows], way_mm[rows], alone)
            continue
        if one is None:
            message = f"the world {type(part_world).__name__} has no push()"
            raise UsageError(f"the table pushes parts, and {message}; name another world")
        for k in rows:
            final[k] = one(tuple(hand[k].tolist()), float(opening_mm[k]), float(way_mm[k]))
    return final


def _squeeze_all(world: World, hand: Array, traits: Traits) -> tuple[Array, Array, BoolArray]:
    """Squeezes parts at poses (n, 3) in the hand frame, as a batch if the world can.

    Returns:
        Final poses (n, 3) in the hand frame, true widths (n,) [mm], and mask (n,) of parts held at the end.
    """
    final, width_mm, held = np.empty_like(hand), np.empty(len(hand)), np.empty(len(hand), np.bool_)
    for part_world, rows, alone in by_world(world, traits):
        many = getattr(part_world, "squeeze_many", None)
        if many is not None:
            rolled = many(hand[rows]) if ordinary(alone).all() else many(hand[rows], alone)
            final[rows], width_mm[rows] = rolled.poses, rolled.width_mm
            held[rows] = np.isin(rolled.status, (GRASPED, JAMMED))
        else:
            for k in rows:
                x, y, theta = hand[k].tolist()
                final[k], width_mm[k], status = part_world.squeeze((x, y, theta))
                held[k] = status in HOLDING
        if not (np.isfinite(final[rows]).all() and np.isfinite(width_mm[rows]).all()):
            named = type(part_world).__name__
            raise UsageError(f"the world {named} gives a pose or width that is no finite number")
    return final, width_mm, held
