"""Growth that may be cut short: a whole tree soon, and an honest word on what is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import BELIEF, SILENT, TELLING, Oracle, look_ahead

from planner.job import model as job_file
from planner.search.actions import Action
from planner.search.anytime import Anytime
from planner.search.expand import Growth, TreeNode, breadth_first, squeeze_at
from planner.search.handling import handling_of
from planner.search.hasty import hasty_root
from planner.work.limit import Limit

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"


class Clock:
    """A second passes each time that it is looked at."""

    now = 0.0

    def __call__(self):
        self.now += 1.0
        return self.now


@pytest.fixture
def growth():
    return Growth(look_ahead([SILENT, TELLING]), Oracle(), handling_of(job_file.load(RECTANGLE)), 4)


@pytest.fixture
def root(growth):
    return TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))


def nothing(done, waiting):
    """Hears progress."""


def test_a_spent_budget_still_leaves_a_first_squeeze(growth, root):
    anytime = Anytime(growth, Limit(0.0, Clock()))
    assert not anytime.late(root)
    anytime.grow(root, [1], nothing)
    assert len(root.children) == 2
    assert anytime.late(root)
    assert anytime.cut


def test_time_that_is_kept_counts_as_spent(growth, root):
    squeeze_at(root, None, Action(np.array([0.0, 0.0, TELLING])), growth, np.random.default_rng(1))
    anytime = Anytime(growth, Limit(10.0, lambda: 0.0))
    assert not anytime.late(root, 10.0)
    assert not anytime.cut
    assert anytime.late(root, 10.1)
    assert anytime.cut
    assert not Anytime(growth, Limit()).late(root, np.inf)


def test_a_tree_that_is_done_in_time_is_not_cut(growth, root):
    anytime = Anytime(growth, Limit(1e6, Clock()))
    anytime.grow(root, [1], nothing)
    assert anytime.report() is None
    done, total, detail = anytime.told(root)
    assert done == total
    assert detail == "0.0% of the parts open, 100.0% located"


@pytest.mark.parametrize("hasty", [False, True])
def test_both_ways_of_growth_locate_what_a_squeeze_tells(growth, root, hasty):
    Anytime(growth, Limit(1e6, Clock()), hasty).grow(root, [1], nothing)
    leaves = [node for node in breadth_first(root) if not node.children]
    assert all(leaf.mode.ratio == 1.0 for leaf in leaves)


def test_a_hasty_tree_looks_less_far_with_fewer_particles(growth, root, monkeypatch):
    looked = []

    def choose(self, belief, *arguments):
        looked.append((self.depth, self.particles))
        return []

    monkeypatch.setattr(type(growth.look_ahead), "choose", choose)
    Anytime(growth, Limit(1e6, Clock()), hasty=True).grow(root, [1], nothing)
    careful = (growth.look_ahead.depth, growth.look_ahead.particles)
    assert looked == [(1, careful[1] // 4), careful]
    large = replace(root, belief=root.belief[np.arange(10_000) % len(root.belief)])
    assert len(hasty_root(large).belief) == 2000
    assert hasty_root(large).share == root.share


def test_progress_rises_as_mass_is_located_and_nothing_is_done_at_first(growth, root):
    anytime = Anytime(growth, Limit())
    shares = []
    for ratio in (1e-9, 0.5, 0.9, 0.98, 1.0):
        leaf = replace(root, mode=root.mode._replace(ratio=ratio))
        shares.append(anytime.told(leaf)[0])
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0, 1000)


def test_what_finishing_takes_follows_from_the_rate_until_now(growth, root):
    """A growth that has done half of its work in ten seconds takes ten more, and then what follows growth."""
    clock = Clock()
    anytime = Anytime(growth, Limit(0.0, clock))
    halfway = float(np.sqrt(1.0 - growth.objective.confidence))

    def half_done(done, waiting):
        """The root's squeeze takes ten seconds and leaves a tree that is half done."""
        if done == 1:
            clock.now += 10.0
        root.children = []
        root.mode = root.mode._replace(ratio=1.0 - halfway)

    anytime.grow(root, [1], half_done)
    anytime.cut = True
    assert anytime.growth_s == pytest.approx(20.0, abs=5.0)
    assert 10.0 < anytime.report().seconds < 40.0


def test_figures_name_the_cause(growth, root):
    limit = Limit(clock=Clock())
    anytime = Anytime(growth, limit)
    squeeze_at(root, None, Action(np.array([0.0, 0.0, SILENT])), growth, np.random.default_rng(0))
    limit.standing = True
    limit.ask()
    anytime.grow(root, [1], nothing)
    cut = anytime.report()
    assert cut.figures()["by"] == "interrupt"
    assert "by request" in cut.line()
    assert cut.figures()["seconds_to_finish"] >= 1
