"""Computes how long trials take, from their paths through the table and by the table's model of time.

The trials follow one another: for each part, the hand starts where it left the previous part.
"""

from functools import cache

import numpy as np

from planner.arrays import Array, IntArray
from runtime.table import Schedule, Squeezed, Table, job_of


def seconds_of(table: Table, path: IntArray, reading: IntArray, branch: IntArray) -> Array:
    """The durations (n,) of trials of a table [s].

    Args:
        table: the table that the trials ran.
        path: (n, d) the nodes passed, in order, then negative numbers.
        reading: (n, d) the reading at each node, as `Evaluation.reading`.
        branch: (n, d) the branch taken at each node, negative for none.
    """
    schedule, gripper, profile = (
        Schedule.of(table, job_of(table)),
        table.gripper,
        table.gripper.profile,
    )

    @cache
    def squeezed(node: int, steps: int, branch: int) -> Squeezed:
        return Squeezed(node, profile.reading_um(gripper.steps - steps) / 1e3, branch)

    @cache  # many parts are squeezed alike
    def squeeze_s(before: Squeezed, now: Squeezed, after: int | None, first: bool) -> float:
        following = None if first else now.node
        _, stands, jaws_s = schedule.squeeze(before, None, following, first=True)
        jaws_s = 0.0 if first else jaws_s
        phases, *_ = schedule.squeeze(now, stands, after, jaws_s, first=first)
        return phases.total_s

    parts = []
    for states in np.stack([path, reading >> 1, branch], axis=2).tolist():
        parts.append([squeezed(*state) for state in states if state[0] >= 0])
    before = next((part[-1] for part in reversed(parts) if part), None)
    seconds = np.zeros(len(parts))
    for number, part in enumerate(parts):
        for k, now in enumerate(part):
            assert before is not None  # some part was squeezed
            # How wide the jaws held the previous part no longer matters: they are open by now.
            before = before._replace(width_mm=0.0) if k == 0 else before
            after = part[k + 1].node if k + 1 < len(part) else None
            seconds[number] += squeeze_s(before, now, after, first=k == 0)
            before = now
    return seconds
