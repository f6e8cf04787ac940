"""Poses, and the joints of an IRB 120-3/0.58 (product manual 3HAC035960, dimensions and working range).

Poses are (x, y, z, (w, x, y, z)), mm and unit quaternions; joints in degrees.
"""

import math
from collections.abc import Iterator

from drivers.abb.codec import Pose, Quaternion

# Lengths of the links, mm.
BASE_TO_SHOULDER, UPPER_ARM, ELBOW_OFFSET = 290.0, 270.0, 70.0
FOREARM, WRIST_TO_FLANGE = 302.0, 72.0
LAST_AXIS_DEG = (-400.0, 400.0)
LIMITS_DEG = ((-165, 165), (-110, 110), (-110, 70), (-160, 160), (-120, 120), LAST_AXIS_DEG)
IN_LINE = 1e-5  # sine of axis 5 below which axes 4 and 6 count as one (SingArea \\Wrist)
STEP_MM, STEP_RAD = 100.0, 1.0  # greatest step of `track`, so short that no axis makes half a turn
_REACH = math.hypot(FOREARM, ELBOW_OFFSET)  # elbow to wrist centre
_LIFT = math.atan2(ELBOW_OFFSET, FOREARM)

Vector = tuple[float, float, float]
Joints = tuple[float, ...]


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton product p q: the rotation q, followed by the rotation p."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Inverts the rotation q."""
    return (q[0], -q[1], -q[2], -q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotates a vector: v + 2 w (u x v) + 2 u x (u x v) for q = (w, u)."""
    w, i, j, k = q
    x, y, z = v
    a, b, c = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
    return (x + w * a + j * c - k * b, y + w * b + k * a - i * c, z + w * c + i * b - j * a)


def compose(a: Pose, b: Pose) -> Pose:
    """Converts pose b from the frame at pose a to the frame in which a is given."""
    x, y, z = rotate(a[3], b[:3])
    return Pose(a[0] + x, a[1] + y, a[2] + z, multiply(a[3], b[3]))


def invert(a: Pose) -> Pose:
    """Inverts a pose: the pose of frame A in frame B becomes the pose of B in A."""
    back = conjugate(a.rotation)
    x, y, z = rotate(back, (-a.x_mm, -a.y_mm, -a.z_mm))
    return Pose(x, y, z, back)


def turn_between(p: Quaternion, q: Quaternion) -> float:
    """Angle of the shortest rotation from p to q, rad."""
    return 2.0 * math.acos(min(abs(sum(a * b for a, b in zip(p, q, strict=True))), 1.0))


def between(a: Pose, b: Pose, share: float) -> Pose:
    """Interpolates from pose a (share 0) to pose b (share 1): linear position, shortest-arc rotation."""
    sign = 1.0 if sum(p * q for p, q in zip(a.rotation, b.rotation, strict=True)) >= 0.0 else -1.0
    half = turn_between(a.rotation, b.rotation) / 2.0
    near, far = 1.0 - share, share
    if half > 1e-9:
        near, far = (math.sin(part * half) / math.sin(half) for part in (near, far))
    mixed = [near * p + sign * far * q for p, q in zip(a.rotation, b.rotation, strict=True)]
    w, i, j, k = (part / math.hypot(*mixed) for part in mixed)
    x, y, z = (p + (q - p) * share for p, q in zip(a[:3], b[:3], strict=True))
    return Pose(x, y, z, (w, i, j, k))


def _about(axis: int, angle_rad: float) -> Quaternion:
    parts = [math.cos(angle_rad / 2.0), 0.0, 0.0, 0.0]
    parts[1 + axis] = math.sin(angle_rad / 2.0)
    return (parts[0], parts[1], parts[2], parts[3])


_FLANGE = _about(1, math.pi / 2.0)  # the flange's z is the sixth axis, which lies along x at zero


def forward(joints_deg: Joints) -> Pose:
    """Forward kinematics: the flange's pose in the base frame."""
    j1, j2, j3, j4, j5, j6 = (math.radians(angle) for angle in joints_deg)
    at = Pose(0.0, 0.0, BASE_TO_SHOULDER, _about(2, j1))
    for axis, angle, link in (
        (1, j2, (0.0, 0.0, UPPER_ARM)),
        (1, j3, (FOREARM, 0.0, ELBOW_OFFSET)),
        (0, j4, (0.0, 0.0, 0.0)),
        (1, j5, (0.0, 0.0, 0.0)),
        (0, j6, (WRIST_TO_FLANGE, 0.0, 0.0)),
    ):
        turn = _about(axis, angle)
        at = compose(at, Pose(*rotate(turn, link), turn))
    return Pose(*at[:3], multiply(at.rotation, _FLANGE))


def within_limits(joints_deg: Joints) -> bool:
    """Whether every axis is inside its working range."""
    axes = zip(joints_deg, LIMITS_DEG, strict=True)
    return all(low <= angle <= high for angle, (low, high) in axes)


def inverse(flange: Pose) -> Joints | None:
    """Inverse kinematics: the joints, deg, at which the flange is at a pose in the base frame.

    The arm faces the target with its elbow up. Returns None if no such joints are in the working ranges.
    """
    return next((joints for joints in _solutions(flange) if within_limits(joints)), None)


def track(
    joints_deg: Joints, start: Pose, target: Pose, share: float = 1.0
) -> Iterator[Joints | None]:
    """Follows a straight path of the flange from given joints, and yields the joints, deg, at each step.

    The joints change continuously; they may exceed a full turn and the working ranges. If a step is out of
    reach, the function yields None and ends.

    Args:
        joints_deg: joints at the start of the path.
        start: pose of the flange at the start of the path.
        target: pose of the flange at the end of the path.
        share: fraction of the path that is followed.
    """
    path, turn = math.dist(start[:3], target[:3]), turn_between(start.rotation, target.rotation)
    steps = max(math.ceil(path * share / STEP_MM), math.ceil(turn * share / STEP_RAD), 1)
    for number in range(1, steps + 1):
        place = between(start, target, share * number / steps)
        ways = [_unwound(way, joints_deg) for way in _solutions(place)]
        if not ways:
            yield None
            return
        joints_deg = min(ways, key=lambda way: math.dist(way, joints_deg))
        yield joints_deg


def _unwound(joints_deg: Joints, before_deg: Joints) -> Joints:
    """Adds whole turns to each joint, so that its angle is nearest to the one in `before_deg`."""
    pairs = zip(joints_deg, before_deg, strict=True)
    return tuple(joint + 360.0 * round((before - joint) / 360.0) for joint, before in pairs)


def _solutions(flange: Pose) -> list[Joints]:
    """Returns the joints, deg, at which the flange is at a pose, once for each posture of the wrist.

    The elbow is up, and the arm faces the flange. Working ranges are not checked; the list is empty if the
    pose is out of reach.
    """
    rotation = multiply(flange.rotation, conjugate(_FLANGE))
    out = rotate(rotation, (WRIST_TO_FLANGE, 0.0, 0.0))
    x, y, z = flange.x_mm - out[0], flange.y_mm - out[1], flange.z_mm - out[2]
    radius, height = math.hypot(x, y), z - BASE_TO_SHOULDER
    distance = math.hypot(radius, height)
    if not abs(UPPER_ARM - _REACH) < distance < UPPER_ARM + _REACH:
        return []
    cosine = (UPPER_ARM**2 + distance**2 - _REACH**2) / (2.0 * UPPER_ARM * distance)
    elevation = math.atan2(height, radius) + math.acos(max(-1.0, min(1.0, cosine)))
    up, out_mm = UPPER_ARM * math.sin(elevation), UPPER_ARM * math.cos(elevation)
    forearm = math.atan2(height - up, radius - out_mm)
    j1, j2, pitch = math.atan2(y, x), math.pi / 2.0 - elevation, _LIFT - forearm
    wrist = multiply(conjugate(multiply(_about(2, j1), _about(1, pitch))), rotation)
    arm = (j1, j2, math.remainder(pitch - j2, 2.0 * math.pi))
    return [tuple(math.degrees(angle) for angle in (*arm, *turn)) for turn in _wrist_angles(wrist)]


def _wrist_angles(wrist: Quaternion) -> list[Vector]:
    """Decomposes a rotation of the wrist into turns of axes 4, 5 and 6 (about x, y and x), rad.

    Returns two solutions, first the one with the smaller turn of axis 4. If axes 4 and 6 are in line, returns
    one solution, with axis 4 at zero.
    """
    axes: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    along, side, up = (rotate(wrist, axis) for axis in axes)
    bend = math.acos(max(-1.0, min(1.0, along[0])))
    if math.sin(bend) < IN_LINE:  # axes 4 and 6 in line: leave 4 at zero
        return [(0.0, bend, math.atan2(side[2], side[1]))]
    j4, j6 = math.atan2(along[1], -along[2]), math.atan2(side[0], up[0])
    flipped = tuple(math.remainder(angle + math.pi, 2.0 * math.pi) for angle in (j4, j6))
    return sorted([(j4, bend, j6), (flipped[0], -bend, flipped[1])], key=lambda turn: abs(turn[0]))
