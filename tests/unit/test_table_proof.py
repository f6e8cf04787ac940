"""The proof of a table at its edges: the last value that is allowed, the first that is not, and why."""

from dataclasses import replace

import pytest
from runtime.table_model import HELD_UM
from runtime.table_proof import (
    LEVEL,
    MOST_TERMS,
    WILSON_Z,
    prove_order,
    prove_read,
    prove_shape,
    refuted,
    unreadable,
    wilson_upper,
)
from sample_tables import GRIPPER, every_field_table, random_table, small_table, with_leaf, with_node
from scipy.stats import binom

from runtime import table_proof
from runtime.table import PPM, Branch, Calibration, Leaf, Node, Table, TableError, prove

TABLE = small_table()
MILLIMETRES = Calibration(tuple(range(255_000, -1, -1_000)))


def branches(*rows: tuple[int, int, int]) -> tuple[Branch, ...]:
    """Branches of these intervals to leaves 0, 1, ..., in equal shares."""
    share, rest = divmod(PPM, len(rows))
    shares = [share + (number < rest) for number in range(len(rows))]
    return tuple(
        Branch(*row, part, ~number) for number, (row, part) in enumerate(zip(rows, shares, strict=True))
    )


def one_node(*rows: tuple[int, int, int]) -> Table:
    """A table of one node with branches of these intervals."""
    leaves = tuple(TABLE.leaves[0] for _ in rows)
    return replace(TABLE, nodes=(Node(TABLE.nodes[0].squeeze, branches(*rows)),), leaves=leaves)


# -- trials against a confidence ------------------------------------------------------------------


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("trials", [0, 1, 2, 10, 57, 300, 900])
def test_a_leaf_is_refuted_where_the_exact_binomial_test_refutes_it(trials: int, confidence: float) -> None:
    """A second method: the lower tail of the binomial distribution (Clopper and Pearson 1934)."""
    for successes in range(trials + 1):
        tail = binom.cdf(successes, trials, confidence)
        if abs(tail - LEVEL) > 1e-9:
            assert refuted(successes, trials, confidence) == (tail < LEVEL), (successes, trials)


def test_where_the_exact_sum_would_be_long_the_interval_speaks() -> None:
    assert (MOST_TERMS, LEVEL) == (1_000, 0.025)
    assert pytest.approx(1.959964, abs=1e-6) == WILSON_Z  # two-sided 95 %
    for trials, confidence in ((100_000, 0.99), (100_000, 0.985), (20_000, 0.9), (10**9, 0.999)):
        for misses in range(1_001, 3_000, 97):
            successes = trials - misses
            assert refuted(successes, trials, confidence) == (wilson_upper(successes, trials) < confidence)


@pytest.mark.parametrize(("trials", "off"), [(69_640, 0), (69_660, 2)])
def test_both_methods_agree_where_one_follows_the_other(trials: int, off: int) -> None:
    """0.99 to the 69649th power is about the least number whose terms are summed."""
    misses = range(600, 900)
    by_table = next(n for n in misses if refuted(trials - n, trials, 0.99))
    exact = next(n for n in misses if binom.cdf(trials - n, trials, 0.99) < LEVEL)
    assert abs(by_table - exact) <= off


def test_an_underflow_is_not_taken_for_a_refutation() -> None:
    """0.5 to the 2000th power is no float: every single success would seem impossible."""
    assert not refuted(1_000, 2_000, 0.5)
    assert not refuted(2_000, 2_000, 0.5)
    assert refuted(900, 2_000, 0.5)
    assert refuted(700, 1_500, 0.5)  # 2.6 standard deviations off, by few enough misses to be summed
    assert not refuted(720, 1_500, 0.5)
    assert not refuted(700, 700, 0.37)  # exp(-696) is still one
    assert not refuted(260, 701, 0.37)


def test_certainty_is_refuted_by_any_miss_and_never_summed_for_long() -> None:
    """At a confidence of 1 nothing else bounds the number of terms."""
    assert not refuted(10**6, 10**6, 1.0)
    assert refuted(10**6 - 1, 10**6, 1.0)
    assert refuted(0, 10**10, 1.0)


def test_no_trials_speak_against_nothing() -> None:
    assert wilson_upper(0, 0) == 1.0
    assert not refuted(0, 0, 0.99)


