"""Measured wrench-twist pairs, from a robot's push log or a table.

A table is CSV with the columns `COLUMNS` and optionally `weight`: the wrench on the part and the resulting
twist, about the origin of the part's frame (its area centroid) and along its axes. Only the direction of a
twist matters.

A log has the format of the public data of arXiv 1602.06056 (CMU, 2015): numbers, one record a line. The
number of pushes, then for each push the pose of the block's marker frame before and after it (x y z qw qx
qy qz; mm, unit quaternion), the number of force readings and the readings (t fx fy; s, N), the number of
pusher poses and the poses (t x y z qw qx qy qz). A push becomes a pair as follows:

- The part's frame is the marker frame shifted by `MARKER_TO_PART_MM`, the centroid of the block: a right
  triangle with legs of 150 mm along the marker's axes.
- The first reading of the sensor is its offset, and is subtracted. The force on the part, in the pusher's
  frame, is -`SENSOR_AXES` f: the sensor is mounted turned by 45 degrees, with one axis mirrored, and measures
  the reaction.
- The share `APPROACH` at the start of a force record counts as approach. A later reading counts as contact
  if it is at least as strong as the norm of the mean force of the whole record.
- During the rest of the record the block is taken to move evenly from the pose before to the pose after. The
  wrench is the mean of the contact readings, each with its torque, in the part's frame at the moment of the
  reading. The twist is the constant one that takes the block from the pose before to the pose after (eq. 1
  relates wrench and twist).
- The tip of the pusher lies to the left of the logged position, by `tip_offset`.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner import columns
from planner.arrays import Array, BoolArray
from planner.job import documents
from planner.job.fields import shown
from runtime.shell.errors import InputError

MARKER_TO_PART_MM = np.array([50.0, 50.0])
FACES = np.array([[-1.0, 0.0], [0.0, -1.0], [math.sqrt(0.5), math.sqrt(0.5)]])
"""Outward normals of the block's faces."""

FACES_MM = np.array([50.0, 50.0, 50.0 * math.sqrt(0.5)])  # distances of the faces from the centroid

SENSOR_AXES = math.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])
APPROACH = 0.3
TIP_PRIOR = 0.5
"""Strength of the pull of `tip_offset` to 0: scatter of the distances from a face, over the likely offset."""

MAX_TILT_DEG = 15.0  # largest tilt of a logged pose; more means that the numbers have another order

MOST_PUSHES = 100_000
MOST = 1e30  # upper limit on the numbers of a file


class Push(NamedTuple):
    """One push, with the poses and forces as its log states them."""

    before: Array  # (7,) pose of the marker frame, mm and quaternion
    after: Array  # (7,) the same, after the push
    forces: Array  # (K, 3) t s, fx N, fy N, sensor axes
    pusher: Array  # (P, 8) t s, pose of the pusher, mm and quaternion


def parse(text: str, where: str = "push log") -> list[Push]:
    """Reads a push log, and returns its pushes.

    Raises:
        InputError: the log is truncated, continues after its last push, holds no push, or has an entry that
            is not a number. The message names the line.
    """
    reader = _Reader(text, where)
    pushes = []
    count = reader.count("pushes", MOST_PUSHES)
    for index in range(count):
        reader.place = f"push {index + 1} of {count}"
        before, after = reader.pose("pose before"), reader.pose("pose after")
        forces = reader.rows("force readings", 3)
        pushes.append(Push(before, after, forces, reader.rows("pusher poses", 8)))
    reader.end()
    return pushes


def pairs(pushes: list[Push], where: str = "push log") -> tuple[Array, Array]:
    """Turns logged pushes into wrench-twist pairs.

    Returns:
        Wrenches (K, 3) [N, N, N mm] and twists (K, 3) [mm, mm, rad], in the part's frame.

    Raises:
        InputError: a push has no contact or no motion.
    """
    sideways = tip_offset(pushes)
    wrenches = np.array([_wrench(push, sideways) for push in pushes])
    twists = np.array([_twist(push) for push in pushes])
    for number, (wrench, twist) in enumerate(zip(wrenches, twists, strict=True), 1):
        if not twist.any() or not wrench[:2].any():
            lacks = "no force reading shows contact" if twist.any() else "the block does not move"
            problem = f"push {number} of {len(pushes)}: {lacks}; drop this push"
            raise InputError(problem, where=where)
    return wrenches, twists


