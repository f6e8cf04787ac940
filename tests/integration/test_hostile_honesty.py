"""No word without ground: one rule for readings, nothing untried claimed, heights that meet the part."""

import base64
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_cell import fake_cell
from sample_tables import GRIPPER, every_field_table, random_table, small_table

from planner import job as job_file
from planner.evaluate import REJECTED, evaluate
from runtime.executor import Executor
from runtime.replay import Replay
from runtime.results import Outcome
from runtime.table import REJECT, Branch, Calibration, Leaf, Node, Table, decide, decision_map, dumps

TREES = Path(__file__).parents[2] / "trees"
LINE = Calibration.linear(GRIPPER)


def thin_table() -> Table:
    """One squeeze: nothing held, a grip that the flag may miss, one across 5 mm, and a wide one."""
    widths = (0, 0, 900), (1_500, 2_600, 3_500), (4_000, 4_600, 6_500), (20_000, 21_000, 22_000)
    table = small_table()
    branches = tuple(Branch(*row, 250_000, ~number) for number, row in enumerate(widths))
    leaves = tuple(Leaf(0, 0, 0, table.leaves[0].covariance, 999_000, 6_000, True) for _ in widths)
    return replace(table, nodes=(Node(table.nodes[0].squeeze, branches),), leaves=leaves)


TABLES = [thin_table(), every_field_table(), random_table(3, 1), random_table(8, 1)]


@pytest.mark.parametrize("table", TABLES, ids=["thin", "every field", "random", "another"])
def test_executor_and_journal_replay_read_every_count_and_flag_by_one_rule(table: Table) -> None:
    root = table.nodes[0]
    decided = decision_map(root, LINE)
    header = {"seq": 0, "kind": "header", "table_base64": base64.b64encode(dumps(table)).decode()}
    for count in range(256):
        for flag in (2, 3):
            made = fake_cell([(count, flag)] * table.limits.max_depth)
            result = Executor(table, made.cell, lambda part, step: None).run_part(1)
            branch = decide(decided, count, flag == 2)
            if result.outcome is Outcome.FAULT:  # a contradiction in itself, which the map refuses too
                assert (flag, branch, result.steps) == (3, REJECT, ())
                assert LINE.width_um(count) > 5_000
                continue
            assert result.steps[0].target == (None if branch == REJECT else root.branches[branch].target)
            told = ({"seq": n + 1, "kind": kind, **row} for n, (kind, row) in enumerate(made.journal.kept))
            assert list(Replay().follow([header, *told])) == []


class EveryWidth:
    """Stops the jaws at one width after the other, as far as it is asked."""

    def __init__(self) -> None:
        self.width_mm: list[float] = []

    def squeeze(self, pose_hand):
        self.width_mm.append(0.1 * len(self.width_mm))
        return pose_hand, self.width_mm[-1], "grasped" if self.width_mm[-1] else "untouched"


def test_the_evaluation_reads_by_the_same_rule() -> None:
    table, world = thin_table(), EveryWidth()
    found = evaluate(table, job_file.load(TREES / "rectangle" / "job.toml"), world, 300, seed=1)
    decided = decision_map(table.nodes[0], LINE)
    for count, width_mm, branch, leaf in zip(
        found.counts[:, 0], world.width_mm, found.branch[:, 0], found.leaf, strict=True
    ):
        assert branch == decide(decided, int(count), width_mm > 0)
        assert leaf == (REJECTED if branch == REJECT else branch)
    assert set(found.leaf) == {REJECTED, 0, 1, 2, 3}
    assert np.all(found.leaf[1:10] == REJECTED)  # something between the fingers, where nothing was planned
