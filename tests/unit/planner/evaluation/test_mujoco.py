"""The rigid-body world agrees with theory: ends of squeezes and pushes, balance of forces, collisions."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from problems import random_convex, random_poses
from rectangle import JOB_PATH

mujoco = pytest.importorskip("mujoco")

from planner.evaluation.mujoco import TIMESTEP_S, RigidWorld, make  # noqa: E402
from planner.job import model as job_file  # noqa: E402
from planner.part.outline import width as outline_width  # noqa: E402
from planner.world import ContactWorld  # noqa: E402

JOB = job_file.load(JOB_PATH)
MU = 0.5


def job_of(outline, **changes):
    return JOB.replaced(part={"outline_mm": np.asarray(outline).tolist(), "symmetry": 1}, **changes)


def contacts(world, fingers):
    """Depth [mm] and normal force [N] (n, 2) of the part's contacts.

    If `fingers` is true, these are the contacts with the fingers, otherwise those with the table.
    """
    results = []
    for number in range(world.data.ncon):
        contact, force = world.data.contact[number], np.zeros(6)
        mujoco.mj_contactForce(world.model, world.data, number, force)
        if (max(world.model.geom_priority[contact.geom]) > 0) == fingers:
            results.append((-1e3 * contact.dist, force[0]))
    return np.array(results).reshape(-1, 2)


def test_close_without_friction_ends_at_a_local_minimum_width():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        outline = random_convex(rng, 6)
        world = RigidWorld(job_of(outline, gripper={"finger_length_mm": 200.0}), 0)
        for pose in random_poses(rng, 2, 10.0):
            width, theta = world.close(tuple(pose), 0.0), world.pose()[2]
            axis = math.pi / 2 - theta
            floor = min(
                outline_width(outline, axis + math.radians(d)) for d in np.linspace(-1.0, 1.0, 201)
            )
            assert width == pytest.approx(floor, abs=0.03)


@pytest.mark.parametrize("mu", [0.2, 0.65])
def test_close_rectangle_on_its_diagonal_jams_up_to_atan_mu(mu):
    world, diagonal = RigidWorld(JOB, 0), math.hypot(30, 21)
    for past, jams in ((-0.4, True), (0.4, False)):
        off = math.atan(mu) + math.radians(past)
        width = world.close((0.0, 0.0, math.pi / 2 - math.atan2(21, 30) + off), mu)
        assert (abs(width - diagonal * math.cos(off)) < 0.03) == jams


@pytest.mark.slow
def test_close_held_part_is_balanced_and_stays():
    world = RigidWorld(JOB, 0)
    for pose in random_poses(np.random.default_rng(3), 8, 12.0):
        width, before = world.close(tuple(pose), MU), np.array(world.pose())
        model = world.model
        fingers = contacts(world, True)
        assert fingers[:, 0].max() < 0.05
        assert fingers[:, 1].sum() == pytest.approx(2 * JOB.gripper.force_n, rel=0.05)
        # In m/s^2; an unbalanced grip would accelerate the part by 2000.
        assert np.abs(world.data.qacc[:3]).max() < 0.1
        mujoco.mj_step(model, world.data, round(0.5 / TIMESTEP_S))
        off = np.array(world.pose()) - before
        assert np.hypot(*off[:2]) < 0.05
        assert abs(math.remainder(off[2], math.tau)) < 0.002
        assert JOB.gripper.opening_mm - 1e3 * world.data.qpos[7:].sum() == pytest.approx(
            width, abs=0.05
        )


@pytest.mark.parametrize(
    ("half_deg", "inside_mm", "held"), [(60.0, 0.02, False), (15.0, 0.5, True)]
)
def test_close_corner_at_the_finger_ends_is_held_only_if_sharp(half_deg, inside_mm, held):
    side, slope = 15.0, math.tan(math.radians(half_deg))
    job = job_of([[0.0, 0.0], [side / slope, -side], [side / slope, side]])
    ahead = 0.5 * JOB.gripper.finger_length_mm - job.part.outline_mm[:, 0].min() - inside_mm
    width = RigidWorld(job, 0).close((ahead, 0.0, 0.0), 0.6)
    assert width == pytest.approx(2.0 * inside_mm * slope if held else 0.0, abs=0.03)
    assert (width > 0.0) == held


def overlap_mm2(pose, opening_mm):
    """Slow reference version of `collides`: the area that the open fingers share with the part."""
    gripper, near = JOB.gripper, 0.5 * opening_mm
    half, far = 0.5 * gripper.finger_length_mm, near + gripper.finger_width_mm
    fingers = shapely.box([-half, -half], [near, -far], [half, half], [far, -near])
    turned = shapely.affinity.rotate(shapely.Polygon(JOB.part.outline_mm), pose[2], (0, 0), True)
    lying = shapely.affinity.translate(turned, *pose[:2])
    return shapely.area(shapely.intersection(fingers, lying)).sum()


def test_collides_where_finger_and_part_areas_overlap():
    world, rng = make(JOB, 0), np.random.default_rng(2)
    poses = np.column_stack(
        [rng.uniform(-40, 40, 200), rng.uniform(-60, 60, 200), rng.uniform(-3, 3, 200)]
    )
    for opening_mm in (JOB.gripper.opening_mm, 40.0):
        stood = [world.collides(tuple(pose), opening_mm) for pose in poses]
        assert stood == [overlap_mm2(pose, opening_mm) > 0.0 for pose in poses]
        assert 20 < sum(stood) < 180


def test_push_ends_near_the_quasi_static_push():
    """All parts but one end at most 1 mm outside the range where quasi-static pushes end.

    The range is the central 96 % of pushes with random mechanics.
    """
    rng, (opening, way, n, draws) = np.random.default_rng(8), (20.0, 28.0, 4, 60)
    far = JOB.gripper.finger_length_mm / 2 + np.hypot(*JOB.part.outline_mm.T).max() + 1.0
    poses = np.column_stack(
        [far + rng.uniform(0, 8, n), rng.uniform(-8, 8, n), rng.uniform(-np.pi, np.pi, n)]
    )
    world = make(JOB, 2)
    rigid = np.array([world.push(tuple(pose), opening, way) for pose in poses])
    many = ContactWorld(JOB, 1, 1).push_many(
        np.repeat(poses, draws, axis=0), np.full(n * draws, opening), np.full(n * draws, way)
    )
    low, high = np.quantile(many.reshape(n, draws, 3)[:, :, :2], [0.02, 0.98], axis=1)
    off = np.maximum(low - rigid[:, :2], rigid[:, :2] - high)
    assert np.sort(off.max(axis=1))[-2] < 1.0  # except one, which may roll off the other finger
    assert np.hypot(*(rigid - poses)[:, :2].T).max() > 5.0
