"""A world for comparison: squeezes as rigid-body dynamics in MuJoCo (Todorov, Erez and Tassa 2012).

The part is a prism that stands on feet and has mass; jaws of finite force and speed close on it. Nothing here
is quasi-static: no limit surface, no LCP. Values that a job does not state are constants below; none was
tuned to a result. Lengths in the model are metres.

`plan-evaluate TREE.msgpack --world planner.evaluation.mujoco:make --trials 300`
"""

import math
from collections.abc import Callable
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.belief.transition import finger_speed_mm_s
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.mechanics.squeeze import GRASPED, JAMMED, SLIPPED, STATUS_NAMES, UNTOUCHED
from planner.part.outline import area, radius_of_gyration, simplified
from planner.part.pressure import support
from planner.world import Pose, stands_on

try:
    import mujoco
except ImportError as missing:
    raise ImportError(f"{missing}; install it with: pip install 'squeezetree[mujoco]'") from missing

TABLE_FRICTION = 0.3  # friction coefficient between part and table
ON_TABLE = [TABLE_FRICTION, 0.0, 0.0]  # sliding, torsional and rolling friction of a geom
DENSITY_KG_M3 = 2700.0  # density of the part: aluminium
JAW_KG = 0.2  # moving mass of a finger, with its share of the drive
ARM_KG = 1e3  # mass of a hand that pushes: the arm behind it does not yield
FEET = 24  # feet for a pressure along a line or over an area
FOOT_M = 5e-4  # radius of a foot
ROUND_M = 2e-5  # radius of the corners of part and fingers
PLATE_M = 2e-4  # thickness of the faces, over twice the depth to which impacts drive a corner in
CLOSED_M = 5e-5  # jaws nearer than this have met: only the rounding of a sharp corner fits between
TIMESTEP_S = 2.5e-4
CONTACT_S = 5e-4  # time constant of contacts: they yield by less than 0.05 mm under 40 N
LEAD_M = 5e-4  # least distance of the fingers from the part at the start of a squeeze
SIMPLIFY_MM = 0.01  # tolerated error of an outline with fewer vertices
BLOCK = 20  # steps between two checks of the jaws
WINDOW_S = 0.04
STALLED = 0.01  # share of the way of free jaws within `WINDOW_S` below which jaws stand still
REST_S = 0.1  # time after which a pushed part lies still
UNMOVED_MM = 0.01  # distance that a part may settle when it is set down
SEED_MUJOCO = 0x4D554A4F
STIFF = [CONTACT_S, 1.0], [0.99, 0.999, 1e-5, 0.5, 2.0]  # solref and solimp of MuJoCo
CORNER, PLATE, FINGER, POST, TABLE = 1, 2, 4, 8, 16  # collision bits of geoms


