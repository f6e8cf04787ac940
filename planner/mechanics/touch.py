"""What an ideal squeeze does to a part before any mechanics: touch it, miss it, or come down on it.

Exact and the same for every friction and limit surface, so the learned motion has to answer for the parts
alone that are touched.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel
from planner.mechanics.clearance import blocked, clearance
from planner.mechanics.contacts import place

MISSES = 0
TOUCHES = 1
STANDS_ON = 2


@kernel
def _meet(
    outline: Array, poses: Array, jaws: Array, points: Array, listed: IntArray, verdict: IntArray
) -> None:
    """`meet` with workspaces (N, 2) and (N,); `verdict` (n,) in place."""
    h, top = 0.5 * jaws[1], 0.5 * jaws[0]
    upper, lower = 2.0 * jaws[3], 2.0 * (1.0 - jaws[3])
    for k in range(poses.shape[0]):
        place(outline, poses[k], points, listed, outline.shape[0])
        if blocked(points, 1, top, h, jaws[2]) or blocked(points, -1, -top, h, jaws[2]):
            verdict[k] = STANDS_ON
            continue
        free = np.inf
        if upper > 0.0:
            free = clearance(points, 1, top, h) / upper
        if lower > 0.0:
            free = min(free, clearance(points, -1, -top, h) / lower)
        verdict[k] = TOUCHES if free <= top else MISSES


def meet(outline: Array, jaws: Array, poses: Array) -> IntArray:
    """How closing fingers meet a part.

    Args:
        outline: (N, 2) the part [mm].
        jaws: (4,) opening, finger length, finger thickness [mm], the upper finger's share of the closing.
        poses: (n, 3) in the hand frame [mm, mm, rad].

    Returns:
        (n,) `TOUCHES`; `MISSES` where the fingers meet each other first; `STANDS_ON` where the open fingers
        would come down on the part.
    """
    n = len(outline)
    verdict = np.zeros(len(poses), np.int64)
    _meet(outline, np.ascontiguousarray(poses), jaws, np.empty((n, 2)), np.arange(n), verdict)
    return verdict
