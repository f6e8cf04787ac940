"""Wrench-twist pairs from measured pushes: robot logs, or a table of one's own.

A push log (the public data of arXiv 1602.06056; 2015, CMU) is numbers, one record a line: how many pushes,
then for each push the pose of the block's marker frame before and after it (x y z qw qx qy qz; mm, unit
quaternion), the number of force readings and the readings (t fx fy; s, N), the number of pusher poses and the
poses (t x y z qw qx qy qz). The sensor's offset is its first reading. What turns a push into a pair:

- The part's frame is the marker frame shifted by `MARKER_TO_PART_MM`.
- The force on the part, in the pusher's frame, is -`SENSOR_AXES` f: the sensor is mounted turned by 45
  degrees, one axis mirrored, and feels the reaction. The pusher's yaw takes it to the world.
- The first `APPROACH` of a force record is approach. Of the rest, readings weaker than the norm of the mean
  force of the whole record are not contact. The force acts at the pusher's position.
- The wrench is the mean over the contact readings, the twist the displacement over the push, both in the
  part's frame as it lay before the push. Only the direction of a twist matters.

With these facts wrench . twist > 0 for every push of the two public files; with another sign it is not.

A table is CSV with the columns `COLUMNS`, in the part's frame (origin at its area centroid), and optionally
`weight`.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.errors import InputFileError, ValueRangeError

MARKER_TO_PART_MM = (50.0, 50.0)
SENSOR_AXES = math.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])
APPROACH = 0.3
MAX_TILT_DEG = 15.0
"""A pose tilted more than this is not that of a block on a table: the numbers are in another order."""

COLUMNS = ("fx_n", "fy_n", "tau_n_mm", "vx_mm", "vy_mm", "omega_rad")
WEIGHT = "weight"
MOST_PUSHES = 100_000


class Pairs(NamedTuple):
    """Measured wrenches and the twists that answered them, in the part's frame.

    Attributes:
        wrenches: (K, 3) fx N, fy N, tau N mm.
        twists: (K, 3) vx mm, vy mm, omega rad, of any magnitude but 0.
        weights: (K,) positive.
    """

    wrenches: Array
    twists: Array
    weights: Array


class Push(NamedTuple):
    """One record of a push log, as logged.

    Attributes:
        before: (7,) pose of the marker frame, mm and quaternion.
        after: (7,) the same, after the push.
        forces: (K, 3) t s, fx N, fy N, sensor axes.
        pusher: (P, 8) t s, pose of the pusher.
    """

    before: Array
    after: Array
    forces: Array
    pusher: Array


def load(path: str | Path) -> Pairs:
    """Read pairs from a push log, or from a table if the name ends in .csv.

    Raises:
        InputFileError: missing, unreadable or not text.
        ValueRangeError: the content is not as described above; names the line.
    """
    where = str(path)
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputFileError(f"not text (byte {error.start + 1}); name a push log", where=where) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputFileError(f"cannot be read: {reason}; check the path", where=where) from error
    if where.lower().endswith(".csv"):
        return parse_table(text, where)
    return pairs_of(parse_log(text, where), where)


def join(parts: list[Pairs]) -> Pairs:
    """Return the pairs of several files as one."""
    return Pairs(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def parse_log(text: str, where: str = "push log") -> list[Push]:
    """Read a push log.

    Raises:
        ValueRangeError: it ends early, goes on after its last push, holds no push, or what should be a number
            is not; names the line.
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


def pairs_of(pushes: list[Push], where: str = "push log") -> Pairs:
    """Turn logged pushes into wrench-twist pairs, each of weight 1.

    Raises:
        ValueRangeError: a push without contact or without motion.
    """
    wrenches, twists = [], []
    for index, push in enumerate(pushes):
        twist = _twist(push)
        wrench = _wrench(push)
        if not twist.any() or not wrench[:2].any():
            lacks = "the block does not move" if wrench[:2].any() else "no force reading shows contact"
            raise ValueRangeError(f"push {index + 1} of {len(pushes)}: {lacks}; drop this push", where=where)
        wrenches.append(wrench)
        twists.append(twist)
    return Pairs(np.array(wrenches), np.array(twists), np.ones(len(pushes)))


