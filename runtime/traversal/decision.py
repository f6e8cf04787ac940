"""The decision for a reading at a node, and the policy: what follows a reject or an unresolved leaf."""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Self

from drivers.ports import ObjectState
from runtime.errors import GripperStateError
from runtime.shell.errors import UsageError
from runtime.table import REJECT, DecisionMap, Node, Table
from runtime.table import decide as look_up
from runtime.traversal.results import Outcome


class Decision(NamedTuple):
    """What a reading at a node means: the branch that it selects, or `REJECT`."""

    node: Node
    branch: int
    object: ObjectState

    @property
    def target(self) -> int | None:
        """Where the branch leads: to node `target` if >= 0, to leaf `~target` if < 0; None for `REJECT`."""
        return None if self.branch == REJECT else self.node.branches[self.branch].target

    @property
    def reason(self) -> str | None:
        """Why the reading is rejected; None if it is accepted."""
        if self.branch != REJECT:
            return None
        if self.object is ObjectState.AT_TARGET:
            return "the fingers closed on nothing"
        felt = (branch for branch in self.node.branches if branch.grip)  # an object was felt
        widths = [f"{each.low_um / 1000:.2f}..{each.high_um / 1000:.2f}" for each in felt]
        planned = f"{', '.join(widths)} mm" if widths else "nothing between the fingers"
        return f"no outcome of this squeeze has this width (planned: {planned})"


def decide(node: Node, decided: DecisionMap, width_um: int, seen: ObjectState) -> Decision:
    """Looks up the branch of a node that a settled reading selects, or `REJECT`.

    Args:
        node: the node.
        decided: the node's `decision_map`.
        width_um: the width of the reading, corrected by the gripper's calibration.
        seen: the object state of the reading.

    Raises:
        GripperStateError: the object state contradicts a closing motion.
    """
    if seen not in (ObjectState.CLOSING, ObjectState.AT_TARGET):
        raise GripperStateError(
            f"the gripper reports {seen.sentence} after a closing motion; the reading is not believed"
        )
    return Decision(node, look_up(decided, width_um, seen is ObjectState.CLOSING), seen)


class RecoveryAction(Enum):
    """What follows a reject or an unresolved leaf; the value is its name on the command line."""

    RESQUEEZE = "resqueeze"  # the same squeeze once more
    RESTART = "restart"  # the part is located again, from the root
    NEXT = "next"  # the part is given up, the run continues
    STOP = "stop"  # the part is given up and the run ends


ENDS = (RecoveryAction.NEXT, RecoveryAction.STOP)


@dataclass(frozen=True, slots=True)
class Policy:
    """The actions that follow a reject or an unresolved leaf.

    The first reject of a part takes the first action of `on_reject`, the second reject the second, and so on;
    likewise unresolved leaves and `on_unresolved`. The last action ends the part.
    """

    # actions after a reading that no branch has
    on_reject: tuple[RecoveryAction, ...] = (RecoveryAction.NEXT,)
    # actions after a leaf that is not resolved
    on_unresolved: tuple[RecoveryAction, ...] = (RecoveryAction.NEXT,)

    @classmethod
    def of(cls, on_reject: str, on_unresolved: str) -> Self:
        """Parses two lists of names, as the command line and the journal hold them.

        A list that ends with neither `next` nor `stop` gets `next` as its last action.

        Raises:
            UsageError: a name is unknown or repeated, a re-squeeze is requested at a leaf, or `next` or
                `stop` is not the last action.
        """
        rejected = _actions("--on-reject", on_reject)
        unresolved = _actions("--on-unresolved", on_unresolved)
        if RecoveryAction.RESQUEEZE in unresolved:
            raise UsageError(
                "--on-unresolved: a leaf has no squeeze to repeat; use restart, next or stop"
            )
        return cls(rejected, unresolved)

    def fields(self) -> dict[str, str]:
        """The names of the actions as two texts with commas, from which `of` restores the policy."""
        lists = {"on_reject": self.on_reject, "on_unresolved": self.on_unresolved}
        return {name: ",".join(each.value for each in actions) for name, actions in lists.items()}

    def ends_run(self, outcome: Outcome) -> bool:
        """Whether the run ends after a part with this outcome."""
        actions = {Outcome.REJECT: self.on_reject, Outcome.UNRESOLVED: self.on_unresolved}
        if outcome in actions:
            return actions[outcome][-1] is RecoveryAction.STOP
        return outcome is not Outcome.LEAF


class TraversalState(NamedTuple):
    """State of a part on its way through the table: the node to squeeze next, or the outcome."""

    node: int = 0  # index of the next node; meaningless once there is an outcome
    outcome: Outcome | None = None  # LEAF, REJECT or UNRESOLVED, None before the end
    leaf: int | None = None  # index of the leaf reached, or None
    rejects: int = 0  # rejected squeezes so far
    unresolved: int = 0  # unresolved leaves so far
    again: bool = False  # whether the squeeze is repeated, and so has no pushes before it


def advance(
    traversal: TraversalState, target: int | None, table: Table, policy: Policy
) -> TraversalState:
    """The part's state after a squeeze at `traversal.node` whose decision leads to `target`.

    Args:
        traversal: the state before the squeeze.
        target: `Decision.target`: a node, ~leaf, or None for `REJECT`.
        table: states which leaves are resolved.
        policy: determines what follows a reject or an unresolved leaf.
    """
    if target is not None and target >= 0:
        return traversal._replace(node=target, again=False)
    if target is None:
        outcome, leaf = Outcome.REJECT, None
        # The last action is final: there is no further one.
        action = policy.on_reject[traversal.rejects]
        traversal = traversal._replace(rejects=traversal.rejects + 1)
    else:
        outcome, leaf = Outcome.UNRESOLVED, ~target
        if table.leaves[leaf].resolved:
            return traversal._replace(outcome=Outcome.LEAF, leaf=leaf)
        action = policy.on_unresolved[traversal.unresolved]
        traversal = traversal._replace(unresolved=traversal.unresolved + 1)
    if action in ENDS:
        return traversal._replace(outcome=outcome, leaf=leaf)
    again = action is RecoveryAction.RESQUEEZE
    return traversal._replace(node=traversal.node if again else 0, again=again)


def _actions(option: str, text: str) -> tuple[RecoveryAction, ...]:
    names = [name.strip() for name in text.split(",")]
    known = ", ".join(action.value for action in RecoveryAction)
    try:
        actions = tuple(RecoveryAction(name) for name in names)
    except ValueError:
        raise UsageError(f"{option} {text!r}: name {known}, separated by commas") from None
    if actions[-1] not in ENDS:
        actions = (*actions, RecoveryAction.NEXT)
    if len(set(actions)) != len(actions) or any(action in ENDS for action in actions[:-1]):
        raise UsageError(f"{option} {text!r}: each of {known} at most once, and next or stop last")
    return actions
