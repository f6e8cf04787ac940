"""The likeliest path through a table, step by step: possible poses after each squeeze, and one part."""

from collections.abc import Collection
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.evaluation.trials import placement_of
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.report import canvas
from planner.report.replay import Replay
from runtime.table import Table

SQUEEZES = range(1, 4)  # lengths of the path for which the scenes fit beside each other


class Scene(NamedTuple):
    """The belief before the first squeeze, or after one of the squeezes, and one part at that time."""

    number: int  # number of the squeeze; 0 before the first one
    belief: Array  # (m, 3 or 4) states of the parts, as `with_hypothesis` returns them
    share: float  # share of all parts that are in the belief
    angle_deg: float  # angle of the hand that has squeezed
    width_mm: float  # expected reading
    closed: Array  # (0 or 2, 4, 2) fingers, closed to the expected width [mm]
    before: Array  # (3 or 4,) state of the one part before the squeeze
    after: Array  # (3 or 4,) state of the one part after the squeeze
    holding: Array  # (0 or 2, 4, 2) fingers, closed to the width of the one part [mm]

    @property
    def caption(self) -> str:
        """Text: which squeeze, its reading, and the share of parts that are left."""
        if not self.number:
            return "Before: all parts"
        squeeze = f"Squeeze {self.number} at {self.angle_deg:.0f}°"
        return f"{squeeze} reads {self.width_mm:.1f} mm: {self.share:.0%} of the parts"


class Step(NamedTuple):
    """One squeeze on a path through a table: the node, and the branch of the reading."""

    node: int
    branch: int


def likeliest_path(table: Table, beliefs: Replay, squeezes: Collection[int]) -> list[Step]:
    """The path from the root to the leaf in which most parts end.

    If possible, only paths with a number of squeezes in `squeezes` are considered.
    """
    results: list[tuple[int, list[Step]]] = []
    waiting: list[tuple[int, list[Step]]] = [(0, [])]
    while waiting:
        index, path = waiting.pop()
        for number, branch in enumerate(table.nodes[index].branches):
            steps = [*path, Step(index, number)]
            if branch.target >= 0:
                waiting.append((branch.target, steps))
            else:
                results.append((len(beliefs.visits[index].through(number)), steps))
    return max(results, key=lambda path: (path[0] > 0 and len(path[1]) in squeezes, path[0]))[1]


def scenes(table: Table, job: Job, beliefs: Replay, squeezes: Collection[int]) -> list[Scene]:
    """Scenes on the likeliest path: one before the first squeeze, and one after each squeeze."""
    whole = likeliest_path(table, beliefs, squeezes)
    # The path is cut off before a squeeze at which no replayed part takes its branch.
    path = list(takewhile(lambda at: np.any(beliefs.visits[at.node].branch == at.branch), whole))
    parts = _one_part(beliefs, path)
    everything, first = beliefs.arrivals[0], parts[0] if parts else 0
    hypothesis = everything[first, 3:]
    before = np.append(beliefs.visits[0].before[first], hypothesis)
    none, jaws = np.empty((0, 4, 2)), jaws_of(job.gripper)
    result = [Scene(0, everything, 1.0, 0.0, 0.0, none, before, before, none)]
    for k, (step, number) in enumerate(zip(path, parts, strict=True), 1):
        node, visit = table.nodes[step.node], beliefs.visits[step.node]
        branch, hand = node.branches[step.branch], placement_of(node.squeeze)
        target = branch.target
        states = beliefs.arrivals[target] if target >= 0 else beliefs.leaves[~target]
        width_mm, share = branch.expected_um / 1e3, len(states) / len(everything)
        closed, holding = (
            canvas.placed(canvas.finger_boxes(jaws, width), hand)
            for width in (width_mm, float(visit.width_mm[number]))
        )
        after = np.append(visit.after[number], hypothesis)
        moved = closed, before, after, holding
        result.append(Scene(k, states, share, float(np.degrees(hand[2])), width_mm, *moved))
        before = after
    return result


def _one_part(beliefs: Replay, path: list[Step]) -> list[int]:
    """Chooses a part that takes the whole path; returns its index among the parts at each of the nodes."""
    part, numbers = 0, list[int]()
    for step in reversed(path):
        part = int(np.flatnonzero(beliefs.visits[step.node].branch == step.branch)[part])
        numbers.append(part)
    return numbers[::-1]
