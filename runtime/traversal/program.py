"""The program of a part: the requests to a cell, in order, until the part's outcome is known.

Executor, decision server and replay all run this program: each of them performs the requests in its own way,
and answers a squeeze with a reading. The program itself uses no devices, files or clocks.
"""

from collections.abc import Generator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, Self

from drivers.ports import ObjectState
from runtime.table import REJECT, Calibration, Node, Place, Table, decision_map, turned
from runtime.traversal.decision import Policy, TraversalState, advance, decide
from runtime.traversal.results import Outcome, PartResult, Step


class Reading(NamedTuple):
    """The settled reading with which a cell answers `Approach` and `Tighten`."""

    width_um: int  # width as the gripper reads it
    object: ObjectState


@dataclass(frozen=True, slots=True)
class Approach:
    """Request to go to a node's place, and to close the jaws there until they meet something.

    The node's pushes are performed first, unless the squeeze is repeated.
    """

    index: int  # index of the node
    node: Node
    number: int  # number of the squeeze, from 1, within the part
    again: bool  # whether the squeeze is repeated


@dataclass(frozen=True, slots=True)
class Tighten:
    """Request to raise the force of the closed jaws to the node's force, and to read again.

    It follows a reading that no branch has, or that leads to a drag of the part.
    """


@dataclass(frozen=True, slots=True)
class Release:
    """Request to record the squeeze and its decision, to drag the part to `point`, and to release it."""

    index: int  # index of the node
    node: Node
    steps: tuple[Step, ...]  # steps of the part so far, including the decided one
    point: Place | None  # None: the part is released where it is
    after: TraversalState  # state of the part after the step
    following: Node  # next node; the root where the part is done

    @property
    def step(self) -> Step:
        """The squeeze that this release ends, with its reading and decision."""
        return self.steps[-1]


@dataclass(frozen=True, slots=True)
class Done:
    """The last request: states the part's result."""

    result: PartResult


START = TraversalState()
Request = Approach | Tighten | Release | Done
Requests = Generator[Request, Reading | None, None]


class Program:
    """Generates the requests by which parts are located with a table, part by part."""

    def __init__(self, table: Table, calibration: Calibration, policy: Policy) -> None:
        self.maps = [decision_map(node, table.gripper) for node in table.nodes]
        self.table = table
        self._calibration, self._policy = calibration, policy

    def turned(self, turn_urad: int) -> Self:
        """A copy of the program whose plan is turned about the origin by `turn_urad`."""
        program = copy(self)
        program.table = turned(self.table, turn_urad)
        return program

    def part(
        self, number: int, state: TraversalState = START, steps: Sequence[Step] = ()
    ) -> Requests:
        """Yields the requests to the cell that locate one part.

        The caller performs each request, and sends a reading as the answer to `Approach` and `Tighten`.

        Args:
            number: number of the part.
            state: state from which the part goes on; by default the first squeeze comes next.
            steps: the squeezes that have led to `state`.

        Raises:
            GripperStateError: a reading contradicts a closing motion.
        """
        table, steps = self.table, tuple(steps)
        while state.outcome is None:
            index, node = state.node, table.nodes[state.node]
            reading = yield Approach(index, node, len(steps) + 1, state.again)
            assert reading is not None
            decision = decide(node, self.maps[index], self._width_um(reading), reading.object)
            if decision.branch == REJECT or node.release_point(decision.branch) is not None:
                reading = yield Tighten()
                assert reading is not None
                decision = decide(node, self.maps[index], self._width_um(reading), reading.object)
            step = Step(
                number=len(steps) + 1,
                node=index,
                squeeze=node.squeeze,
                reading_um=reading.width_um,
                width_um=self._width_um(reading),
                target=decision.target,
                reason=decision.reason,
            )
            steps = (*steps, step)
            state = advance(state, step.target, table, self._policy)
            following = table.nodes[0 if state.outcome is not None else state.node]
            point = node.release_point(decision.branch)
            yield Release(index, node, steps, point, state, following)
        yield Done(PartResult.of(number, state.outcome, steps, _reason(state, steps)))

    def _width_um(self, reading: Reading) -> int:
        return self._calibration.width_um(reading.width_um)


def released(requests: Requests, request: Request, reading: Reading) -> Release:
    """Answers a part's program with one reading until it requests a `Release`; returns that request.

    Args:
        requests: the program.
        request: the current request of the program.
        reading: the answer to every request before the `Release`.
    """
    while not isinstance(request, Release):
        request = requests.send(reading)
    return request


def _reason(state: TraversalState, steps: Sequence[Step]) -> str | None:
    """Returns why a part did not end in a resolved leaf; None if it ended in one."""
    if state.outcome is Outcome.REJECT:
        return steps[-1].reason
    if state.outcome is Outcome.UNRESOLVED:
        return f"leaf {state.leaf} is not resolved: the table cannot tell the pose well enough"
    return None
