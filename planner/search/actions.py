"""The actions: where the open hand may be placed."""

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric
from planner.job.model import Job
from planner.search.proposals import Proposals, proposals_of

MAIN_MODES = 2
LEAST_MODE = 0.1
"""Share of the belief below which no placement is proposed about a mode."""


@dataclass(frozen=True, slots=True, eq=False)
class ActionSet:
    """Hand placements to choose from.

    Attributes:
        placements: (k, 3) the fixed ones: the hand frame in the world [mm, mm, rad].
        proposals: those relative to a belief, for each hypothesis; empty for none.
        area: ((x_min, y_min), (x_max, y_max)) that the hand may be placed in.
    """

    placements: Array
    proposals: tuple[Proposals, ...]
    area: Array

    def __len__(self) -> int:
        return len(self.placements)

    def options(self, states: Array, metric: Metric, *, wide: bool = False) -> Array:
        """The fixed placements, those beside them and those about a belief's main modes, within the area.

        Args:
            states: (n, 3 or 4) of the belief [mm, mm, rad, hypothesis].
            metric: of the goal.
            wide: those all about the main modes instead.

        Returns:
            (k, 3); the fixed ones alone where nothing is proposed.
        """
        if not self.proposals:
            return self.placements[: 0 if wide else None]
        modes = metric.main_modes(states, MAIN_MODES, LEAST_MODE)
        modes = [mode for mode in modes if mode.ratio >= LEAST_MODE]
        near = [self.proposals[mode.hypothesis[0]].about(mode.pose, wide=wide) for mode in modes]
        if wide:
            return self.within(np.concatenate([self.placements[:0], *near]))
        beside = max(self.proposals, key=lambda own: len(own.shifts_mm)).beside(self.placements)
        return self.within(np.concatenate([self.placements, beside, *near]))

    def within(self, placements: Array) -> Array:
        """Those of the placements whose hand centre lies in the area."""
        inside = np.all((placements[:, :2] >= self.area[0]) & (placements[:, :2] <= self.area[1]), axis=1)
        return np.asarray(placements[inside])


def actions_of(job: Job) -> ActionSet:
    """Every angle at every centre of the job, in the order stated, and the job's proposals."""
    angles = np.radians(np.array(job.actions.angles_deg))
    centers = job.actions.centers_mm
    grid = [(x, y, angle) for x, y in centers for angle in angles]
    return ActionSet(np.array(grid, dtype=np.float64), proposals_of(job), np.array(job.cell.work_area_mm))
