"""Tables and reports claim only what was tried: readings, untried leaves, heights and goals."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from counting import width_um
from fake_cell import Deaf, fake_cell
from programs import JOB, called, document
from rectangle import quick_job
from sample_tables import changed, every_field_table, random_table, small_table

from planner.cli import compile as compile_
from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import REJECTED
from planner.evaluation.trials import encoder_of_table
from planner.job import model as job_file
from planner.report.tree import leaf_label, leaf_lines
from planner.world import ContactWorlds
from runtime.execution.executor import Executor
from runtime.journal.replay import Replay
from runtime.monitoring.console import Lines, as_object
from runtime.shell.errors import InputError
from runtime.table import (
    REJECT,
    Branch,
    Leaf,
    Node,
    Table,
    decide,
    decision_map,
    dumps,
    load,
)
from runtime.traversal.results import Outcome, PartResult, Step


def thin_table() -> Table:
    """A table of one squeeze with four branches: empty jaws, and parts of about 2.6, 4.6 and 21 mm.

    The object flag may miss the thinnest part.
    """
    widths = (0, 0, 900), (1_500, 2_600, 3_500), (4_000, 4_600, 6_500), (20_000, 21_000, 22_000)
    table = small_table()
    branches = tuple(Branch(*row, 250_000, ~number) for number, row in enumerate(widths))
    leaves = tuple(Leaf(0, 0, 0, table.leaves[0].covariance, 999_000, 6_000, True) for _ in widths)
    return replace(table, nodes=(Node(table.nodes[0].squeeze, branches),), leaves=leaves)


TABLES = [thin_table(), every_field_table(), random_table(3, 1), random_table(8, 1)]


@pytest.mark.parametrize("table", TABLES, ids=["thin", "every field", "random", "another"])
def test_executor_and_replay_each_reading_and_flag_follow_decision_map(table: Table) -> None:
    root = table.nodes[0]
    decided = decision_map(root, table.gripper)
    header = {"seq": 0, "kind": "header", "table_base64": base64.b64encode(dumps(table)).decode()}
    for count in range(0, 256, 3):
        for flag in (2, 3):
            rig = fake_cell([(count, flag)] * table.limits.max_depth)
            result = Executor(table, rig.cell, Deaf()).run_part(1)
            branch = decide(decided, width_um(count), flag == 2)
            # Width and flag contradict each other, which the map rejects too.
            if result.outcome is Outcome.FAULT:
                assert (flag, branch, result.steps) == (3, REJECT, ())
                assert width_um(count) > 5_000
                continue
            target = None if branch == REJECT else root.branches[branch].target
            assert result.steps[0].target == target
            kept = enumerate(rig.journal.kept, 1)
            record = ({"seq": seq, "kind": kind, **row} for seq, (kind, row) in kept)
            assert list(Replay().follow([header, *record])) == []


class EveryWidth:
    """A world whose squeezes end at 0, 0.1, 0.2, ... mm, one after the other."""

    def __init__(self) -> None:
        self.width_mm: list[float] = []

    def squeeze(self, pose_hand):
        self.width_mm.append(0.1 * len(self.width_mm))
        return pose_hand, self.width_mm[-1], "grasped" if self.width_mm[-1] else "untouched"


def test_evaluate_each_width_follows_decision_map() -> None:
    table, world = thin_table(), EveryWidth()
    result = evaluate(table, job_file.load(JOB), world, 300, seed=1)
    decided = decision_map(table.nodes[0], table.gripper)
    widths = encoder_of_table(table).width_um(result.steps[:, 0]).tolist()
    seen = zip(widths, world.width_mm, result.branch[:, 0], result.leaf, strict=True)
    for read, width_mm, branch, leaf in seen:
        assert branch == decide(decided, read, width_mm > 0)
        assert leaf == (REJECTED if branch == REJECT else branch)
    assert set(result.leaf) == {REJECTED, 0, 1, 2, 3}
    # The jaws hold something thinner than any planned width.
    assert np.all(result.leaf[1:10] == REJECTED)


def small_job(path: Path, *change: str) -> Path:
    """Writes a job that is planned in seconds, with some changes."""
    return quick_job(path, "particles = 200\nmax_depth = 3", *change)


def test_plan_compile_keeps_tried_leaves_and_states_repeatable_success(tmp_path) -> None:
    job, output = small_job(tmp_path / "job.toml"), tmp_path / "t.msgpack"
    words = (job, "-o", output, "--trials", "40", "--no-advice", "--json")
    figures, table = document(compile_.main, *words), load(output).table
    assert figures["untried_branches"] > 0
    assert all(leaf.trials > 0 for leaf in table.leaves)
    # 40 trials decide which leaves stay, and others measure the success, which fresh trials must confirm.
    assert table.job is not None
    planned = job_file.from_canonical(table.job)
    fresh = evaluate(table, planned, ContactWorlds.of_job(planned, 1), 4000, seed=5).summary()
    low, high = figures["success_ci95"]
    assert low <= fresh["success_rate"] <= high


def test_console_and_report_leaf_without_trials_show_no_success(capsys) -> None:
    table = small_table()
    untried = changed(table, {"leaves.0.success_ppm": 1_000_000, "leaves.0.trials": 0})
    step = Step(1, 0, table.nodes[0].squeeze, 174, 20_969, ~0, None)
    result = PartResult.of(1, Outcome.LEAF, [step], None)
    Lines(untried).part(result, None)
    printed = capsys.readouterr().out
    assert "success never tried" in printed
    assert as_object(untried, result, None, Path("j"))["success_probability"] is None
    shown = [printed, leaf_label(0, untried.leaves[0]), *leaf_lines(untried.leaves[0])]
    assert not any("100" in line or "1.0000" in line for line in shown)


@pytest.mark.parametrize(
    ("height", "squeeze", "message"),
    [
        ("6.0", "squeeze_height_mm = 8.0", "squeeze_height_mm: is 8, which closes the tips above"),
        ("6.0", "squeeze_height_mm = 5.1", "lower it to 5 or less"),
        ("60.0", "", "retreat_height_mm: is 60, not above height_mm = 60"),
        ("1.0", "", "height_mm"),
    ],
)
def test_plan_compile_tips_missing_the_part_are_refused_in_one_line(
    tmp_path, height, squeeze, message
) -> None:
    job = small_job(tmp_path / "job.toml", "height_mm = 16.0", f"height_mm = {height}")
    job.write_text(f"{job.read_text()}[cell]\n{squeeze}\n", encoding="utf-8")
    refused = called(compile_.main, job, "-o", tmp_path / "t.msgpack")
    assert (refused.code, refused.one_line) == (InputError.exit_code, True)
    assert message in refused.err
    assert not (tmp_path / "t.msgpack").exists()


def test_plan_compile_job_without_height_states_assumed_part_height(tmp_path) -> None:
    (text,) = re.findall(r"^height_mm = .*$", JOB.read_text(), re.MULTILINE)
    job = small_job(tmp_path / "job.toml", text, "")
    words = (job, "-o", tmp_path / "t", "--trials", "20", "--no-advice")
    code, out, _ = called(compile_.main, *words)
    assert code == 0
    (line,) = (line for line in out.splitlines() if "height_mm" in line)
    assert "tips at squeeze_height_mm = 8 meet a part of 9 mm or more" in line


def test_plan_compile_sensorless_baseline_is_judged_by_goal_of_job(tmp_path) -> None:
    record = {}
    for kind in ("pose", "orientation"):
        goal = f'[goal]\nkind = "{kind}"\ntolerance_deg = 5.0'
        job = small_job(tmp_path / f"{kind}.toml", "[goal]", goal)
        words = (job, "--baseline", "sensorless", "--trials", "400", "--json")
        record[kind] = document(compile_.main, *words)["real"]
    # The goal of an angle counts each oriented part; for a pose, the place along the jaws remains unknown.
    assert record["orientation"]["located"] >= record["orientation"]["oriented"] - 0.02
    assert record["orientation"]["located"] > record["pose"]["located"] + 0.2
