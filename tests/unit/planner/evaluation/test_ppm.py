"""Rates of rare wrong answers, with bounds that hold however often one looks at a running study.

Splitting parts into copies keeps the rates unbiased; a resumed study gives the same result.
"""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_tables import small_table

from planner.evaluation import ppm
from planner.evaluation.disturbance import NONE
from planner.evaluation.trials import Program
from planner.mechanics.squeeze import SLIPPED
from planner.work.scheduler import Threads
from planner.world import Worlds
from runtime.shell.errors import InputError
from runtime.table import PPM, Tolerance


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(gripper={"noise_mm": 0}, uncertainty={"radius_mm": 0.001})


class Coins(Worlds):
    """A world that draws the width of each squeeze from `widths_mm` with the probabilities `shares`.

    If the last width is drawn, the part moves a metre away with the probability `unlucky`.
    """

    def __init__(self, widths_mm, shares, unlucky):
        self.widths_mm, self.shares, self.unlucky = np.array(widths_mm), shares, unlucky

    def world(self, chunk):
        rng = np.random.default_rng([9, chunk])

        def squeeze_many(hand):
            number = rng.choice(len(self.widths_mm), len(hand), p=self.shares)
            poses = hand.copy()
            away = (number == len(self.widths_mm) - 1) & (rng.random(len(hand)) < self.unlucky)
            poses[away, 0] += 1000.0
            return SimpleNamespace(
                poses=poses, width_mm=self.widths_mm[number], status=np.full(len(hand), SLIPPED)
            )

        return SimpleNamespace(squeeze_many=squeeze_many)


def chain(table, nodes, rare):
    """A table of nodes in a row: the first width leads to a leaf, the second to the next node.

    The second width has the probability `rare` [ppm].
    """
    first = table.nodes[0]
    low, high = (
        branch._replace(low_um=width - 1000, expected_um=width, high_um=width + 1000)
        for branch, width in zip(first.branches, (20_000, 40_000), strict=False)
    )
    leaf = table.leaves[0]._replace(x_um=0, y_um=0, resolved=True, alternatives=())
    rows = [
        first._replace(
            release=None,
            branches=(
                low._replace(probability_ppm=PPM - rare, target=-k - 1),
                high._replace(probability_ppm=rare, target=k + 1 if k < nodes - 1 else -nodes - 1),
            ),
        )
        for k in range(nodes)
    ]
    goal = replace(
        table.goal, kind="tolerances", tolerance=Tolerance(100_000, 100_000, 4_000_000), symmetry=1
    )
    limits = replace(table.limits, max_depth=nodes)
    return replace(table, nodes=tuple(rows), leaves=(leaf,) * (nodes + 1), goal=goal, limits=limits)


def study(table, job, worlds, copies, seed=1):
    return ppm.Study(Program.of(table), job, worlds, seed, np.array(copies), NONE)


def total(of, chunks):
    sums = ppm.Sums.none(len(of.program.table.leaves))
    for done in ppm.continued(of, sums, chunks * ppm.CHUNK, Threads(1)):
        sums = done
    return sums


def test_bound_holds_at_all_looks_at_once():
    rng, rate, wrong = np.random.default_rng(4), 2e-3, 0
    looks = np.unique(np.geomspace(100, 40_000, 40).astype(int))
    for _ in range(100):
        seen = np.cumsum(rng.random(40_000) < rate)
        bounds = [ppm.Bound.of(float(seen[n - 1]), int(n)) for n in looks]
        wrong += any(not b.low <= PPM * rate <= b.high for b in bounds)
    assert wrong <= 100 * ppm.ERROR + 3 * math.sqrt(100 * ppm.ERROR)


def test_bound_equals_numerical_integration_of_the_mixture():
    """The likelihood ratio is integrated over the prior by the trapezoidal rule."""
    total, parts = 7.5, 50_000
    a, b = ppm.PRIOR
    p = np.linspace(1e-9, 3e-3, 400_001)
    prior = a - 1.0, b - 1.0
    log_prior = prior[0] * np.log(p) + prior[1] * np.log1p(-p)
    log_prior -= np.log(np.trapezoid(np.exp(log_prior - log_prior[1]), p)) + log_prior[1]
    bound = ppm.Bound.of(total, parts)
    assert bound.low < PPM * total / parts < bound.high
    for end in (bound.low, bound.high):
        mean = end / PPM
        log_ratio = total * np.log(p / mean) + (parts - total) * np.log((1 - p) / (1 - mean))
        assert np.trapezoid(np.exp(log_ratio + log_prior), p) == pytest.approx(
            1.0 / ppm.ERROR, rel=2e-2
        )


def test_study_with_splitting_is_unbiased_and_narrows_rare_rates(job):
    table = chain(small_table(), 3, rare=30_000)
    worlds = Coins([20.0, 40.0], [0.97, 0.03], unlucky=0.3)
    plain, split = (total(study(table, job, worlds, k), 30) for k in ([1, 1, 1], [1, 4, 32]))
    truth = 0.03**3 * (1 - 0.7**3) + 0.03**2 * 0.97 * (1 - 0.7**2) + 0.03 * 0.97 * 0.3
    spread = []
    for sums in (plain, split):
        result = ppm.Findings.of(sums)
        assert sums.visits.sum() + sums.rejected == sums.parts
        assert abs(result.wrong.rate / PPM - truth) < 4.0 * result.standard_error() / PPM
        assert result.wrong.low < PPM * truth < result.wrong.high
        spread.append(result.standard_error(3) / PPM)
        last = 0.03**3
        assert abs(sums.visits[3] / sums.parts - last) < 5.0 * math.sqrt(last / sums.parts)
    assert spread[1] < 0.6 * spread[0]


def test_continued_after_pause_with_other_workers_is_identical(job, tmp_path):
    table, worlds = chain(small_table(), 2, rare=2000), Coins([20.0, 40.0], [0.9, 0.1], unlucky=0.5)
    of, kept = study(table, job, worlds, ppm.copies_of(table)), tmp_path / "study.json"
    whole, identity = total(of, 5), of.identity("coins")
    for chunks, workers in ((2, 1), (5, 3)):
        sums = ppm.resumed(kept, identity, len(table.leaves))
        for done in ppm.continued(of, sums, chunks * ppm.CHUNK, Threads(workers)):
            ppm.keep(kept, identity, done)
    assert ppm.resumed(kept, identity, len(table.leaves)).document() == whole.document()
    assert whole.parts == 5 * ppm.CHUNK


@pytest.mark.parametrize("change", ["other", "deep", "short", "text", "bytes"])
def test_resumed_file_of_another_study_is_refused_and_unchanged(job, tmp_path, change):
    table, kept = chain(small_table(), 2, rare=2000), tmp_path / "study.json"
    of = study(table, job, Coins([20.0, 40.0], [0.9, 0.1], 0.0), [1, 1])
    identity = of.identity("coins")
    ppm.keep(kept, identity, ppm.Sums.none(len(table.leaves)))
    document = json.loads(kept.read_text())
    if change == "other":
        assert of.identity("other coins") != identity
        document["study"] = of.identity("other coins")
    elif change == "short":
        document["sums"]["wrong"].pop()
    elif change == "deep":
        document["sums"] = [document["sums"]]
    text = {"text": b"{", "bytes": b"\xff\xfe"}.get(change, json.dumps(document).encode())
    kept.write_bytes(text)
    with pytest.raises(InputError, match="no study of this table"):
        ppm.resumed(kept, identity, len(table.leaves))
    assert kept.read_bytes() == text