class RigidWorld:
    """World of one part and one gripper; each squeeze or push draws its friction within the job's bounds."""

    def __init__(self, job: Job, seed: int, timestep_s: float = TIMESTEP_S) -> None:
        self._job = job
        self._rng = np.random.default_rng([seed, SEED_MUJOCO])
        self.model = _model(job, timestep_s, _add_jaws)
        self.data = mujoco.MjData(self.model)

    def squeeze(self, pose_hand: Pose) -> tuple[Pose, float, str]:
        """Closes the open jaws on the part, which lies at a pose in the hand frame [mm, mm, rad].

        Returns:
            The final pose in the hand frame, the width [mm] and the status.
        """
        mu, release = self._mu(), self._job.release
        scatter = np.array([release.shift_mm, release.shift_mm, math.radians(release.turn_deg)])
        shift = scatter * self._rng.standard_normal(3)
        if self.collides(pose_hand, self._job.gripper.opening_mm):
            return pose_hand, self._job.gripper.opening_mm, STATUS_NAMES[JAMMED]
        width_mm = self.close(pose_hand, mu)
        pose = self.pose()
        if width_mm == 0.0:
            moved = math.dist(pose[:2], pose_hand[:2]) > UNMOVED_MM
            return pose, 0.0, STATUS_NAMES[SLIPPED if moved else UNTOUCHED]
        x, y, theta = (np.array(pose) + shift).tolist()
        return (x, y, theta), width_mm, STATUS_NAMES[GRASPED if self._blocked() else JAMMED]

    def push(self, pose_hand: Pose, opening_mm: float, way_mm: float) -> Pose:
        """Pushes the part with fingers held `opening_mm` apart; the hand goes along its x axis.

        Returns:
            The final pose in the frame that the hand had at the start [mm, mm, rad].
        """
        model, data, gripper = self._pushing, mujoco.MjData(self._pushing), self._job.gripper
        model.geom_friction[model.geom_priority > 0, 0] = self._mu()
        _lay(data, pose_hand)
        half = 0.5 * (opening_mm + gripper.finger_width_mm)
        middle = (0.5 - gripper.upper_finger_share) * (gripper.opening_mm - opening_mm)
        for name, y in (("upper", middle + half), ("lower", middle - half)):
            model.body(name).pos[1] = y / 1e3
        speed = finger_speed_mm_s(gripper.speed_mm_s) / 1e3
        data.qvel[6] = speed
        mujoco.mj_step(model, data, round(way_mm / 1e3 / speed / model.opt.timestep))
        data.qvel[6] = 0.0
        mujoco.mj_step(model, data, round(REST_S / model.opt.timestep))
        return _pose(data)

    def collides(self, pose_hand: Pose, opening_mm: float) -> bool:
        """Whether fingers opened to `opening_mm` would stand on the part at a pose in the hand frame."""
        jaws = jaws_of(self._job.gripper)
        return stands_on(self._job.part.outline_mm, jaws, pose_hand, opening_mm)

    def close(self, pose_hand: Pose, mu: float) -> float:
        """Closes the jaws on a part at a pose in the hand frame, with friction `mu`, until they stand still.

        Returns:
            The width [mm]; 0 if the jaws meet.
        """
        model, data, gripper = self.model, self.data, self._job.gripper
        mujoco.mj_resetData(model, data)
        model.geom_friction[model.geom_priority > 0, 0] = mu
        _lay(data, pose_hand)
        shares = np.array([gripper.upper_finger_share, 1.0 - gripper.upper_finger_share])
        c, s = math.cos(pose_hand[2]), math.sin(pose_hand[2])
        turned = self._job.part.outline_mm @ np.array([[c, s], [-s, c]])
        ends = turned[:, 1] + pose_hand[1]
        rooms = (gripper.opening_mm / 2 - np.array([ends.max(), -ends.min()])) / 1e3 - LEAD_M
        free = float(np.min(rooms[shares > 0.0] / shares[shares > 0.0]))
        speed = gripper.speed_mm_s / 1e3
        data.qpos[7:], data.qvel[6:], data.ctrl[0] = shares * max(free, 0.0), shares * speed, speed
        return 1e3 * self._until_stalled()

    def pose(self) -> Pose:
        """Current pose of the part in the hand frame [mm, mm, rad]."""
        return _pose(self.data)

    @cached_property
    def _pushing(self) -> Any:
        return _model(self._job, float(self.model.opt.timestep), _add_hand)

    def _mu(self) -> float:
        friction = self._job.friction
        return float(self._rng.uniform(friction.finger_part_min, friction.finger_part_max))

    def _width(self) -> float:
        return float(self._job.gripper.opening_mm / 1e3 - self.data.qpos[7:].sum())

    def _until_stalled(self) -> float:
        looks = round(WINDOW_S / (BLOCK * self.model.opt.timestep))
        widths = [self._width()]
        least = STALLED * float(self.data.ctrl[0]) * WINDOW_S
        while len(widths) <= looks or widths[-1 - looks] - widths[-1] >= least:
            mujoco.mj_step(self.model, self.data, BLOCK)
            widths.append(self._width())
            if widths[-1] <= CLOSED_M:
                return 0.0
        return widths[-1]

    def _blocked(self) -> bool:
        """Whether the jaws stay blocked without friction: sets it to 0 and simulates a further `WINDOW_S`."""
        width = self._width()
        self.model.geom_friction[self.model.geom_priority > 0, 0] = 0.0
        mujoco.mj_step(self.model, self.data, round(WINDOW_S / self.model.opt.timestep))
        return width - self._width() < STALLED * float(self.data.ctrl[0]) * WINDOW_S


make = RigidWorld  # the world factory: `make(job, seed)`


