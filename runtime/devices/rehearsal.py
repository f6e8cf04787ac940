"""A world without physics: a squeeze returns a width drawn from the table's probabilities.

A run in this world shows that runtime, gripper and arm work together. It says nothing about the plan, since
the widths come from the table itself. Where the planner is installed, the planner's world with contact
mechanics is used instead.
"""

from math import dist, pi, remainder, tau
from random import Random

from runtime.shell.errors import UsageError
from runtime.table import Branch, Node, Pose2, Table, decision_map
from runtime.table.geometry import compose, placement

# The arm is read back to 0.01 mm and about 1 mrad, so poses of one part agree only to this.
SAME_MM, SAME_RAD = 0.1, 0.01
NOISE_SIGMAS = 3.0


def make(job: object, seed: int) -> "Rehearsal":
    """Builds the rehearsal of a table; `runtime.devices.rehearsal:make` names this world to `grasp-cell`.

    Raises:
        UsageError: `job` is not a table, and so has no probabilities.
    """
    if not isinstance(job, Table):
        raise UsageError(
            "a rehearsal draws from a table's statistics; start grasp-cell with --tree"
        )
    return Rehearsal(job, seed)


class Rehearsal:
    """Simulates squeezes: draws a branch of the node by its probability, and a width within the branch.

    The part never moves. The place of a squeeze determines what the squeeze is:

    - at the place of the last squeeze, a re-squeeze or a later stroke of a regulated squeeze; both end at the
      last width;
    - at the place of a child of the last node, the part's next squeeze;
    - at any other place, the first squeeze of a new part.
    """

    def __init__(self, table: Table, seed: int) -> None:
        self._table = table
        self._random = Random(seed)
        self._next: list[int] = []  # nodes that may come next, the drawn one first
        self._lies: list[Pose2] = []  # poses of the part in the world that the last squeeze allows
        self._last, self._width_mm, self._status = 0, 0.0, "untouched"

    def squeeze(self, pose_hand: Pose2) -> tuple[Pose2, float, str]:
        """Squeezes a part that lies at a pose in the hand's frame [mm, mm, rad].

        The branch that the part takes is drawn with the probabilities of the table.

        Returns:
            The pose, unchanged; the width of the branch in mm, without encoder noise; and "grasped", or
            "untouched" if the branch is that of an empty hand.
        """
        index = self._node_of(pose_hand)
        if index is None:
            return pose_hand, self._width_mm, self._status
        node = self._table.nodes[index]
        branch = self._random.choices(
            node.branches, weights=[branch.probability_ppm for branch in node.branches]
        )[0]
        self._lies = self._poses(index, pose_hand)
        targets = (other.target for other in node.branches if other.target >= 0)
        self._next = sorted(targets, key=lambda target: target != branch.target)
        self._last, self._width_mm = index, self._width_um(node, branch) / 1000
        self._status = "grasped" if branch.grip else "untouched"
        return pose_hand, self._width_mm, self._status

    def _node_of(self, pose_hand: Pose2) -> int | None:
        """Finds the node whose squeeze is executed, given the part's pose in the hand's frame.

        The part lies in the world as at the last squeeze. A node fits if a hand at the node's grasp pose
        would have the part at `pose_hand`. The children of the last node are tried first, then the last node
        itself.

        Returns:
            The index of the first child that fits; None if only the last node fits, whose squeeze is then
            repeated; 0 if no node fits: a new part begins at the root.
        """
        for index in (*self._next, self._last):
            seen = self._poses(index, pose_hand)
            if any(_same(one, other) for one in seen for other in self._lies):
                return index if index in self._next else None
        return 0

    def _poses(self, index: int, pose_hand: Pose2) -> list[Pose2]:
        """The possible poses in the world of a part whose pose in the hand's frame is `pose_hand`.

        There are two: one if the hand is at the node's grasp pose, one if it is turned half round.
        """
        x_mm, y_mm, angle_rad = placement(self._table.nodes[index].squeeze)
        return [compose((x_mm, y_mm, angle), pose_hand) for angle in (angle_rad, angle_rad + pi)]

    def _width_um(self, node: Node, branch: Branch) -> float:
        """Draws a width, um, that selects a branch even with encoder noise, if the branch is wide enough."""
        mine = node.branches.index(branch)
        meant = decision_map(node, self._table.gripper).either.intervals()
        low = min(start for start, _, number in meant if number == mine)
        high = max(end for _, end, number in meant if number == mine)
        gripper = self._table.gripper
        margin = NOISE_SIGMAS * gripper.noise_um + gripper.profile.resolution_um
        room = min(margin, (high - low) / 2)
        return self._random.uniform(low + room, high - room)


def _same(one: Pose2, other: Pose2) -> bool:
    return dist(one[:2], other[:2]) < SAME_MM and abs(remainder(one[2] - other[2], tau)) < SAME_RAD
