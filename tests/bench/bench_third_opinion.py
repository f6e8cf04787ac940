"""Compares single squeezes in three worlds: the contact world, MuJoCo, and DART, which has hard contacts.

    python tests/bench/bench_third_opinion.py [--parts kite ...] [--squeezes 60]

Needs `dartpy` and the extra `mujoco`. In DART the part slides in the plane on the same feet as in MuJoCo.
Each foot carries the same load and is braked by Coulomb friction, so no limit surface is fitted. The fingers
are boxes that close at the job's speed until the job's force stalls them. DART solves their contacts as a
linear complementarity problem, without compliance. All worlds squeeze the same random poses, at the middle of
the job's range of friction.

Prints figures and writes `results/third_opinion.json` beside this file, part by part. Not part of
`tools/check`.
"""

import math
from itertools import product
from typing import Any

import bench_second_opinion as second
import dartpy
import harness
import numpy as np

from planner.arrays import Array
from planner.evaluation import mujoco
from planner.job import model as job_file
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.part.outline import area, radius_of_gyration, simplified

RESULTS = harness.Kept("third_opinion")
PARTS = ("kite", "ratchet", "hook-jaw")
TIMESTEP_S = 2.5e-4
CREEP_MM_S = 1.0  # A foot that is slower has less friction, in proportion
REACH = np.array([20.0, 8.0, math.pi])  # of the poses [mm, mm, rad]: at the fingers' ends, too
HIGH_MM, ROUND_MM, PLATE_MM = 5.0, 0.02, 0.2  # half the height; corners; faces, as in MuJoCo
LEAD_MM, CLOSED_MM = 0.5, 0.05
WINDOW = 160  # steps between two looks at the jaws
# Share of their way below which jaws stand still: DART's friction creeps at 1 to 2 %.
STALLED = 0.05
SLOWEST_S = 5.0


