"""Functions of benchmarks whose mistakes would not show in the results."""

import sys

import numpy as np
import pytest
from drifting import squeezed
from programs import ROOT, TABLE

from planner.evaluation.expectation import readings
from planner.evaluation.trials import Program
from planner.job import model as job_file
from runtime.table import load


@pytest.fixture(autouse=True)
def _benches(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tests" / "bench")


def test_random_widths_with_planned_first_width_end_at_leaves_more_often():
    from bench_rejects import random_widths

    program, rng = Program.of(load(TABLE).table), np.random.default_rng(1)
    any_width, planned_first = (random_widths(program, rng, first) for first in (False, True))
    assert 0.0 < any_width < planned_first < 1.0


def test_bound_sums_the_gain_of_all_readings_in_a_window():
    from drift_trials import WITHIN, bound

    table = load(TABLE).table
    job = job_file.from_canonical(table.job)
    one, other = (squeezed(table, job, 40 * WITHIN, seed) for seed in (1, 2))
    shares = readings(one, table) + 1.0
    assert bound(np.log(shares / shares), one, other)["nats_in_50"] == 0.0
    likelier = np.zeros(shares.shape)
    likelier[0] = 1.0  # each reading at the root is e times likelier after the drift
    assert bound(likelier, one, other)["nats_in_50"] == pytest.approx(WITHIN)


def test_bench_second_opinion_same_part_again_replaces_its_row(monkeypatch, tmp_path):
    import bench_second_opinion as bench

    monkeypatch.setattr(bench.RESULTS, "path", tmp_path / "rows.json")
    monkeypatch.setattr(bench, "bench", lambda part, trials: {"part": part, "trials": trials})
    for part, trials in (("ratchet", "1"), ("kite", "2"), ("ratchet", "3")):
        monkeypatch.setattr(sys, "argv", ["bench", "--parts", part, "--trials", trials])
        bench.main()
    rows = bench.RESULTS.read(None)["rows"]
    assert [(row["part"], row["trials"]) for row in rows] == [("kite", 2), ("ratchet", 3)]


def test_bench_ablation_every_layer_replaces_what_the_search_has():
    """A switch of a layer that was renamed would switch nothing off."""
    from bench_ablation import LAYERS

    for layer in LAYERS.values():
        before = getattr(layer.owner, layer.attribute)
        assert callable(before) == callable(layer.replacement)
        assert before != layer.replacement


def test_bench_ablation_report_pairs_plans_of_the_same_part_and_seed():
    from bench_ablation import NONE, Plan, report

    whole = [Plan(NONE, "kite", seed, 2.5, 0.99) for seed in (1, 2)]
    without = [Plan("splits", "kite", seed, 2.5 + 0.1 * seed, 0.98) for seed in (1, 2, 3)]
    _, row = report(whole + without).splitlines()
    assert row.split()[:6] == ["splits", "2", "+1.150", "(0.050)", "+0.150", "(0.050)"]
