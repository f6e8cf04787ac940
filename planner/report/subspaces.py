"""The subspaces of final poses by finger width, as the paper's Fig. 4 shows them: one panel each."""

from __future__ import annotations

from math import ceil

import numpy as np
from matplotlib.figure import Figure

from planner.arrays import Array
from planner.diagnosis.model_quality import Quality
from planner.report import canvas

PARTS = 40
"""Drawn in a panel."""
COLUMNS = 4
WIDTH_IN = 2.1
SEED = 4


def figure(quality: Quality, outline: Array, jaws: Array) -> Figure:
    """Draws the subspaces.

    Args:
        quality: has the subspaces and the final poses in them.
        outline: (N, 2) the part [mm].
        jaws: (4,) opening, finger length, finger thickness [mm], the upper finger's share of the closing.
    """
    count = len(quality.subspaces)
    columns = min(COLUMNS, count)
    rows = ceil(count / columns)
    reach = float(np.max(np.hypot(*outline.T)))
    held = quality.final[quality.label > 0]
    farthest = float(np.max(np.abs(held[:, :2]), initial=0.5 * float(jaws[0])))
    half = farthest + reach + 2.0
    result = Figure(
        figsize=(columns * WIDTH_IN + 0.35, rows * (WIDTH_IN + 0.3) + 0.3), facecolor="white",
        layout="constrained",
    )  # fmt: skip
    grid = result.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    rng = np.random.default_rng(SEED)
    for k, axes in enumerate(grid.flat):
        if k >= count:
            axes.remove()
            continue
        axes.set_gid(f"subspace-{k}")
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.tick_params(labelsize=7.0)
        poses = quality.final[quality.label == k]
        chosen = poses[rng.permutation(len(poses))[:PARTS]]
        canvas.polygons(axes, canvas.outlines(outline, chosen), canvas.BLUE, 0.4)
        boxes = canvas.finger_boxes(jaws, float(quality.subspaces.mean_mm[k]))
        canvas.polygons(axes, boxes, canvas.RED, 1.3, 3.0)
        axes.set_title(f"{chr(97 + k)}  {name(quality, k)}", fontsize=8.0, pad=4.0)
    result.supxlabel("x / mm, along the fingers", fontsize=8.0)
    result.supylabel("y / mm, closing", fontsize=8.0)
    return result


def name(quality: Quality, k: int) -> str:
    """What a subspace is called: the widths in it, and its share of the roll-outs."""
    subspaces = quality.subspaces
    share = f"{subspaces.size[k] / max(subspaces.size.sum(), 1):.0%}"
    if k == 0:
        return f"free space, {share}"
    return f"{subspaces.low_mm[k]:.1f} to {subspaces.high_mm[k]:.1f} mm, {share}"