class DartWorld:
    """A DART world in which one gripper squeezes one part. Lengths are mm and forces mN."""

    def __init__(self, job: Job, mu: float) -> None:
        gripper, outline = job.gripper, simplified(job.part.outline_mm, mujoco.SIMPLIFY_MM)
        self.outline, self.opening, self.speed = outline, gripper.opening_mm, gripper.speed_mm_s
        feet, centre = mujoco.feet(job)
        height_mm = job.part.height_mm or 2.0 * job.cell.squeeze_height_mm
        mass = mujoco.DENSITY_KG_M3 * area(outline) * height_mm / 1e9
        self.feet, self.load = feet, mujoco.TABLE_FRICTION * mass * 9810.0 / len(feet)
        self.world = dartpy.simulation.World()
        self.world.setTimeStep(TIMESTEP_S)
        self.world.setGravity([0.0, 0.0, 0.0])
        solver = self.world.getConstraintSolver()
        solver.setCollisionDetector(dartpy.collision.OdeCollisionDetector())
        apart = dartpy.collision.BodyNodeCollisionFilter()
        solver.getCollisionOption().collisionFilter = apart
        self.part = dartpy.dynamics.Skeleton("part")
        joint, corners = self.part.createPlanarJointAndBodyNodePair()
        joint.setXYPlane()
        spin = mass * radius_of_gyration(outline) ** 2
        inertia = dartpy.dynamics.Inertia(mass, [*centre, 0.0], np.diag([spin, spin, spin]))
        corners.setInertia(inertia)
        _, faces = self.part.createWeldJointAndBodyNodePair(corners)
        faces.setInertia(dartpy.dynamics.Inertia(1e-9, [0.0] * 3, 1e-9 * np.eye(3)))
        sides = (np.roll(outline, shift, axis=0) for shift in (1, 0, -1))
        for before, at, after in zip(*sides, strict=True):
            back, ahead = unit(at - before), unit(after - at)
            sharp = back[0] * ahead[1] - back[1] * ahead[0]
            if sharp > 0.0:  # others are notches
                inwards = unit(ahead - back)
                half = 0.5 * math.atan2(sharp, back @ ahead)
                add(corners, ball(), at + ROUND_MM / math.cos(half) * inwards, 0.0, mu)
            # Plates end short of sharp corners, where they would stick out.
            angle, length = math.atan2(ahead[1], ahead[0]), np.linalg.norm(after - at)
            inner = np.array([-ahead[1], ahead[0]])
            trim = PLATE_MM if length > 4.0 * PLATE_MM else 0.0
            size = [length - 2.0 * trim, PLATE_MM, 2.0 * HIGH_MM]
            middle = 0.5 * (at + after) + 0.5 * PLATE_MM * inner
            add(faces, dartpy.dynamics.BoxShape(size), middle, angle, mu)
        self.world.addSkeleton(self.part)
        self.jaws = []
        for side in (1.0, -1.0):
            jaw = dartpy.dynamics.Skeleton(f"jaw{side}")
            joint, face = jaw.createPrismaticJointAndBodyNodePair()
            joint.setAxis([0.0, -side, 0.0])
            joint.setActuatorType(dartpy.dynamics.ActuatorType.SERVO)
            most = 0.5e3 * gripper.force_n
            joint.setForceUpperLimit(0, most)
            joint.setForceLowerLimit(0, -most)
            _, posts = jaw.createWeldJointAndBodyNodePair(face)
            for body, kg in ((face, mujoco.JAW_KG), (posts, 1e-6)):
                body.setInertia(dartpy.dynamics.Inertia(kg, [0.0] * 3, kg * np.eye(3)))
            width, length = gripper.finger_width_mm, gripper.finger_length_mm
            y = side * 0.5 * (gripper.opening_mm + width)
            box = [length - 2.0 * ROUND_MM, width, 2.0 * HIGH_MM]
            add(face, dartpy.dynamics.BoxShape(box), np.array([0.0, y]), 0.0, mu)
            for ends in product((-1.0, 1.0), repeat=2):
                inset = 0.5 * np.array([length, width]) - ROUND_MM
                add(posts, ball(), np.array([0.0, y]) + inset * ends, 0.0, mu)
            apart.addBodyNodePairToBlackList(face, faces)
            apart.addBodyNodePairToBlackList(posts, corners)
            self.world.addSkeleton(jaw)
            self.jaws.append(jaw)
        for upper, lower in product(self.jaws[0].getBodyNodes(), self.jaws[1].getBodyNodes()):
            apart.addBodyNodePairToBlackList(upper, lower)

    def squeeze(self, pose: Array) -> Array:
        """Squeezes the part at a pose; returns its final pose and the width (4,) [mm, mm, rad, mm]."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        ends = self.outline @ np.array([s, c]) + pose[1]
        start = max(0.5 * self.opening - max(ends.max(), -ends.min()) - LEAD_MM, 0.0)
        self.part.setPositions(pose)
        self.part.setVelocities(np.zeros(3))
        for jaw in self.jaws:
            jaw.setPositions([start])
            jaw.setVelocities([self.speed])
        widths = [math.inf]
        while len(widths) * TIMESTEP_S < SLOWEST_S:
            self.part.setForces(self._table())
            for jaw in self.jaws:
                jaw.setCommands([self.speed])
            self.world.step()
            closed = self._coupled()
            widths.append(self.opening - 2.0 * closed)
            if widths[-1] <= CLOSED_MM:
                return np.array([*self.part.getPositions(), 0.0])
            way = STALLED * 2.0 * self.speed * WINDOW * TIMESTEP_S
            if len(widths) > WINDOW + 1 and widths[-WINDOW] - widths[-1] < way:
                break
        return np.array([*self.part.getPositions(), widths[-1]])

    def _coupled(self) -> float:
        """Moves both jaws to their mean position, as one drive would; returns how far each closed."""
        closed = np.mean([jaw.getPositions() for jaw in self.jaws], axis=0)
        speed = np.mean([jaw.getVelocities() for jaw in self.jaws], axis=0)
        for jaw in self.jaws:
            jaw.setPositions(closed)
            jaw.setVelocities(speed)
        return float(closed[0])

    def _table(self) -> Array:
        """Friction of the table on all feet of the part: their total force and torque (3,)."""
        angle, (vx, vy, turn) = self.part.getPositions()[2], self.part.getVelocities()
        c, s = math.cos(angle), math.sin(angle)
        at = self.feet @ np.array([[c, s], [-s, c]])
        speeds = np.column_stack([vx - turn * at[:, 1], vy + turn * at[:, 0]])
        force = -self.load * speeds / np.hypot(CREEP_MM_S, np.hypot(*speeds.T))[:, None]
        torque = at[:, 0] @ force[:, 1] - at[:, 1] @ force[:, 0]
        return np.array([*force.sum(axis=0), torque])


def unit(way: Array) -> Array:
    """A vector, scaled to length 1."""
    return np.asarray(way / np.hypot(*way))


def ball() -> Any:
    """A tiny sphere, with which corners of parts and fingers touch what they meet."""
    return dartpy.dynamics.SphereShape(ROUND_MM)


def add(body: Any, shape: Any, at: Array, angle: float, mu: float) -> None:
    """Adds a shape to a body, at a place (2,), turned by an angle, with friction `mu`."""
    node = body.createShapeNode(shape)
    node.createCollisionAspect()
    node.createDynamicsAspect().setFrictionCoeff(mu)
    c, s = math.cos(angle), math.sin(angle)
    turned = np.eye(4)
    turned[:2, :2], turned[:2, 3] = [[c, -s], [s, c]], at
    node.setRelativeTransform(turned)


def bench(part: str, squeezes: int) -> dict[str, Any]:
    """Squeezes a part at random poses in the three worlds; counts the squeezes on which worlds agree."""
    job = job_file.load(second.TREES / part / "job.toml")
    rng = np.random.default_rng(second.SEED)
    mu = 0.5 * (job.friction.finger_part_min + job.friction.finger_part_max)
    rigid, hard = mujoco.RigidWorld(job, second.SEED), DartWorld(job, mu)
    poses = np.empty((squeezes, 3))
    for row in range(squeezes):
        while True:
            poses[row] = rng.uniform(-1.0, 1.0, 3) * REACH
            if not rigid.collides(tuple(poses[row]), job.gripper.opening_mm):
                break
    theirs, dart = np.empty((2, squeezes, 4))
    for row, pose in enumerate(poses):
        theirs[row, 3], theirs[row, :3] = rigid.close(tuple(pose), mu), rigid.pose()
        dart[row] = hard.squeeze(pose)
    ours = Simulator.of_job(job, workers=1)
    nominal = ours.roll_out(poses, ours.nominal(squeezes, mu))
    drawn = [ours.roll_out(poses, ours.sample(squeezes, rng)) for _ in range(second.DRAWS)]
    as_dart = second.near(theirs, nominal._replace(poses=dart[:, :3], width_mm=dart[:, 3]))
    ours_mujoco, ours_dart = second.near(theirs, nominal), second.near(dart, nominal)
    apart = ~np.any([second.near(theirs, one) for one in drawn], axis=0)
    in_draws = np.any([second.near(dart, one) for one in drawn], axis=0)
    return {
        "part": part,
        "squeezes": squeezes,
        "nominal as MuJoCo": int(ours_mujoco.sum()),
        "nominal as DART": int(ours_dart.sum()),
        "MuJoCo as DART": int(as_dart.sum()),
        "MuJoCo as none of 20 draws": int(apart.sum()),
        "DART as none of 20 draws": int((~in_draws).sum()),
        "where MuJoCo is none: DART as one": int((apart & in_draws).sum()),
        "where MuJoCo is none: DART as MuJoCo": int((apart & as_dart & ~in_draws).sum()),
    }


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("--parts", nargs="+", default=PARTS, metavar="PART")
    parser.add_argument("--squeezes", type=int, default=60, help="of each part")
    options = parser.parse_args()
    rows = []
    for part in options.parts:
        rows.append(bench(part, options.squeezes))
        harness.show(rows[-1])
        RESULTS.write(rows)


if __name__ == "__main__":
    main()
