"""The requests of a part: their order, their content, and the outcome that ends them."""

from dataclasses import replace

import pytest
from sample_tables import random_table, small_table

from drivers.ports import ObjectState
from runtime.table import Calibration, Place, Table, decision_map
from runtime.traversal.decision import Policy, TraversalState
from runtime.traversal.program import (
    Approach,
    Done,
    Program,
    Reading,
    Release,
    Requests,
    Tighten,
    released,
)
from runtime.traversal.results import Outcome

TABLE = small_table()
REJECTED = Reading(50_000, ObjectState.CLOSING)


def program(table: Table = TABLE, *policy: str) -> Program:
    chosen = Policy.of(*policy) if policy else Policy()
    return Program(table, Calibration(table.gripper.profile), chosen)


def held(width_um: int) -> Reading:
    return Reading(width_um, ObjectState.CLOSING)


def kinds(requests: Requests, *readings: Reading) -> list[type]:
    """The kinds of a part's requests when its squeezes give these readings."""
    given, result, request = iter(readings), [], next(requests)
    reading = None
    while not isinstance(request, Done):
        result.append(type(request))
        if isinstance(request, Approach):
            reading = next(given)
        asked = isinstance(request, Approach | Tighten)
        request = requests.send(reading if asked else None)
    return [*result, Done]


def test_part_two_squeezes_asks_for_each_in_order() -> None:
    once = [Approach, Release]
    assert kinds(program().part(1), held(30_000), held(21_000)) == [*once, *once, Done]


def test_part_reject_or_drag_tightens_before_decision() -> None:
    root = TABLE.nodes[0]._replace(release=Place(3_000, 4_000))
    dragged = replace(TABLE, nodes=(root, *TABLE.nodes[1:]))
    tightened = [Approach, Tighten, Release, Done]
    assert kinds(program().part(1), REJECTED) == tightened
    assert kinds(program(dragged).part(1), held(21_000)) == tightened


def test_part_reading_after_tightening_decides() -> None:
    requests = program().part(1)
    next(requests)
    assert isinstance(requests.send(REJECTED), Tighten)
    release = requests.send(held(21_000))
    assert isinstance(release, Release)
    assert (release.step.target, release.step.reading_um) == (~0, 21_000)


def test_part_resqueeze_is_approached_again_without_pushes() -> None:
    requests = program(TABLE, "resqueeze,next", "next").part(1)
    first = next(requests)
    released(requests, first, REJECTED)
    second = next(requests)
    assert isinstance(first, Approach)
    assert isinstance(second, Approach)
    assert (first.again, second.again) == (False, True)
    assert (second.index, second.number) == (0, 2)


def test_part_resumed_ends_as_uninterrupted_part() -> None:
    whole = program().part(1)
    release = released(whole, next(whole), held(30_000))
    resumed = program().part(1, release.after, release.steps)
    ends = [released(each, next(each), held(21_000)) for each in (whole, resumed)]
    assert ends[0] == ends[1]
    done = [next(each) for each in (whole, resumed)]
    assert done[0] == done[1]
    assert isinstance(done[0], Done)
    assert (done[0].result.outcome, done[0].result.leaf) == (Outcome.LEAF, 1)


@pytest.mark.parametrize("seed", range(3))
def test_part_any_branch_leads_to_target_of_table(seed: int) -> None:
    table = random_table(seed, 20)
    for index, node in enumerate(table.nodes):
        for low_um, _, number in decision_map(node, table.gripper).felt.intervals():
            requests = program(table).part(1, TraversalState(index))
            release = released(requests, next(requests), held(low_um))
            assert release.step.target == node.branches[number].target
            assert (release.point is None) == (node.release_point(number) is None)
