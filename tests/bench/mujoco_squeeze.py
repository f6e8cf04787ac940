"""The same squeeze in MuJoCo: a part on a table, two box fingers that close at 20 mm/s each.

A dynamic 3-D rigid-body simulation that shares nothing with the planner. Optional: `import` fails where
MuJoCo is not installed, and the bench says so. Lengths in the model are metres.
"""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import shapely
from problems import JAWS

TABLE_FRICTION = 0.3
SPEED_M_S = 0.02
GRIP_N = 5.0
HEIGHT_M = 0.01
SLICES = 12
"""Convex pieces that a concave part is cut into."""
STILL_M_S = 1e-4
STILL_STEPS = 100


def squeeze(outline: np.ndarray, mu: float, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Final poses (n, 3) in mm and rad and widths (n,) in mm; a width of 0 where the fingers meet."""
    model = mujoco.MjModel.from_xml_string(_model(outline, mu))
    data = mujoco.MjData(model)
    ends, widths = np.zeros_like(poses), np.zeros(len(poses))
    for k, pose in enumerate(poses):
        mujoco.mj_resetData(model, data)
        data.qpos[:7] = [pose[0] / 1e3, pose[1] / 1e3, HEIGHT_M / 2, *_quaternion(pose[2])]
        widths[k] = _close(model, data)
        w, x, y, z = data.qpos[3:7]
        ends[k] = *(1e3 * data.qpos[:2]), np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return ends, widths


def _close(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Step until both fingers have come to rest, or meet; returns the width in mm."""
    opening, still = JAWS[0] / 1e3, 0
    while data.time < 2 * opening / SPEED_M_S:
        reference = min(SPEED_M_S * data.time, opening / 2 + 0.005)
        data.ctrl[:] = reference
        mujoco.mj_step(model, data)
        width = opening - data.qpos[7] - data.qpos[8]
        if width <= 1e-4:
            return 0.0
        still = still + 1 if np.abs(data.qvel[6:8]).max() < STILL_M_S and data.time > 0.1 else 0
        if still > STILL_STEPS:
            break
    return float(1e3 * width)


def _quaternion(angle: float) -> tuple[float, float, float, float]:
    return np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)


def _pieces(outline: np.ndarray) -> list[np.ndarray]:
    """Convex polygons that make up the part: itself if it is convex, else hulls of slices across x."""
    part = shapely.Polygon(outline)
    if part.equals(part.convex_hull):
        return [outline]
    low, _, high, _ = part.bounds
    cuts = np.linspace(low, high, SLICES + 1)
    slices = [part.intersection(shapely.box(a, -1e3, b, 1e3)) for a, b in pairwise(cuts)]
    return [shapely.get_coordinates(piece.convex_hull)[:-1] for piece in slices]


def _model(outline: np.ndarray, mu: float) -> str:
    meshes, geoms = [], []
    for k, piece in enumerate(_pieces(outline)):
        ends = [np.column_stack([piece / 1e3, np.full(len(piece), z)]) for z in (-HEIGHT_M / 2, HEIGHT_M / 2)]
        text = " ".join(f"{v:.9g}" for v in np.concatenate(ends).ravel())
        meshes.append(f'<mesh name="piece{k}" vertex="{text}"/>')
        geoms.append(
            f'<geom type="mesh" mesh="piece{k}" contype="1" conaffinity="3" friction="{TABLE_FRICTION} 0 0" '
            'density="2700"/>'
        )
    half_length, half_width, start = JAWS[1] / 2e3, JAWS[2] / 2e3, (JAWS[0] / 2 + JAWS[2] / 2) / 1e3
    fingers = "".join(
        f'<body pos="0 {-sign * start:.6f} {HEIGHT_M}"><joint name="{name}" type="slide" axis="0 {sign} 0" '
        f'damping="5" armature="1"/><geom type="box" size="{half_length} {half_width} {HEIGHT_M * 0.9}" '
        f'contype="2" conaffinity="1" priority="1" friction="{mu} 0 0" density="7800"/></body>'
        for name, sign in (("upper", -1), ("lower", 1))
    )
    actuators = "".join(
        f'<position joint="{name}" kp="4000" kv="60" forcerange="-{GRIP_N} {GRIP_N}"/>'
        for name in ("upper", "lower")
    )
    return f"""
    <mujoco>
      <option timestep="0.001" integrator="implicitfast" cone="elliptic" impratio="10"
              noslip_iterations="10"/>
      <default><geom solref="0.002 1" solimp="0.95 0.99 0.001"/></default>
      <asset>{"".join(meshes)}</asset>
      <worldbody>
        <geom type="plane" size="1 1 0.1" contype="1" conaffinity="1" friction="{TABLE_FRICTION} 0 0"/>
        <body pos="0 0 {HEIGHT_M / 2}"><freejoint/>{"".join(geoms)}</body>
        {fingers}
      </worldbody>
      <actuator>{actuators}</actuator>
    </mujoco>"""