# -- leaves ---------------------------------------------------------------------------------------


def leaf_at(**changes: object) -> Table:
    return with_leaf(TABLE, 0, TABLE.leaves[0]._replace(**changes))


@pytest.mark.parametrize(("name", "edge"), [("x_um", 60_000), ("y_um", 60_000)])
def test_a_leaf_may_lie_on_the_edge_of_the_work_area_and_not_beyond(name: str, edge: int) -> None:
    for sign in (1, -1):
        prove(leaf_at(**{name: sign * edge}))
        with pytest.raises(TableError, match=f"leaf 0: {name} is {sign * (edge + 1)}, allowed is -60000"):
            prove(leaf_at(**{name: sign * (edge + 1)}))


@pytest.mark.parametrize("at", [0, 1])
def test_every_pose_of_an_ambiguous_leaf_lies_in_the_work_area(at: int) -> None:
    poses = [(0, 0, 0), (0, 0, 1_000)]
    poses[at] = (0, 60_001, 0)
    goal = replace(TABLE.goal, kind="modes", modes=3)
    with pytest.raises(TableError, match="leaf 0: y_um is 60001"):
        prove(replace(leaf_at(alternatives=tuple(poses)), goal=goal))


def test_a_leaf_names_no_more_poses_than_the_goal_leaves_open() -> None:
    three = leaf_at(alternatives=((0, 0, 1), (0, 0, 2)))
    prove(replace(three, goal=replace(TABLE.goal, kind="modes", modes=3)))
    for goal, allowed in (
        (replace(TABLE.goal, kind="modes", modes=2), 2),
        (replace(TABLE.goal, modes=3), 1),  # a number of modes is for the goal "modes" alone
    ):
        told = f"leaf 0: 3 poses where the goal leaves {allowed} open; mark it unresolved"
        with pytest.raises(TableError, match=told):
            prove(replace(three, goal=goal))


def test_what_is_asked_of_a_leaf_is_asked_of_resolved_ones_only() -> None:
    far = leaf_at(x_um=60_001, success_ppm=0, trials=10_000, alternatives=((0, 0, 1),), resolved=False)
    prove(far)


def test_a_leaf_at_the_confidence_needs_no_trials() -> None:
    confidence = TABLE.goal.confidence_ppm
    prove(leaf_at(success_ppm=confidence, trials=10**6))
    told = r"leaf 0: 0.9890 of 100000 trials met the goal, which refutes the confidence of 0.9900; mark"
    with pytest.raises(TableError, match=told):
        prove(leaf_at(success_ppm=989_000, trials=100_000))
    # Shares are kept in millionths: that many hits of a million trials is itself no contradiction.
    prove(leaf_at(success_ppm=confidence - 1, trials=10**6))


def test_hits_are_the_nearest_whole_number() -> None:
    """36 of 38 refute 99 %... of which 94.7368 % is a rounded share; 37 of 38 do not."""
    assert refuted(35, 38, 0.99)
    assert not refuted(37, 38, 0.99)
    with pytest.raises(TableError, match="refutes"):
        prove(leaf_at(success_ppm=round(35 / 38 * PPM), trials=38))
    prove(leaf_at(success_ppm=round(37 / 38 * PPM), trials=38))
    for trials in range(1, 60):
        for hits in range(trials + 1):
            share = round(hits / trials * PPM)
            if share < TABLE.goal.confidence_ppm and not refuted(hits, trials, 0.99):
                prove(leaf_at(success_ppm=share, trials=trials))


# -- shape ----------------------------------------------------------------------------------------


def chain(length: int) -> Table:
    """So many nodes, one below the other."""
    leaves: list[Leaf] = []
    nodes = []
    for number in range(length):
        first, second = TABLE.nodes[0].branches
        below = number + 1 if number + 1 < length else ~len(leaves)
        leaves += [TABLE.leaves[0]] * (1 if below >= 0 else 2)
        first = first._replace(target=~(len(leaves) - 1))
        nodes.append(Node(TABLE.nodes[0].squeeze, (first, second._replace(target=below))))
    return replace(TABLE, nodes=tuple(nodes), leaves=tuple(leaves))


