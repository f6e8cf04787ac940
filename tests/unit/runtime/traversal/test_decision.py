"""What follows a squeeze: the table's branch, then the policy, which applies each recovery once."""

import itertools
from random import Random

import pytest
from sample_tables import GRIPPER, changed, random_table, small_table

from drivers.ports import ObjectState
from runtime.errors import GripperStateError
from runtime.shell.errors import UsageError
from runtime.table import REJECT, Place, decision_map
from runtime.traversal.decision import Policy, RecoveryAction, TraversalState, advance, decide
from runtime.traversal.results import Outcome

CONTACT, ARRIVED = ObjectState.CLOSING, ObjectState.AT_TARGET
TABLE = small_table()  # leaf 2 is not resolved
UNRESOLVED = ~2


def walk(targets: list[int | None], policy: Policy) -> list[TraversalState]:
    traversals = [TraversalState()]
    for target in targets:
        assert traversals[-1].outcome is None, "a part that came to its end is not squeezed again"
        traversals.append(advance(traversals[-1], target, TABLE, policy))
    return traversals


@pytest.mark.parametrize(
    ("on_reject", "on_unresolved", "targets", "nodes", "outcome", "leaf"),
    [
        ("next", "next", [~0], [], Outcome.LEAF, 0),
        ("next", "next", [1, ~1], [1], Outcome.LEAF, 1),
        ("next", "next", [None], [], Outcome.REJECT, None),
        ("stop", "next", [1, None], [1], Outcome.REJECT, None),
        ("next", "next", [1, UNRESOLVED], [1], Outcome.UNRESOLVED, 2),
        ("resqueeze,next", "next", [1, None, None], [1, 1], Outcome.REJECT, None),
        ("resqueeze,next", "next", [1, None, ~1], [1, 1], Outcome.LEAF, 1),
        ("restart,next", "next", [1, None, ~0], [1, 0], Outcome.LEAF, 0),
        ("resqueeze,restart,stop", "next", [1, None, None, None], [1, 1, 0], Outcome.REJECT, None),
        ("next", "restart,stop", [1, UNRESOLVED, 1, UNRESOLVED], [1, 0, 1], Outcome.UNRESOLVED, 2),
        ("restart", "restart", [None, 1, UNRESOLVED, ~0], [0, 1, 0], Outcome.LEAF, 0),
    ],
)
def test_advance_applies_each_recovery_once(
    on_reject, on_unresolved, targets, nodes, outcome, leaf
):
    traversals = walk(targets, Policy.of(on_reject, on_unresolved))
    assert [traversal.node for traversal in traversals[1:-1]] == nodes
    assert (traversals[-1].outcome, traversals[-1].leaf) == (outcome, leaf)
    assert traversals[-1].rejects == targets.count(None)
    assert traversals[-1].unresolved == targets.count(UNRESOLVED)


RECOVERIES = ["next", "stop", "resqueeze,next", "restart,stop"]
RECOVERIES += ["resqueeze,restart,next", "restart,resqueeze,stop"]


@pytest.mark.parametrize("on_reject", RECOVERIES)
@pytest.mark.parametrize("on_unresolved", ["next", "restart,next", "restart,stop"])
def test_advance_any_readings_end_within_limit_of_policy(on_reject, on_unresolved):
    table, random = random_table(0, 20), Random(0)
    policy = Policy.of(on_reject, on_unresolved)
    most = (len(policy.on_reject) + len(policy.on_unresolved)) * table.limits.max_depth
    for percent in range(100):
        traversal, steps = TraversalState(), 0
        while traversal.outcome is None:
            target = random.choice(table.nodes[traversal.node].branches).target
            target = None if 100 * random.random() < percent else target
            traversal = advance(traversal, target, table, policy)
            steps += 1
            assert steps <= most
        assert (traversal.leaf is None) == (traversal.outcome is Outcome.REJECT)


def test_policy_fields_round_trip():
    for on_reject, on_unresolved in itertools.product(RECOVERIES, ["next", "restart,stop"]):
        policy = Policy.of(on_reject, on_unresolved)
        assert Policy.of(**policy.fields()) == policy
    assert Policy.of(" resqueeze , restart ", "restart") == Policy(
        (RecoveryAction.RESQUEEZE, RecoveryAction.RESTART, RecoveryAction.NEXT),
        (RecoveryAction.RESTART, RecoveryAction.NEXT),
    )
    assert Policy() == Policy.of("next", "next")


@pytest.mark.parametrize(
    ("on_reject", "on_unresolved", "message"),
    [
        ("again", "next", "--on-reject 'again': name resqueeze, restart, next, stop"),
        ("", "next", "name resqueeze"),
        ("next,stop", "next", "next or stop last"),
        ("restart,restart,next", "next", "at most once"),
        ("next", "resqueeze,next", "no squeeze to repeat"),
        ("next", "never", "--on-unresolved 'never'"),
    ],
)
def test_policy_of_invalid_words_is_refused(on_reject, on_unresolved, message):
    with pytest.raises(UsageError, match=message):
        Policy.of(on_reject, on_unresolved)


@pytest.mark.parametrize("seed", range(3))
def test_decide_every_width_and_flag_follows_decision_map(seed):
    for node in random_table(seed, 20).nodes:
        outcomes = decision_map(node, GRIPPER)
        for width, flag in itertools.product(range(0, 86_000, 331), (CONTACT, ARRIVED)):
            result = decide(node, outcomes, width, flag)
            segments = outcomes.felt if flag is CONTACT else outcomes.unfelt
            assert result.branch == segments.at(width)
            assert (result.reason is None) == (result.branch != REJECT)
            if result.reason is not None:
                assert ("closed on nothing" in result.reason) == (flag == ARRIVED)
                assert ("planned:" in result.reason) == (flag == CONTACT)
        for flag in (ObjectState.NONE, ObjectState.OPENING):
            with pytest.raises(GripperStateError, match=f"{flag.sentence} after a closing motion"):
                decide(node, outcomes, 10_000, flag)


def test_release_point_of_thin_or_rejected_grip_is_none():
    node = TABLE.nodes[0]._replace(release=Place(3_000, 4_000))
    thin, just = (
        changed(node, {"branches.0.low_um": 0, "branches.0.expected_um": expected_um})
        for expected_um in (1_999, 2_000)
    )
    for held, branch in ((node, 0), (node, 1), (just, 0)):
        assert held.release_point(branch) == node.release
    assert node.release_point(REJECT) is None
    assert thin.release_point(0) is None
    assert TABLE.nodes[0].release_point(0) is None


def test_advance_target_zero_is_node_and_minus_one_is_leaf():
    """The sign separates nodes from leaves: ~0 is -1. (No valid table leads back to its root.)"""
    assert advance(TraversalState(1), 0, TABLE, Policy()) == TraversalState(0)
    assert advance(TraversalState(1), ~0, TABLE, Policy()) == TraversalState(1, Outcome.LEAF, 0)