def tip_offset(pushes: list[Push]) -> float:
    """Estimates how far the pusher's tip lies to the left of its logged position [mm].

    At the end of a push the tip touches a face of the block. The logged position lies at a distance from this
    face: a constant of the face (radius of the tip, size of the block) less the component of the offset along
    the face's normal. This component changes with the direction of the push. The constants and the offset are
    estimated by least squares. A weak prior at 0 decides the offset if too few directions occur.
    """
    rows, distances = [np.array([0.0, 0.0, 0.0, TIP_PRIOR])], [0.0]
    for push in pushes:
        angle, yaw = _yaw(push.after[3:]), _yaw(push.pusher[-1, 4:])
        to_part = _turn(angle).T
        tip = to_part @ (push.pusher[-1, 1:3] - _origin(push.after))
        beyond = FACES @ tip - FACES_MM
        face = int(np.argmax(beyond))
        left = to_part @ _turn(yaw)[:, 1]
        rows.append(np.append(np.eye(3)[face], -FACES[face] @ left))
        distances.append(float(beyond[face]))
    return float(np.linalg.lstsq(np.array(rows), np.array(distances), rcond=None)[0][3])


def _twist(push: Push) -> Array:
    """The twist (3,) [mm, mm, rad] that takes the block from the pose before to the pose after a push.

    It is the SE(2) logarithm of the motion.
    """
    before, turned = _yaw(push.before[3:]), _turned(push)
    x, y = _turn(before).T @ (_origin(push.after) - _origin(push.before))
    half = 0.5 * turned
    along = half / math.tan(half) if half else 1.0
    return np.array([along * x + half * y, along * y - half * x, turned])


def _wrench(push: Push, sideways: float) -> Array:
    """The mean contact wrench (3,) [N, N, N mm] in the part's frame; 0 if there is no contact.

    `sideways` is the offset of the tip to the left of the logged position [mm].
    """
    measured = push.forces[:, 1:] - push.forces[0, 1:]
    contact = _contact(measured)
    if not contact.any():
        return np.zeros(3)
    times, clock = push.forces[contact, 0], push.pusher[:, 0]
    start, stop = push.forces[int(APPROACH * len(measured)), 0], push.forces[-1, 0]
    share = (times - start) / max(stop - start, 1e-9)  # (C,) of the motion
    before, after = _origin(push.before), _origin(push.after)
    origin = before + share[:, None] * (after - before)
    to_part = _turn(-_yaw(push.before[3:]) - share * _turned(push))  # (2, 2, C)
    pusher = _turn(np.interp(times, clock, np.unwrap(_yaw(push.pusher[:, 4:]))))
    logged = np.column_stack([np.interp(times, clock, push.pusher[:, axis]) for axis in (1, 2)])
    tip = logged + sideways * pusher[:, 1].T
    world = np.einsum("ijc,cj->ci", pusher, -measured[contact] @ SENSOR_AXES.T)
    force = np.einsum("ijc,cj->ci", to_part, world)
    arm = np.einsum("ijc,cj->ci", to_part, tip - origin)
    torque = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return np.array([*force.mean(axis=0), torque.mean()])


def _contact(measured: Array) -> BoolArray:
    """Mask (K,) of the force readings (K, 2) [N] that count as contact."""
    strength = np.hypot(measured[:, 0], measured[:, 1])
    contact = strength >= max(float(np.hypot(*measured.mean(axis=0))), 1e-9)
    contact[: int(APPROACH * len(measured))] = False
    return np.asarray(contact)


def _origin(pose: Array) -> Array:
    """The origin (2,) of the part's frame in the world [mm], from a logged pose of the marker frame."""
    return np.asarray(pose[:2] + _turn(_yaw(pose[3:])) @ MARKER_TO_PART_MM)


def _turned(push: Push) -> float:
    """The angle by which a push turned the block, in [-pi, pi] rad."""
    return math.remainder(float(_yaw(push.after[3:]) - _yaw(push.before[3:])), math.tau)


def _yaw(quaternion: Array) -> Array:
    """The angles (...) about z of unit quaternions (..., 4) w x y z, rad."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _turn(angle: Array | float) -> Array:
    """The rotation matrix (2, 2) of an angle, or the matrices (2, 2, K) of angles (K,), rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