def feet(job: Job) -> tuple[Array, Array]:
    """Points (m, 2) where the part touches the table, and the centre of pressure (2,).

    Both are in the part's frame [mm]. All feet are equally stiff. So evenly spaced feet carry equal loads if
    the centre of mass is above the centre of pressure.

    Raises:
        ValueError: the job gives a limit surface in place of a pressure.
    """
    points, weights = support(job.pressure, job.part.outline_mm)
    centre = weights @ points
    if len(points) > FEET:
        points = points[np.searchsorted(np.cumsum(weights), (np.arange(FEET) + 0.5) / FEET)]
    return points, centre


def _lay(data: Any, pose: Pose) -> None:
    x, y, theta = pose
    data.qpos[:7] = [x / 1e3, y / 1e3, 0.0, math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)]


def _pose(data: Any) -> Pose:
    x, y, _, w, i, j, k = data.qpos[:7].tolist()
    return 1e3 * x, 1e3 * y, math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))


def _model(job: Job, timestep_s: float, add_fingers: Callable[[Any, Job, float], None]) -> Any:
    """The MuJoCo model of table, part and fingers; `add_fingers` receives the height of the part [m]."""
    spec = mujoco.MjSpec()
    for kind in (spec.default.geom, spec.default.equality):
        kind.solref, kind.solimp = STIFF
    spec.option.timestep = timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
    spec.option.noslip_iterations = 10  # otherwise a part held by friction creeps
    plane, bits = mujoco.mjtGeom.mjGEOM_PLANE, {"contype": TABLE, "conaffinity": 0}
    spec.worldbody.add_geom(type=plane, size=[1.0, 1.0, 0.1], friction=ON_TABLE, **bits)
    height = (job.part.height_mm or 2.0 * job.cell.squeeze_height_mm) / 1e3
    _add_part(spec, job, height)
    add_fingers(spec, job, height)
    return spec.compile()


def _add_part(spec: Any, job: Job, height: float) -> None:
    outline, body = job.part.outline_mm, spec.worldbody.add_body()
    body.add_freejoint()
    points, centre = feet(job)
    mass = DENSITY_KG_M3 * area(outline) / 1e6 * height
    gyration = (radius_of_gyration(outline) / 1e3) ** 2
    tilting = mass * (0.5 * gyration + height**2 / 12.0)  # as of a round part; it hardly tilts
    body.explicitinertial, body.mass, body.ipos = True, mass, [*centre / 1e3, 0.5 * height]
    body.inertia = [tilting, tilting, mass * gyration]
    _add_rim(body, simplified(outline, SIMPLIFY_MM) / 1e3, height, job.cell.squeeze_height_mm / 1e3)
    for x, y in points / 1e3:
        _add_sphere(body, FOOT_M, [x, y, FOOT_M], contype=0, conaffinity=TABLE, friction=ON_TABLE)


def _add_rim(body: Any, outline: Array, height: float, tips: float) -> None:
    """Adds the side of the prism: corners to touch fingers' faces, and faces to touch fingers' corners.

    A corner is a pair of tiny spheres, at the lowest and the highest point that a finger can touch; a face is
    a thin plate. MuJoCo computes contacts of spheres with boxes in closed form. For contacts of convex meshes
    it searches: a few degrees from flush the search returns the normal of the wrong face, and a squeeze that
    should jam slips.
    """
    ahead = np.roll(outline, -1, axis=0) - outline
    angles = np.arctan2(ahead[:, 1], ahead[:, 0])
    lengths = np.hypot(*ahead.T)
    bends = np.remainder(angles - np.roll(angles, 1) + np.pi, math.tau) - np.pi
    for corner, angle, bend in zip(outline, angles, bends, strict=True):
        if bend > 0.0:  # the others are notches
            inwards = angle + 0.5 * (math.pi - bend)
            inset = ROUND_M / math.cos(0.5 * bend)
            x, y = corner + inset * np.array([math.cos(inwards), math.sin(inwards)])
            _add_post(body, x, y, (tips, height), contype=CORNER, conaffinity=FINGER)
    # A plate would stick out beyond a corner of less than 90 degrees.
    trims = np.array([PLATE_M * math.tan(max(bend - 0.5 * math.pi, 0.0)) for bend in bends])
    for k, (corner, angle, length) in enumerate(zip(outline, angles, lengths, strict=True)):
        first, last = trims[k], length - trims[(k + 1) % len(trims)]
        if last > first:
            c, s, middle = math.cos(angle), math.sin(angle), 0.5 * (first + last)
            inset = 0.5 * PLATE_M
            x, y = corner + np.array([c * middle - s * inset, s * middle + c * inset])
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[0.5 * (last - first), inset, 0.5 * height],
                pos=[x, y, 0.5 * height],
                quat=[math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)],
                contype=PLATE,
                conaffinity=POST,
            )