@pytest.mark.parametrize("depth", [1, 2, 5])
def test_a_table_is_as_deep_as_allowed_and_no_deeper(depth: int) -> None:
    table = chain(depth)
    prove(replace(table, limits=replace(table.limits, max_depth=depth)))
    if depth > 1:
        told = f"node {depth - 1} is deeper than limits.max_depth = {depth - 1}"
        with pytest.raises(TableError, match=told):
            prove_shape(replace(table, limits=replace(table.limits, max_depth=depth - 1)))


def test_of_several_nodes_too_deep_the_first_is_named() -> None:
    root, second = TABLE.nodes
    both = root._replace(branches=(root.branches[0]._replace(target=2), root.branches[1]))
    third = second._replace(branches=tuple(b._replace(target=b.target - 2) for b in second.branches))
    leaves = (TABLE.leaves[0],) * 5
    wide = replace(TABLE, nodes=(both, second, third), leaves=leaves)
    with pytest.raises(TableError, match="node 2 is deeper than"):
        prove_shape(replace(wide, limits=replace(TABLE.limits, max_depth=1)))


def test_the_first_place_that_is_reached_twice_or_never_is_named() -> None:
    root, second = TABLE.nodes
    loop = second._replace(branches=(second.branches[0]._replace(target=0), second.branches[1]))
    with pytest.raises(TableError, match=r"^node 1, branch 0: node 0 is reached a second time$"):
        prove_shape(with_node(TABLE, 1, loop))
    twice = second._replace(branches=(second.branches[0], second.branches[1]._replace(target=~0)))
    with pytest.raises(TableError, match=r"^node 1, branch 1: leaf 0 is reached a second time$"):
        prove_shape(with_node(TABLE, 1, twice))
    alone = root._replace(branches=(root.branches[0], root.branches[1]._replace(target=~1)))
    with pytest.raises(TableError, match=r"^node 1 is never reached$"):
        prove_shape(replace(TABLE, nodes=(alone, second)))
    with pytest.raises(TableError, match=r"^leaf 3 is never reached$"):
        prove_shape(replace(TABLE, leaves=(*TABLE.leaves, TABLE.leaves[0])))


# -- branches -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rows",
    [
        ((20_000, 20_000, 20_000),),  # a single width
        ((0, 0, 500),),  # nothing held
        ((20_000, 21_000, 22_000), (20_000, 21_001, 22_000)),  # same low, next expected
        ((20_000, 21_000, 22_000), (21_500, 30_000, 30_000)),
    ],
)
def test_branches_may_touch_and_overlap(rows) -> None:
    prove_order((Node(TABLE.nodes[0].squeeze, branches(*rows)),))


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (((20_001, 20_000, 22_000),), "node 0, branch 0: expected_um is 20000, allowed is 20001..22000"),
        (((20_000, 22_001, 22_000),), "node 0, branch 0: expected_um is 22001, allowed is 20000..22000"),
        (((20_000, 21_000, 19_999),), "node 0, branch 0: low_um is 20000, allowed is 0..19999"),
        (((-1, 21_000, 22_000),), "node 0, branch 0: low_um is -1, allowed is 0..22000"),
        (
            ((20_000, 21_000, 22_000), (19_999, 22_000, 23_000)),
            "node 0, branch 1: low_um is 19999, allowed is 20000..23000",
        ),
        (
            ((20_000, 21_000, 22_000), (20_000, 21_000, 23_000)),
            "node 0, branch 1: expected_um is 21000, allowed is 21001..23000",
        ),
        (
            ((20_000, 22_000, 25_000), (20_000, 21_000, 25_000)),
            "node 0, branch 1: expected_um is 21000, allowed is 22001..25000",
        ),
    ],
)
def test_branches_out_of_order_are_told_with_what_is_allowed(rows, told: str) -> None:
    with pytest.raises(TableError, match=rf"^{told}$"):
        prove_order((Node(TABLE.nodes[0].squeeze, branches(*rows)),))


@pytest.mark.parametrize(("off", "proved"), [(-3, False), (-2, True), (0, True), (2, True), (3, False)])
def test_shares_may_be_off_by_a_millionth_a_branch(off: int, *, proved: bool) -> None:
    root = TABLE.nodes[0]
    first = root.branches[0]._replace(probability_ppm=600_000 + off)
    table = with_node(TABLE, 0, root._replace(branches=(first, root.branches[1])))
    if proved:
        prove(table)
        return
    with pytest.raises(
        TableError, match=f"node 0: the branches' probabilities sum to {PPM + off} ppm, not 1000000"
    ):
        prove(table)


