"""Decision tables for tests: one small enough to draw, and random ones of any size."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from random import Random
from typing import Any

from runtime.table import (
    PROFILES,
    Area,
    Branch,
    Covariance,
    GoalSpec,
    GripperSpec,
    Hypothesis,
    Leaf,
    LeafPose,
    Limits,
    Node,
    Place,
    Prediction,
    Push,
    Squeeze,
    Table,
    Tolerance,
    profile_of,
)

GRIPPER = replace(GripperSpec.of(PROFILES["robotiq-2f-85"], 27_500, 9_500), model="Robotiq 2F-85")
GOAL = GoalSpec(distance_um=3_000, confidence_ppm=990_000, rho_um=10_571, symmetry=2)
LIMITS = Limits(4, 60_000, 60_000, Area(-60_000, -60_000, 60_000, 60_000), 60_000, 10_000, 400_000)
NO_JOB = hashlib.sha256(b"no job").digest()
JAWS = (85_000, 60_000, 40_000)
TIGHT = Covariance(2, 0, 2, 0, 0, 1)


def small_table() -> Table:
    """Two squeezes of a rectangle: across, and if the width is ambiguous, along.

    ```
    node 0 (0 deg)  -> 20..22 mm: leaf 0
                    -> 29..31 mm: node 1 (90 deg) -> 20..22 mm: leaf 1
                                                  -> 35..37 mm: leaf 2, not resolved
    ```
    """
    across = Branch(20_000, 21_000, 22_000, 600_000, ~0), Branch(29_000, 30_000, 31_000, 400_000, 1)
    along = Branch(20_000, 21_000, 22_000, 750_000, ~1), Branch(35_000, 36_000, 37_000, 250_000, ~2)
    root = Node(Squeeze(0, 0, 0, *JAWS, 12_000), across)
    second = Node(Squeeze(1_000, -2_000, 1_570_796, *JAWS, 9_000), along)
    wide = Covariance(90, -4, 60, 3, 0, 40)
    leaves = (
        Leaf(0, 500, 0, TIGHT, 999_000, 6_000, True, (), 320, 940),
        Leaf(-1_200, -2_000, 1_571_000, TIGHT, 995_000, 3_000, True, (), 410, 1_250),
        Leaf(0, 0, 643_000, wide, 610_000, 1_000, False, (), 2_200, 9_800),
    )
    predicted = Prediction(958_000, 10_000, 1_400_000, 0, 340, 1_020)
    nodes = (root, second)
    return Table("squeezetree test", NO_JOB, GRIPPER, GOAL, LIMITS, nodes, leaves, predicted, None)


def two_squeeze_table() -> Table:
    """The small table with other probabilities: nearly all parts take both squeezes and are located."""
    table = small_table()
    shares = ((1, 999_999), (999_999, 1))
    for index, (node, likely) in enumerate(zip(table.nodes, shares, strict=True)):
        pairs = zip(node.branches, likely, strict=True)
        branches = tuple(branch._replace(probability_ppm=ppm) for branch, ppm in pairs)
        table = changed(table, {f"nodes.{index}.branches": branches})
    return table


def table_for(model: str) -> Table:
    """Returns the small table for a gripper model.

    The gripper opens fully. It presses with 40 N, or with its least force if this is above 40 N.
    """
    table, profile = small_table(), profile_of(model)
    force_mn = round(1000 * max(40.0, profile.force_n[0]))
    squeezes = (node.squeeze for node in table.nodes)
    changed = (each._replace(opening_um=profile.stroke_um, force_mn=force_mn) for each in squeezes)
    nodes = (node._replace(squeeze=each) for node, each in zip(table.nodes, changed, strict=True))
    gripper = table.gripper
    gripper = GripperSpec.of(profile, gripper.finger_length_um, gripper.finger_width_um)
    limits = replace(table.limits, max_force_mn=max(table.limits.max_force_mn, force_mn))
    return replace(table, gripper=gripper, limits=limits, nodes=tuple(nodes))


HAND = Hypothesis("left hand", 400_000, 10_571, 2)
OTHER = Hypothesis("right hand", 600_000, 9_000, 1)


def several_table() -> Table:
    """Returns the small table for two hypotheses: leaf 0 states the first, leaf 1 the second.

    Leaf 2 is not resolved: it states both as possible.
    """
    one, two, unresolved = small_table().leaves
    unresolved = unresolved._replace(alternatives=(LeafPose(400, 0, -643_000),), hypothesis=1)
    leaves = (one, two._replace(hypothesis=1), unresolved)
    return replace(small_table(), leaves=leaves, hypotheses=(HAND, OTHER))


PUSHES = (
    Push(-50_000, 1_000, 0, 0, 30_000, 30_000),
    Push(3_000, 50_000, -1_570_796, 24_000, 25_000, 30_000),
)


def pushing_table(table: Table | None = None) -> Table:
    """A table, by default the small one, with a push before the first squeeze and two before the second."""
    table = table or small_table()
    root, second, *others = table.nodes
    nodes = (root._replace(pushes=PUSHES[:1]), second._replace(pushes=PUSHES), *others)
    return replace(table, nodes=nodes)


def every_field_table() -> Table:
    """Returns the small table with optional fields set: another goal, a release, alternatives and so on."""
    table = with_job(small_table(), '{"seed":1}')
    root, second = table.nodes
    squeeze = second.squeeze._replace(opening_um=60_000, force_mn=25_000)
    others = (LeafPose(400, 0, -643_000), LeafPose(0, -300, 2_500_000))
    ambiguous = table.leaves[2]._replace(alternatives=others)
    both = table.leaves[1]._replace(alternatives=(LeafPose(-1_200, -2_000, -1_571_000),))
    goal = replace(GOAL, kind="modes", modes=2, tolerance=Tolerance(2_500, 2_500, 87_000))
    root = root._replace(release=Place(2_000, -500))
    nodes = (root, second._replace(squeeze=squeeze, contact_um=37_500))
    return replace(table, nodes=nodes, leaves=(table.leaves[0], both, ambiguous), goal=goal)


def with_job(table: Table, job: str) -> Table:
    """The same table with a job embedded."""
    return replace(table, job=job, job_digest=hashlib.sha256(job.encode()).digest())


def changed(record: Any, values: Mapping[str, object]) -> Any:
    """A copy of a record with other values at dotted paths of fields and indices (`nodes.1.squeeze.x_um`)."""
    for path, value in values.items():
        record = _changed(record, path.split("."), value)
    return record


def _changed(record: Any, path: list[str], value: object) -> Any:
    if not path:
        return value
    name, *rest = path
    if name.isdecimal():
        items = list(record)
        items[int(name)] = _changed(items[int(name)], rest, value)
        return tuple(items)
    field = {name: _changed(getattr(record, name), rest, value)}
    return record._replace(**field) if isinstance(record, tuple) else replace(record, **field)


def random_table(seed: int, nodes: int) -> Table:
    """A random table of `nodes` nodes, numbered breadth first, each with one to four branches.

    Branches may overlap.
    """
    random = Random(seed)
    records: list[Node] = []
    leaves: list[Leaf] = []
    result = 1
    for index in range(nodes):
        targets = []
        for number in range(random.randint(1, 4)):
            if result < nodes and (random.random() < 0.5 or (result == index + 1 and number == 0)):
                targets.append(result)
                result += 1
            else:
                targets.append(~len(leaves))
                leaves.append(_random_leaf(random))
        records.append(Node(_random_squeeze(random), _random_branches(random, targets)))
    limits = replace(LIMITS, max_depth=64)
    trials = sum(leaf.trials for leaf in leaves)
    predicted = Prediction(990_000, trials, 2_860_000, 300)
    drawn = {"nodes": tuple(records), "leaves": tuple(leaves), "predicted": predicted}
    return replace(small_table(), limits=limits, **drawn)


def _random_squeeze(random: Random) -> Squeeze:
    angle = random.choice([0, 785_398, 1_570_796, 2_356_194])
    x, y = (random.choice([0, 10_000, -10_000]) for _ in range(2))
    return Squeeze(x, y, angle, *JAWS, random.randint(0, 20_000))


def _random_branches(random: Random, targets: list[int]) -> tuple[Branch, ...]:
    cuts = sorted(random.randint(0, 1_000_000) for _ in targets[1:])
    shares = [high - low for low, high in zip([0, *cuts], [*cuts, 1_000_000], strict=True)]
    branches, reached = [], random.randint(10_000, 20_000)
    for target, share in zip(targets, shares, strict=True):
        low = reached + random.randint(-300, 4_000)
        expected = max(low, reached) + random.randint(400, 1_200)
        reached = expected + random.randint(400, 1_200)
        branches.append(Branch(low, expected, reached, share, target))
    return tuple(branches)


def _random_leaf(random: Random) -> Leaf:
    x, y = (random.randint(-12_000, 12_000) for _ in range(2))
    most = ((0, 120), (-40, 40), (0, 120), (-30, 30), (-30, 30), (0, 60))
    covariance = Covariance(*(random.randint(low, high) for low, high in most))
    theta = random.randint(-3_141_592, 3_141_592)
    trials = random.randint(0, 300)
    success_ppm = round(1e6 * (trials - (trials > 200)) / trials) if trials else 1_000_000
    return Leaf(x, y, theta, covariance, success_ppm, trials, True)