def _add_post(body: Any, x: float, y: float, ends: tuple[float, float], **kind: Any) -> None:
    """Adds a vertical edge at (x, y): a tiny sphere at each of the two heights `ends` [m]."""
    for z in (ends[0] + ROUND_M, ends[1] - ROUND_M):
        _add_sphere(body, ROUND_M, [x, y, z], **kind)


def _add_sphere(body: Any, radius: float, at: list[float], **kind: Any) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0.0, 0.0], pos=at, **kind)


def _add_finger(body: Any, job: Job, height: float) -> None:
    """Adds a finger to a body: a box from the height of the tips to above the part, centred at the origin."""
    tips, size = job.cell.squeeze_height_mm / 1e3, _finger_size(job, height)
    # The face ends at the posts: a face as long as the finger would hold a corner that has slid off.
    face, box = [size[0] - ROUND_M, *size[1:]], mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(type=box, size=face, mass=JAW_KG, contype=FINGER, conaffinity=CORNER, priority=1)
    inset, ends = np.array(size[:2]) - ROUND_M, (-size[2], height - tips - size[2])
    bits = {"contype": POST, "conaffinity": PLATE}
    for x, y in inset * np.array([*product((-1.0, 1.0), repeat=2)]):
        _add_post(body, x, y, ends, **bits, priority=1, mass=0.0)


def _finger_size(job: Job, height: float) -> list[float]:
    """Half the length, half the width and half the height of a finger [m]."""
    gripper, above = job.gripper, height - job.cell.squeeze_height_mm / 1e3
    return [gripper.finger_length_mm / 2e3, gripper.finger_width_mm / 2e3, 0.5 * above + FOOT_M]


def _add_jaws(spec: Any, job: Job, height: float) -> None:
    """Adds two fingers on slides; one drive closes them, each by the share that the job states."""
    gripper, tips, size = job.gripper, job.cell.squeeze_height_mm / 1e3, _finger_size(job, height)
    drive = spec.add_tendon(name="drive")
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        y = side * (gripper.opening_mm / 2e3 + size[1])
        body = spec.worldbody.add_body(pos=[0.0, y, tips + size[2]])
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, -side, 0.0])
        _add_finger(body, job, height)
        drive.wrap_joint(name, 1.0)
    # The force falls linearly with speed, like that of a motor: from the job's force at rest to 0 at
    # the job's speed.
    slope = gripper.force_n / (gripper.speed_mm_s / 1e3)
    spec.add_actuator(
        target="drive",
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        gainprm=[slope, *[0.0] * 9],
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, 0.0, -slope, *[0.0] * 7],
    )
    shares = {"upper": gripper.upper_finger_share, "lower": 1.0 - gripper.upper_finger_share}
    less, more = sorted(shares, key=lambda name: shares[name])
    kind = {"type": mujoco.mjtEq.mjEQ_JOINT, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
    couple = spec.add_equality(**kind, name1=less, name2=more)
    couple.data[:2] = [0.0, shares[less] / shares[more]]


def _add_hand(spec: Any, job: Job, height: float) -> None:
    """Adds both fingers on a hand that slides along x and is heavy enough to keep its speed."""
    tips, size = job.cell.squeeze_height_mm / 1e3, _finger_size(job, height)
    hand = spec.worldbody.add_body(name="hand", pos=[0.0, 0.0, tips + size[2]])
    hand.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    hand.explicitinertial, hand.mass, hand.inertia = True, ARM_KG, [ARM_KG] * 3
    for name in ("upper", "lower"):
        _add_finger(hand.add_body(name=name), job, height)