class _Reader:
    """A push log, read line by line without empty lines."""

    def __init__(self, text: str, where: str) -> None:
        lines = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
        self._lines = iter([(number, fields) for number, fields in lines if fields])
        self._where = where
        self._line = 0
        self.place = "header"

    def _error(self, problem: str) -> InputError:
        return InputError(f"line {self._line}, {self.place}: {problem}", where=self._where)

    def _row(self, what: str, columns: int) -> list[float]:
        try:
            self._line, fields = next(self._lines)
        except StopIteration:
            problem = f"the file ends where {what} should follow; it is truncated, copy it again"
            raise self._error(problem) from None
        if len(fields) != columns:
            problem = f"expected {columns} numbers, found {len(fields)}; correct the line"
            raise self._error(f"{what}: {problem}")
        return [self._finite(field, what) for field in fields]

    def _finite(self, field: str, what: str) -> float:
        try:
            value = float(field)
        except ValueError:
            value = math.nan
        if not abs(value) < MOST:
            problem = f"{shown(field)} is not a number below {MOST:g}; correct the file"
            raise self._error(f"{what}: {problem}")
        return value

    def count(self, what: str, most: int = 10_000_000) -> int:
        value = self._row(f"number of {what}", 1)[0]
        if value != int(value) or not 1 <= value <= most:
            raise self._error(f"number of {what} is {value:g}, not a whole number from 1 to {most}")
        return int(value)

    def pose(self, what: str) -> Array:
        pose = np.array(self._row(what, 7))
        w, x, y, z = pose[3:]
        if abs(w * w + x * x + y * y + z * z - 1.0) > 1e-2:
            raise self._error(f"{what}: qw qx qy qz is not a unit quaternion; correct the line")
        if math.degrees(2.0 * math.asin(min(1.0, math.hypot(x, y)))) > MAX_TILT_DEG:
            problem = f"tilted by more than {MAX_TILT_DEG:g} deg; the order is x y z qw qx qy qz"
            raise self._error(f"{what}: {problem}")
        return pose

    def rows(self, what: str, columns: int) -> Array:
        return np.array([self._row(what, columns) for _ in range(self.count(what))])

    def end(self) -> None:
        trailing = next(self._lines, None)
        if trailing is not None:
            self._line = trailing[0]
            raise self._error("more lines follow the last push; is the number of pushes right?")


COLUMNS = ("fx_n", "fy_n", "tau_n_mm", "vx_mm", "vy_mm", "omega_rad")
# Columns of a table of directions: torque over rho, angle times rho, at any scale.
DIRECTIONS = ("fx", "fy", "tau_rho", "vx", "vy", "om_rho")
WEIGHT = "weight"


class Pairs(NamedTuple):
    """Measured wrenches and the resulting twists, in the part's frame."""

    wrenches: Array  # (K, 3) fx N, fy N, tau N mm
    twists: Array  # (K, 3) vx mm, vy mm, omega rad, of any magnitude but 0
    weights: Array  # (K,) positive


def load(path: Path) -> Pairs:
    """Reads pairs from a push log, or from a table if the name ends in .csv.

    Raises:
        InputError: the file is missing, unreadable or not text.
        InputError: the content does not have the format that the module's docstring describes. The message
            names the line, the push or the pair.
    """
    if path.suffix.lower() == ".csv":
        return load_table(path)
    where = str(path)
    wrenches, twists = pairs(parse(documents.read(path), where), where)
    return Pairs(wrenches, twists, np.ones(len(twists)))


def load_table(path: Path, names: Sequence[str] = COLUMNS) -> Pairs:
    """Reads a table of pairs; `names` are the columns of the wrench (three) and of the twist (three).

    Raises:
        InputError: `columns.read` refuses the file, or it has no rows, a number that is not below `MOST`, a
            weight that is not positive, or a wrench or twist that is zero.
    """
    table = np.column_stack([*columns.read(path, names, {WEIGHT: 1.0}).values()])
    wrenches, twists, weights = table[:, :3], table[:, 3:6], table[:, 6]
    if not len(table):
        raise InputError("holds no pair; add lines of numbers", where=str(path))
    sound = wrenches.any(axis=1) & twists.any(axis=1) & (weights > 0.0)
    for number in np.flatnonzero(~(sound & (np.abs(table).max(axis=1) < MOST))):
        wrong = f"a wrench or twist is zero, a weight not positive, or a number not below {MOST:g}"
        raise InputError(f"pair {number + 1}: {wrong}; drop the line", where=str(path))
    return Pairs(wrenches, twists, weights)


def join(parts: list[Pairs]) -> Pairs:
    """Concatenates the pairs of several files."""
    return Pairs(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
