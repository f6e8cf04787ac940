"""What a reading means, and what follows from it: the same for a run, its replay and its resumption.

`decide` turns one settled reading into a branch of a node. `advance` turns that branch into the next squeeze
or the part's outcome, by the table and the declared policy. Neither knows devices, files or time.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Self

from runtime.errors import GripperStateError, UsageError
from runtime.execution.results import Outcome
from runtime.table import HELD_UM, REJECT, Node, Table
from runtime.table import decide as look_up

MOVING, OPENING_CONTACT, CLOSING_CONTACT, ARRIVED = 0, 1, 2, 3


class Decision(NamedTuple):
    """What a reading means at a node.

    Attributes:
        branch: the branch taken, or `REJECT`.
        refused: for `REJECT`, the node none of whose branches fits.
        empty: for `REJECT`, whether the gripper says that it met nothing.
    """

    branch: int
    refused: Node | None = None
    empty: bool = False

    @property
    def reason(self) -> str | None:
        """Why it is `REJECT`, None where it is not; put into words when asked, not while deciding."""
        if self.refused is None:
            return None
        if self.empty:
            return "the fingers closed on nothing"
        widths = [
            f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f}"
            for branch in self.refused.branches
            if branch.expected_um >= HELD_UM  # an object was felt
        ]
        planned = f"{', '.join(widths)} mm" if widths else "nothing between the fingers"
        return f"no outcome of this squeeze has this width (planned: {planned})"


def decide(node: Node, decided: tuple[int, ...], count: int, object_flag: int) -> Decision:
    """What a settled reading means at a node; nothing is inferred.

    Args:
        node: the node.
        decided: its `decision_map`.
        count: settled encoder count, 0..255.
        object_flag: settled object flag, 2 or 3.

    Returns:
        The branch, or `REJECT` with its reason: nothing between the fingers, or a width nobody planned for.

    Raises:
        GripperStateError: the flag contradicts a closing motion.
    """
    if object_flag not in (CLOSING_CONTACT, ARRIVED):
        raise GripperStateError(
            f"object flag {object_flag} after a closing motion; the reading is not believed"
        )
    branch = look_up(decided, count, object_flag == CLOSING_CONTACT)
    return Decision(branch) if branch != REJECT else Decision(REJECT, node, object_flag == ARRIVED)


def release_point(node: Node, branch: int) -> tuple[int, int] | None:
    """Where a node wants the part let go, x and y in um; None for where the hand stands.

    Args:
        node: the node squeezed.
        branch: the branch taken, or `REJECT`: what nobody can name is not dragged anywhere.
    """
    if branch == REJECT or node.branches[branch].expected_um < HELD_UM:
        return None
    return node.release


class Response(Enum):
    """What follows a reject or an unresolved leaf; the value is its name on the command line."""

    RESQUEEZE = "resqueeze"  # the same squeeze once more
    RESTART = "restart"  # the part from the root
    NEXT = "next"  # the part is given up, the run goes on
    STOP = "stop"  # the part is given up and the run ends


ENDS = (Response.NEXT, Response.STOP)


@dataclass(frozen=True, slots=True)
class Policy:
    """What follows, response by response: each recovery is tried once a part, the last one is an end.

    Attributes:
        on_reject: after a squeeze that no branch explains.
        on_unresolved: after a leaf that is not resolved.
    """

    on_reject: tuple[Response, ...] = (Response.NEXT,)
    on_unresolved: tuple[Response, ...] = (Response.NEXT,)

    @classmethod
    def of(cls, on_reject: str, on_unresolved: str) -> Self:
        """The policy of two lists of names, as the command line and the journal hold them.

        Raises:
            UsageError: a name is unknown or comes twice, a re-squeeze is asked for at a leaf, or no end ends
                a list.
        """
        rejected, unresolved = (
            _responses("--on-reject", on_reject),
            _responses("--on-unresolved", on_unresolved),
        )
        if Response.RESQUEEZE in unresolved:
            raise UsageError("--on-unresolved: a leaf has no squeeze to repeat; use restart, next or stop")
        return cls(rejected, unresolved)

    def texts(self) -> tuple[str, str]:
        """The two lists of names that `of` reads."""
        return (
            ",".join(response.value for response in self.on_reject),
            ",".join(response.value for response in self.on_unresolved),
        )

    def ends_run(self, outcome: Outcome) -> bool:
        """Whether no further part follows one that ended so."""
        if outcome is Outcome.REJECT:
            return self.on_reject[-1] is Response.STOP
        if outcome is Outcome.UNRESOLVED:
            return self.on_unresolved[-1] is Response.STOP
        return outcome is not Outcome.LEAF


class Course(NamedTuple):
    """Where a part stands: the node to squeeze next, or its outcome.

    Attributes:
        node: index of the next node; meaningless once there is an outcome.
        outcome: LEAF, REJECT or UNRESOLVED, None while the part is under way.
        leaf: index of the leaf reached, or None.
        rejects: rejected squeezes so far.
        unresolved: unresolved leaves so far.
    """

    node: int = 0
    outcome: Outcome | None = None
    leaf: int | None = None
    rejects: int = 0
    unresolved: int = 0


def advance(course: Course, target: int | None, table: Table, policy: Policy) -> Course:
    """What follows a squeeze at `course.node`.

    Args:
        course: where the part stood.
        target: where the squeeze led: >= 0 a node, < 0 leaf ~target, None for REJECT.
        table: the table.
        policy: what follows a reject and an unresolved leaf.
    """
    if target is None:
        response = policy.on_reject[course.rejects]  # the last is an end: there is no further one
        course = course._replace(rejects=course.rejects + 1)
        if response in ENDS:
            return course._replace(outcome=Outcome.REJECT)
        return course if response is Response.RESQUEEZE else course._replace(node=0)
    if target >= 0:
        return Course(target, None, None, course.rejects, course.unresolved)
    if table.leaves[~target].resolved:
        return course._replace(outcome=Outcome.LEAF, leaf=~target)
    response = policy.on_unresolved[course.unresolved]
    course = course._replace(unresolved=course.unresolved + 1)
    if response in ENDS:
        return course._replace(outcome=Outcome.UNRESOLVED, leaf=~target)
    return course._replace(node=0)


def _responses(option: str, text: str) -> tuple[Response, ...]:
    names = [name.strip() for name in text.split(",")]
    known = ", ".join(response.value for response in Response)
    try:
        responses = tuple(Response(name) for name in names)
    except ValueError:
        raise UsageError(f"{option} {text!r}: name {known}, separated by commas") from None
    if responses[-1] not in ENDS:
        responses = (*responses, Response.NEXT)
    if len(set(responses)) != len(responses) or any(response in ENDS for response in responses[:-1]):
        raise UsageError(f"{option} {text!r}: each of {known} at most once, and next or stop last")
    return responses
