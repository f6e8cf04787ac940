"""If the likelihood is known, draws of the posterior have the moments of the exact posterior."""

from types import SimpleNamespace

import numpy as np
import pytest
from rectangle import TABLE_PATH
from scipy.stats import binom, chisquare

from planner.evaluation.expectation import readings
from planner.refit import posterior as refit
from planner.refit.cells import Quantity, Space
from planner.refit.outcomes import Seen
from planner.refit.posterior import Effort, posterior
from planner.work.scheduler import Threads
from runtime.table import load

TABLE = load(TABLE_PATH).table
FRICTION = (Quantity(f"finger_part_{end}", 0.0, 1.0, 0.5) for end in ("min", "max"))
SPACE = Space((Quantity("encoder_mm", -3.0, 3.0, 0.0), *FRICTION), surfaces=2)
SIGMA, PARTS = np.array([0.05, 0.04, 0.04]), 100  # standard deviations that so many parts leave
LOW, SPAN = SPACE.bounds[0], np.ptp(SPACE.bounds, axis=0)
SURFACE = (0.45, 0.55)  # share of the parts that read 100 at the last node


class Plain:
    """A stand-in for `Cells`: at three nodes, the readings are the cell's three values with normal noise.

    At a fourth node the limit surface decides how many parts read 100.
    """

    space = SPACE
    program = SimpleNamespace(table=TABLE)

    def surface_entries(self):
        return np.array([[1.0, 0.0], [0.0, 1.0]])

    def run(self, point, parts, seed):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal((parts, 3)) * SIGMA * np.sqrt(PARTS) / SPAN
        read = (point[:3] - LOW) / SPAN + noise
        counts = np.clip(np.rint(50.0 + 100.0 * read), 0, 200).astype(np.int64)
        which = np.where(rng.random(parts) < SURFACE[int(point[3])], 100, 101)
        path = np.tile(np.arange(4), (parts, 1))
        nowhere = np.full(parts, -1)
        steps = np.column_stack([counts, which])
        return SimpleNamespace(steps=steps, path=path, leaf=nowhere, poses=np.zeros((parts, 3)))


def drawn(monkeypatch, truth, seed):
    """Simulates parts of a hidden cell and draws cells of their posterior.

    Returns:
        The cell's values as estimated from the mean readings (3,), the number of parts that read 100 at the
        last node, and the drawn cells.
    """
    run = Plain().run(truth, PARTS, 1000 + seed)
    counts = readings(run, TABLE)
    monkeypatch.setattr(refit, "DRAWN", 500)
    seen = Seen(counts, PARTS, np.zeros(0, np.int64), np.zeros((0, 3)))
    effort = Effort(cells=50, parts=200, parts_for_each=2.0)
    result = posterior(Plain(), seen, seed, Threads(1), effort)
    return (
        LOW + SPAN * (run.steps[:, :3].mean(axis=0) - 50.0) / 100.0,
        counts[3, TABLE.gripper.steps - 100],
        result.cells,
    )


def test_posterior_has_the_moments_of_the_exact_one(monkeypatch):
    measured, hundreds, cells = drawn(monkeypatch, np.array([1.2, 0.3, 0.7, 1.0]), 1)
    assert cells[:, :3].mean(axis=0) == pytest.approx(measured, abs=0.6 * SIGMA.max())
    spread = cells[:, :3].std(axis=0) / SIGMA
    assert (spread > 0.85).all()
    assert (spread < 1.5).all()
    chances = binom.pmf(hundreds, PARTS, SURFACE)
    assert np.mean(cells[:, 3] == 1.0) == pytest.approx(chances[1] / chances.sum(), abs=0.15)


def test_posterior_ranks_of_the_truth_are_uniform(monkeypatch):
    ranks = []
    for number, truth in enumerate(SPACE.draw(8, np.random.default_rng(5))):
        cells = drawn(monkeypatch, truth, number)[2]
        ranks.append((cells[:, :3] < truth[:3]).mean(axis=0))
    pooled = np.ravel(ranks)
    assert chisquare(np.histogram(pooled, 5, (0.0, 1.0))[0]).pvalue > 1e-3
    assert 0.75 < np.mean((pooled >= 0.05) & (pooled <= 0.95)) < 1.0


def test_space_draws_have_density_and_impossible_cells_have_none(job):
    uncertain = job.replaced(doubt={"encoder_gain": [0.0, 0.01]})
    space = Space.of(uncertain, 4)
    points = space.draw(2000, np.random.default_rng(1))
    assert (space.density(points) > 0.0).all()
    assert set(points[:, -1]) == {0.0, 1.0, 2.0, 3.0}
    assert np.mean(points[:, -1] == 0.0) == pytest.approx(0.5, abs=0.05)
    low, high = space.column("finger_part_min"), space.column("finger_part_max")
    turned = points.copy()
    turned[:, [low, high]] = points[:, [high, low]] + [1e-6, 0.0]
    assert (space.density(turned) == 0.0).all()
    assert (space.density(points + 100.0 * np.eye(points.shape[1])[0]) == 0.0).all()
