"""Seconds of trials by the table's model of time, from their paths.

Parts follow one another: the hand starts from where it left the previous part.
"""

import numpy as np

from planner.arrays import Array, IntArray
from runtime.table import GripperSpec, Schedule, Squeezed, Table, job_of


def seconds_of(table: Table, path: IntArray, reading: IntArray, branch: IntArray) -> Array:
    """Seconds (n,) of trials of a table.

    Args:
        table: the table that the trials ran.
        path: (n, d) the nodes passed, in order, then negative.
        reading: (n, d) what was read at each of them, as `Evaluation.reading`.
        branch: (n, d) the branch taken at each of them, negative for none.
    """
    schedule, (trials, depth) = Schedule.of(table, job_of(table)), path.shape
    result, rows = np.zeros(trials), np.arange(trials)
    squeezes = (path >= 0).sum(axis=1)
    last = rows, np.maximum(squeezes - 1, 0)
    states = np.stack([path, np.where(path >= 0, reading >> 1, -1), branch], axis=2)
    # For each part, the latest part before it that was squeezed, at its last squeeze.
    came = np.maximum.accumulate(np.where(squeezes > 0, rows, -1))
    before = np.roll(states[last][came], 1, axis=0)
    before[:, 1] = 0  # how wide the jaws held it no longer matters: they are open by now
    for k in range(depth):
        here = np.flatnonzero(squeezes > k)
        if not len(here):
            break
        after = np.where(squeezes[here] > k + 1, path[here, min(k + 1, depth - 1)], -1)
        keys = np.column_stack([before[here], states[here, k], after])
        each, inverse = np.unique(keys, axis=0, return_inverse=True)  # each of them is timed once
        times = [_seconds(schedule, table.gripper, key, first=k == 0) for key in each.tolist()]
        result[here] += np.array(times)[inverse.ravel()]
        before[here] = states[here, k]
    return result


def _seconds(schedule: Schedule, gripper: GripperSpec, key: list[int], *, first: bool) -> float:
    """Seconds that one squeeze of a part takes; 0 if there is none.

    Args:
        schedule: times the motions of the arm and the jaws.
        gripper: converts steps to a width.
        key: node, steps and branch of the squeeze before, the same of this one, and the part's next node;
            a negative node stands for none.
        first: whether this is the first squeeze of its part, so that the one before is of another part.
    """
    came, current, after = _squeezed(gripper, key[:3]), _squeezed(gripper, key[3:6]), key[6]
    if came is None or current is None:
        return 0.0
    node = None if after < 0 else after
    following = None if first else current.node
    _, stands, jaws_s = schedule.squeeze(came, None, following, first=True)
    phases, *_ = schedule.squeeze(current, stands, node, 0.0 if first else jaws_s, first=first)
    return phases.total_s


def _squeezed(gripper: GripperSpec, state: list[int]) -> Squeezed | None:
    node, steps, branch = state
    width_mm = gripper.profile.reading_um(gripper.steps - steps) / 1e3
    return None if node < 0 else Squeezed(node, width_mm, branch)
