"""How long the squeezes of successive parts take, by the model in `timing`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from runtime.table.embedded import job_of, section
from runtime.table.geometry import Pose2, end_of, placement, turned_pose, way
from runtime.table.model import Node, Table
from runtime.table.timing import Phases, Timing, Visit
from runtime.table.turning import may_turn


class Squeezed(NamedTuple):
    """One squeeze of a part: its node, the width at which the jaws stopped, and the branch selected."""

    node: int
    width_mm: float
    branch: int  # branch of the node, `REJECT` for none


@dataclass(frozen=True, slots=True)
class Schedule:
    """Computes how long the squeezes of a table take in a cell."""

    nodes: Sequence[Node]
    timing: Timing
    # whether the plan of each part is turned about the origin to the hand's angle
    turns: bool = False

    @classmethod
    def of(cls, table: Table, job: Mapping[str, Any] | None) -> Self:
        """The schedule of a table; `job` is the job inside it, None where it was stripped.

        Raises:
            TableError: the gripper is unknown, or the job's figures are impossible.
        """
        timing = Timing.of(table.limits, table.gripper, job)
        return cls(table.nodes, timing, may_turn(table, job))

    def part(self, squeezes: Sequence[Squeezed], start: Pose2 | None = None) -> list[Phases]:
        """Computes the phases of each squeeze of a part.

        The hand starts above the pose `start`; None: above the place of the first squeeze.
        """
        before, jaws_s, all_phases = start, 0.0, []
        for number, squeezed in enumerate(squeezes):
            after = squeezes[number + 1].node if number + 1 < len(squeezes) else None
            first = number == 0
            phases, before, jaws_s = self.squeeze(squeezed, before, after, jaws_s, first=first)
            all_phases.append(phases)
        return all_phases

    def squeeze(
        self,
        squeezed: Squeezed,
        before: Pose2 | None,
        after: int | None,
        jaws_s: float = 0.0,
        *,
        first: bool,
    ) -> tuple[Phases, Pose2, float]:
        """Computes the seconds of the phases of one squeeze.

        Args:
            squeezed: the node and the outcome of the squeeze.
            before: pose of the hand before the squeeze; None: above the place of the squeeze.
            after: index of the part's next node; None after its last squeeze.
            jaws_s: seconds for which the jaws go on opening after the squeeze has begun.
            first: whether it is the part's first squeeze, before which the hand is at the retreat height.

        Returns:
            The phases, the pose of the hand after the squeeze, and the seconds for which the jaws go on
            opening after it.
        """
        node, timing = self.nodes[squeezed.node], self.timing
        squeeze, place = node.squeeze, placement(node.squeeze)
        following = self.nodes[0 if after is None else after]
        if first and self.turns and before is not None:
            # The plan of the next part is turned; converts the hand's place to its frame.
            before = turned_pose(before, -way(place, before)[1])
        push_s, before = self._push_s(node, before or place)
        let_go = placement(squeeze, node.release_point(squeezed.branch))
        way_mm, turn_rad = way(before, place)
        visit = Visit(
            way_mm=way_mm,
            turn_rad=turn_rad,
            opening_mm=squeeze.opening_um / 1e3,
            contact_mm=None if node.contact_um is None else node.contact_um / 1e3,
            width_mm=squeezed.width_mm,
            speed_mm_s=squeeze.speed_um_s / 1e3,
            next_mm=following.squeeze.opening_um / 1e3,
            drag_mm=way(place, let_go)[0],
            from_retreat=first or bool(node.pushes),
            to_retreat=after is None or bool(following.pushes),
            jaws_s=0.0 if node.pushes else jaws_s,
        )
        phases = timing.squeeze(visit)._replace(push_s=push_s)
        left_s = timing.opening_s(visit.width_mm, visit.next_mm, visit.speed_mm_s) - phases.rise_s
        return phases, let_go, max(left_s, 0.0)

    def _push_s(self, node: Node, at: Pose2) -> tuple[float, Pose2]:
        """Seconds that a node's pushes take, if the hand starts at `at`, and the hand's pose after them."""
        timing, seconds = self.timing, 0.0
        open_mm, speed_mm_s = node.squeeze.opening_um / 1e3, node.squeeze.speed_um_s / 1e3
        for push in node.pushes:
            wanted_mm = push.opening_um / 1e3
            seconds += timing.push_s(
                *way(at, placement(push)),
                stroke_mm=abs(open_mm - wanted_mm),
                stroke_mm_s=speed_mm_s,
                push_mm=push.length_um / 1e3,
                push_mm_s=push.speed_um_s / 1e3,
            )
            at, open_mm = end_of(push), wanted_mm
        if node.pushes:
            stroke_mm = abs(node.squeeze.opening_um / 1e3 - open_mm)
            seconds += stroke_mm / speed_mm_s + timing.jaw_answer_s
        return seconds, at


def close_alike(table: Table) -> bool:
    """Whether the job states that both fingers move equally far when the jaws close.

    If so, a squeeze with the hand turned by 180 degrees has the same effect.
    """
    return section(job_of(table) or {}, "gripper").get("upper_finger_share") == 0.5