def test_a_branch_that_no_count_means_is_told_in_millimetres() -> None:
    prove(one_node((20_000, 20_100, 20_300), (29_000, 30_000, 31_000)))
    told = r"node 0, branch 0: no encoder count means 20.10..20.20 mm; widen it"
    with pytest.raises(TableError, match=told):
        prove(one_node((20_100, 20_150, 20_200), (29_000, 30_000, 31_000)))


def test_a_grip_is_never_read_where_the_jaws_are_closed() -> None:
    """Fully closed jaws hold nothing: an interval of that width alone is a branch for nothing, or none."""
    squeeze = TABLE.nodes[0].squeeze
    for expected_um, missing in ((HELD_UM - 1, []), (HELD_UM, [0]), (HELD_UM + 1, [0])):
        row = (0, expected_um, expected_um)
        wide = Calibration((*[9_000] * 255, 0))  # counts that mean 9 mm, and one that means closed
        assert unreadable(Node(squeeze, branches(row)), wide) == missing
    one_micrometre = Calibration((*[9_000] * 254, 1, 0))
    assert unreadable(Node(squeeze, branches((0, HELD_UM, HELD_UM))), one_micrometre) == []


def test_every_unreadable_branch_is_listed_also_where_intervals_are_nested() -> None:
    squeeze = TABLE.nodes[0].squeeze
    apart = Node(
        squeeze, branches((20_100, 20_200, 20_300), (29_000, 30_000, 31_000), (40_100, 40_200, 40_300))
    )
    assert unreadable(apart, MILLIMETRES) == [0, 2]
    nested = Node(
        squeeze, branches((20_000, 21_000, 50_000), (20_100, 30_100, 30_200), (40_000, 45_000, 45_000))
    )
    assert table_proof.won(nested.branches) is None
    assert unreadable(nested, MILLIMETRES) == [
        number for number in range(3) if number not in table_proof.decisions(nested, MILLIMETRES)
    ]


# -- types, which only a table made in memory can have wrong ---------------------------------------


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (replace(TABLE, tool=5), "tool is 5, not text"),
        (replace(TABLE, job_digest=b"short"), "job_digest is not 32 bytes"),
        (replace(TABLE, job_digest="x" * 32), "job_digest is not 32 bytes"),
        (replace(TABLE, job=b"{}"), "job is b'{}', not text"),
        (replace(TABLE, gripper=replace(GRIPPER, model=None)), "gripper.model is None, not text"),
        (replace(TABLE, goal=replace(TABLE.goal, kind="there")), "goal.kind is 'there', allowed are pose"),
        (replace(TABLE, goal=replace(TABLE.goal, tolerance=(1, 2))), "goal.tolerance is not x, y, theta"),
        (replace(TABLE, goal=replace(TABLE.goal, tolerance=[0, 0, 0])), "goal.tolerance is not x, y, theta"),
        (
            replace(TABLE, limits=replace(TABLE.limits, work_area_um=(0, 0, 1))),
            "limits.work_area_um is not x min, y min, x max, y max",
        ),
        (
            replace(TABLE, limits=replace(TABLE.limits, work_area_um=(0, 0, 0, 1))),
            "limits.work_area_um is empty: ",
        ),
        (leaf_at(resolved=1), "leaf 0: resolved is 1, not a truth value"),
        (with_node(TABLE, 0, TABLE.nodes[0]._replace(squeeze=(1, 2))), "node 0: squeeze is .1, 2., not"),
        (with_node(TABLE, 0, TABLE.nodes[0]._replace(branches=())), "node 0: number of branches is 0"),
    ],
)
def test_a_field_of_another_kind_is_told_by_name(table: Table, told: str) -> None:
    with pytest.raises(TableError, match=told):
        prove(table)


def test_tables_that_are_in_order_pass_both_proofs() -> None:
    for table in (TABLE, every_field_table(), *(random_table(seed, 30) for seed in range(5))):
        prove(table)
        prove_read(table)
