"""Draws histories of parts from the predictions of a table, for a healthy or a changed cell."""

from collections import Counter
from dataclasses import replace
from math import sqrt

import numpy as np
from programs import TABLE as TREE

from runtime.spc.expectation import Expectation
from runtime.spc.history import History, NodeReading, Part
from runtime.spc.monitor import Alarm, Monitor, branch_shares, sigmas
from runtime.table import PPM, Table, decision_map, load

SHIFT_UM = 2000.0  # shift of widths; branches allow for the 1.1 mm that the job's doubts may cause
LESS = {0: [0.60, 0.34, 0.01, 0.05]}  # shares of the first node's branches if fewer parts jam


def table() -> Table:
    """The table of the rectangle."""
    return load(TREE).table


def drawn(
    tree: Table,
    count: int,
    rng: np.random.Generator,
    *,
    width_shift_um: float = 0.0,
    shares: dict[int, list[float]] | None = None,
    residual_shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fail_rate: float | None = None,
    first: int = 0,
) -> list[Part]:
    """Draws parts that behave as the table predicts, apart from the stated changes.

    Args:
        tree: the table.
        count: number of parts.
        rng: source of randomness.
        width_shift_um: added to each reading.
        shares: shares of a node's branches that replace the predicted shares, by node.
        residual_shift: added to each residual [mm, mm, rad].
        fail_rate: share of located parts whose audit fails; None: as predicted.
        first: number of the first part.
    """
    maps = [decision_map(node, tree.gripper).either for node in tree.nodes]
    rows = dict(enumerate(branch_shares(tree))) | (shares or {})
    odds = map(np.cumsum, rows.values())
    predicted = [row / row[-1] for row in odds]
    scatter = [0.6 * np.array(sigmas(tree, leaf)) for leaf in tree.leaves]
    rate = 1.0 - tree.predicted.success_ppm / PPM if fail_rate is None else fail_rate

    def part(number: int) -> Part:
        squeezes: list[NodeReading] = []
        target = 0
        while target >= 0:
            node = tree.nodes[target]
            branch = node.branches[int(predicted[target].searchsorted(rng.random(), "right"))]
            spread = 0.25 * (branch.high_um - branch.low_um) / sqrt(12.0)
            healthy = min(
                max(rng.normal(branch.expected_um, spread), branch.low_um), branch.high_um
            )
            width = healthy + width_shift_um
            profile = tree.gripper.profile
            read_um = min(max(profile.reading_um(profile.step(width)), 0), profile.stroke_um)
            taken = maps[target].at(read_um)
            if taken < 0:
                return Part(number, (*squeezes, NodeReading(target, None, read_um)), "reject")
            squeezes.append(NodeReading(target, taken, read_um))
            target = node.branches[taken].target
        if not tree.leaves[~target].resolved:
            return Part(number, tuple(squeezes), "unresolved", ~target)
        residual = rng.normal(0.0, scatter[~target]) + residual_shift
        verdict = "fail" if rng.random() < rate else "pass"
        return Part(number, tuple(squeezes), "leaf", ~target, verdict, tuple(map(float, residual)))

    return [part(number) for number in range(first, first + count)]


def history(tree: Table, *stretches: list[Part]) -> History:
    """Joins several stretches of parts into one history, and numbers the parts consecutively."""
    parts = [part for stretch in stretches for part in stretch]
    return History(tree, tuple(replace(part, number=number) for number, part in enumerate(parts)))


def watch(seen: History, expected: Expectation | None = None) -> list[Alarm]:
    """Returns all alarms that the control charts raise over a history."""
    return list(Monitor(seen.table, expected).watch(seen))


def expectation_document(tree: Table, digest: str, count: int = 4000) -> dict[str, object]:
    """Returns a document as `plan-expect` writes it: the readings of `count` parts in each of two worlds.

    In the world "as planned" parts behave as the table predicts; in the world "less" fewer parts jam.
    """
    worlds = []
    for seed, (name, shares) in enumerate((("as planned", None), ("less", LESS))):
        rows = [Counter() for _ in tree.nodes]
        for part in drawn(tree, count, np.random.default_rng([seed, 0x4558]), shares=shares):
            for squeeze in part.squeezes:
                rows[squeeze.node][str(tree.gripper.bin_of(squeeze.width_um))] += 1
        worlds.append({"name": name, "readings": [dict(row) for row in rows]})
    of_table = {"bins": tree.gripper.bins, "table_sha256": digest}
    return {"kind": "expected readings", "version": 2, **of_table, "worlds": worlds}