def parse_table(text: str, where: str = "table") -> Pairs:
    """Read a table of pairs.

    Raises:
        ValueRangeError: a column or all rows missing, or a value that is not a number, not positive (a
            weight) or all zero (a wrench, a twist); names the line.
    """
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = header
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        problem = f"line 1: column {', '.join(missing)} is missing; the header must name {','.join(COLUMNS)}"
        raise ValueRangeError(problem, where=where)
    wanted = [*COLUMNS, WEIGHT] if WEIGHT in header else list(COLUMNS)
    rows = []
    for record in reader:
        place = f"line {reader.line_num}"
        row = [_number(record[name], f"{place}: {name}", where) for name in wanted]
        if not any(row[:3]) or not any(row[3:6]) or (len(row) > 6 and row[6] <= 0.0):
            problem = (
                f"{place}: wrench and twist must not be zero and a weight must be positive; drop the line"
            )
            raise ValueRangeError(problem, where=where)
        rows.append(row)
    if not rows:
        raise ValueRangeError("line 2: holds no pair; add lines of numbers", where=where)
    table = np.array(rows)
    return Pairs(table[:, :3], table[:, 3:6], table[:, 6] if len(wanted) > 6 else np.ones(len(table)))


def _twist(push: Push) -> Array:
    """Return the displacement (3,) of the part over a push, mm and rad, in its frame before the push."""
    before, after = _yaw(push.before[3:]), _yaw(push.after[3:])
    moved = push.after[:2] + _turn(after) @ MARKER_TO_PART_MM - _origin(push)
    turned = math.remainder(after - before, math.tau)
    return np.array([*(_turn(before).T @ moved), turned])


def _wrench(push: Push) -> Array:
    """Return the mean contact wrench (3,), N and N mm, in the part's frame before the push, or 0."""
    measured = push.forces[:, 1:] - push.forces[0, 1:]
    strength = np.hypot(measured[:, 0], measured[:, 1])
    contact = strength >= max(float(np.hypot(*measured.mean(axis=0))), 1e-9)
    contact[: int(APPROACH * len(measured))] = False
    if not contact.any():
        return np.zeros(3)
    times = push.forces[contact, 0]
    clock = push.pusher[:, 0]
    to_part = _turn(_yaw(push.before[3:])).T
    tip = np.column_stack([np.interp(times, clock, push.pusher[:, axis]) for axis in (1, 2)])
    yaw = np.interp(times, clock, np.unwrap(_yaw(push.pusher[:, 4:])))
    world = np.einsum("ijk,kj->ki", _turn(yaw), -measured[contact] @ SENSOR_AXES.T)
    force, arm = world @ to_part.T, (tip - _origin(push)) @ to_part.T
    torque = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return np.array([*force.mean(axis=0), torque.mean()])


def _origin(push: Push) -> Array:
    """Return the origin of the part's frame before the push, (2,) mm, world."""
    return np.asarray(push.before[:2] + _turn(_yaw(push.before[3:])) @ MARKER_TO_PART_MM)


def _yaw(quaternion: Array) -> Array:
    """Return the angle(s) about z of unit quaternions (..., 4) w x y z, rad."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion), -1, 0)
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _turn(angle: Array) -> Array:
    """Return rotation matrices (2, 2) or (2, 2, K)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _number(text: str | None, place: str, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        shown = "is missing" if not text else f"{text[:20]!r} is not a finite number"
        raise ValueRangeError(f"{place}: {shown}; correct the file", where=where, value=text)
    return value


class _Reader:
    """A push log, line by line; empty lines do not count."""

    def __init__(self, text: str, where: str) -> None:
        lines = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
        self._lines = iter([(number, fields) for number, fields in lines if fields])
        self._where = where
        self._line = 0
        self.place = "header"

    def _error(self, problem: str) -> ValueRangeError:
        return ValueRangeError(f"line {self._line}, {self.place}: {problem}", where=self._where)

    def _row(self, what: str, columns: int) -> list[float]:
        try:
            self._line, fields = next(self._lines)
        except StopIteration:
            problem = f"the file ends where {what} should follow; it is truncated, copy it again"
            raise self._error(problem) from None
        if len(fields) != columns:
            raise self._error(f"{what}: expected {columns} numbers, found {len(fields)}; correct the line")
        place = f"line {self._line}, {self.place}: {what}"
        return [_number(field, place, self._where) for field in fields]

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
            problem = f"{what}: tilted by more than {MAX_TILT_DEG:g} deg; the order is x y z qw qx qy qz"
            raise self._error(problem)
        return pose

    def rows(self, what: str, columns: int) -> Array:
        return np.array([self._row(what, columns) for _ in range(self.count(what))])

    def end(self) -> None:
        trailing = next(self._lines, None)
        if trailing is not None:
            self._line = trailing[0]
            raise self._error("more lines follow the last push; is the number of pushes right?")
