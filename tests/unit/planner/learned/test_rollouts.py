"""Roll-outs: an even cover of the region, the same whoever asks and rolls out, nested in radius and count."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from problems import (
    JAWS,
    OUTLINES,
    boundary_surface,
    finger_box,
    place,
    random_poses,
    rectangle,
    simulator,
)
from scipy.stats import chi2_contingency, kstest

from planner.job import model as job_file
from planner.learned import rollouts
from planner.learned.rollouts import COLLIDES, roll_outs
from planner.mechanics import quartic_fit
from planner.mechanics.clearance import STANDS_ON, classify_contact
from planner.mechanics.simulator import STATUS_NAMES, Simulator
from planner.mechanics.squeeze import UNTOUCHED
from planner.part.outline import radius_of_gyration
from planner.part.pressure import Pressure, support

JOB = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"
SMALL = {"radius_mm": 10.0, "count": 3000}


@pytest.fixture(scope="module")
def part():
    return simulator(rectangle())


@pytest.fixture(scope="module")
def small(part):
    return roll_outs(part, **SMALL)


def same(a, b):
    return all(x.tobytes() == y.tobytes() for x, y in zip(a, b, strict=True))


def rows_of(result, ring):
    """Roll-outs that begin in a ring, one row each, in their order."""
    distance = np.hypot(result.initial[:, 0], result.initial[:, 1])
    inside = (distance >= 5.0 * ring) & (distance < 5.0 * (ring + 1))
    columns = [result.initial, result.final, result.width_mm[:, None], result.status[:, None]]
    return np.hstack(columns)[inside]


@pytest.mark.parametrize("name", OUTLINES)
class TestRegion:
    def test_beyond_the_fingers_reach_a_squeeze_changes_nothing(self, name):
        part = simulator(OUTLINES[name]())
        poses = random_poses(
            np.random.default_rng(1), 4000, 1.1 * rollouts.farthest(part.outline, JAWS)
        )
        far = poses[~rollouts.within_reach(part.outline, JAWS, poses)]
        rolled = part.roll_out(far, part.sample(len(far), np.random.default_rng(2)))
        assert len(far) > 100
        assert np.all(rolled.status == UNTOUCHED)
        assert np.array_equal(rolled.poses, far)

    def test_within_reach_some_angle_is_touched(self, name):
        part = simulator(OUTLINES[name]())
        x = 0.5 * JAWS[1] + np.max(np.hypot(*part.outline.T)) - 0.05
        poses = np.column_stack(
            [np.full(2000, x), np.zeros(2000), np.linspace(-math.pi, math.pi, 2000)]
        )
        assert rollouts.within_reach(part.outline, JAWS, poses).all()
        rolled = part.roll_out(poses, part.nominal(len(poses), 0.5))
        assert (rolled.status != UNTOUCHED).any()

    def test_an_open_finger_stands_on_the_part_where_their_areas_overlap(self, name):
        outline = OUTLINES[name]()
        poses = random_poses(np.random.default_rng(3), 500, 50.0)
        fingers = shapely.union_all(
            [finger_box(finger, finger * JAWS[0] / 2) for finger in (1, -1)]
        )
        shared = [
            shapely.Polygon(place(outline, pose)).intersection(fingers).area for pose in poses
        ]
        assert np.array_equal(
            classify_contact(outline, JAWS, poses) == STANDS_ON, np.array(shared) > 1e-6
        )
        assert 0 < np.count_nonzero(shared) < len(poses)


def test_a_jobs_region_is_three_times_its_uncertainty_as_far_as_fingers_reach():
    job = job_file.load(JOB)
    assert rollouts.region_radius(job) == pytest.approx(38.25)
    reach = math.hypot(27.5 / 2, 85 / 2 + 9.5) + math.hypot(15, 10.5)
    for radius, expected in ((900, reach), (0, rollouts.RING_MM)):
        changed = job.replaced(uncertainty={"radius_mm": radius})
        assert rollouts.region_radius(changed) == pytest.approx(expected)


def test_starts_cover_the_disc_evenly_and_at_any_angle(small):
    x, y, theta = small.initial.T
    assert kstest((x**2 + y**2) / SMALL["radius_mm"] ** 2, "uniform").pvalue > 1e-3
    for angle in (theta, np.arctan2(y, x), (theta + np.arctan2(y, x)) % math.tau - math.pi):
        assert kstest(angle / math.tau + 0.5, "uniform").pvalue > 1e-3


def test_there_are_as_many_as_were_asked_for(part, small):
    assert len(small.initial) == pytest.approx(SMALL["count"], abs=1)
    cut = roll_outs(part, 13.0, 3000)
    assert len(cut.initial) == pytest.approx(3000, abs=5 * math.sqrt(3000))
    assert np.hypot(*cut.initial[:, :2].T).max() <= 13.0


def test_the_region_ends_where_no_finger_reaches(part):
    reach = rollouts.farthest(part.outline, part.jaws)
    near, far = roll_outs(part, reach, 3000), roll_outs(part, 2 * reach, 12_000)
    assert rollouts.within_reach(part.outline, part.jaws, far.initial).all()
    assert len(far.initial) == pytest.approx(len(near.initial), rel=0.15)


def test_a_larger_region_contains_the_smaller_one(part, small):
    larger = roll_outs(part, 2 * SMALL["radius_mm"], 4 * SMALL["count"])
    for ring in range(2):
        assert np.array_equal(rows_of(larger, ring), rows_of(small, ring))


def test_fewer_are_a_prefix_of_more_in_every_ring(part, small):
    more = roll_outs(part, SMALL["radius_mm"], 3 * SMALL["count"])
    for ring in range(2):
        few = rows_of(small, ring)
        assert np.array_equal(rows_of(more, ring)[: len(few)], few)
        assert len(rows_of(more, ring)) == pytest.approx(3 * len(few), abs=3)


def test_each_ends_as_a_squeeze_of_its_start_does(part, small):
    free = small.status != COLLIDES
    widths, statuses = [small.width_mm[free]], [small.status[free]]
    for seed in (7, 8):
        drawn = part.sample(int(free.sum()), np.random.default_rng(seed))
        direct = part.roll_out(small.initial[free], drawn)
        widths.append(direct.width_mm)
        statuses.append(direct.status)
    counts = np.array([np.bincount(status, minlength=4) for status in statuses[:2]])
    assert chi2_contingency(counts[:, counts.sum(axis=0) > 0]).pvalue > 1e-3
    assert kstest(widths[0], widths[1]).pvalue > 1e-3
    apart = [np.mean(np.abs(a - widths[1]) > 0.3) for a in (widths[0], widths[2])]
    assert apart[0] == pytest.approx(
        apart[1], abs=0.03
    )  # start by start, no further than two squeezes are


def test_under_a_finger_nothing_moves(part):
    result = roll_outs(part, 60.0, 3000)
    hit = result.status == COLLIDES
    assert np.array_equal(
        hit, classify_contact(part.outline, part.jaws, result.initial) == STANDS_ON
    )
    assert np.array_equal(result.final[hit], result.initial[hit])
    assert np.all(result.width_mm[hit] == part.jaws[0])
    assert np.isin(result.status[~hit], range(len(STATUS_NAMES))).all()
    assert 0 < hit.sum() < len(hit)


def test_threads_do_not_matter(part, small):
    assert same(roll_outs(replace(part, workers=3), **SMALL), small)


def test_progress_counts_up_to_all_blocks(part):
    lines: list[tuple[str, int, int]] = []
    roll_outs(part, **SMALL, report=lambda *now: lines.append(now))
    assert all(stage == "roll-outs" and total == 4 for stage, _, total in lines)
    assert [now[1] for now in lines] == [0, 1, 2, 3, 4]


def test_only_what_the_squeeze_depends_on_seeds_it(part):
    points, weights = support(Pressure("boundary", 100), rectangle())
    quartic = quartic_fit.fit_pressure(points, weights, radius_of_gyration(rectangle()))
    others = [
        replace(part, outline=part.outline * 1.001),
        replace(part, surface=boundary_surface(part.outline * [1.0, 0.9])),
        replace(part, surface=replace(part.surface, rho_mm=11.0)),
        replace(part, surface=quartic),
        replace(part, surface=replace(quartic, certificate=2.0 * quartic.certificate)),
        replace(part, jaws=part.jaws * 1.1),
        replace(part, friction=(0.4, 0.7)),
        replace(part, wishart_dof=99),
        replace(part, release=(0.1, 0.1, 0.0)),
        replace(part, step_mm=0.3),
    ]
    names = {rollouts.content_of(each) for each in [part, *others]}
    assert len(names) == 1 + len(others)
    assert rollouts.content_of(replace(part, workers=7)) == rollouts.content_of(part)


def test_jobs_of_one_part_and_gripper_share_their_roll_outs():
    job = job_file.load(JOB)
    alike = [
        job.replaced(uncertainty={"radius_mm": 15}, seed=9),
        job.replaced(goal={"distance_mm": 1}, part={"name": "plate"}),
    ]
    contents = {rollouts.content_of(Simulator.of_job(each)) for each in [job, *alike]}
    assert len(contents) == 1
    grip = job.replaced(gripper={"opening_mm": 80})
    assert rollouts.content_of(Simulator.of_job(grip)) not in contents


@pytest.mark.parametrize(
    ("radius", "count"), [(0.0, 10), (-1.0, 10), (math.nan, 10), (math.inf, 10), (5.0, 0)]
)
def test_no_region_and_no_roll_outs_are_refused(part, radius, count):
    with pytest.raises(ValueError, match="above 0"):
        roll_outs(part, radius, count)
