"""A world of a few poses on a line, so small that a test can list the results of all plans."""

from functools import cache

import numpy as np

from planner.belief.metric import Metric

SPACING_MM = 2.5
METRIC = Metric(3.0, 10.0, 1)
REACH = 3
"""Number of neighbouring poses that one prediction locates: they are less than 6 mm apart."""


class Toy:
    """A world in which a part lies at one of a few numbered poses, and each action squeezes the part.

    Attributes:
        after: (actions, poses) number of the pose to which each action moves a part from each pose.
        reading: (actions, poses) reading of each action if the part lies at each pose.
    """

    def __init__(self, after, reading):
        self.after, self.reading = np.array(after), np.array(reading)
        self.actions, self.size = self.after.shape

    @classmethod
    def drawn(cls, rng, actions, size, readings):
        """Draws a random world of `size` poses, whose readings are integers from 0 to `readings - 1`."""
        return cls(*(rng.integers(most, size=(actions, size)) for most in (size, readings)))

    def squeeze(self, parts, placements, rng):
        """Squeezes parts; returns the poses (n, 3) after the squeeze, and the readings (n,).

        Has the type `planner.bound.histories.Squeeze`. The x of a placement is the number of an action.
        """
        state = np.rint(parts.poses[:, 0] / SPACING_MM).astype(int)
        action = np.rint(placements[:, 0]).astype(int)
        return poses_of(self.after[action, state]), self.reading[action, state]

    def placements(self, history):
        """Returns the placements (actions, 3) of all actions, whatever the history."""
        return np.column_stack([np.arange(self.actions), np.zeros((self.actions, 2))])

    def outcomes(self, squeezes, least_share=0.0, granted=False):
        """Returns the results of all plans of at most `squeezes` squeezes, as (squeezes, parts not located).

        Each plan is applied to as many parts as there are poses, one at each pose. The result counts all
        their squeezes, and those parts that are not located. A plan states a pose only if this locates at
        least a share `least_share` of the parts with the same readings. If `granted`, a plan may
        give the parts that are left after the last squeeze one more squeeze each, which locates them.
        """

        @cache
        def after(states, left, first=False):
            result = set() if first else {(0, len(states))}  # no claim: nothing is located
            located = max(sum(k <= s < k + REACH for s in states) for k in states)
            if located >= least_share * len(states) and not first:
                result.add((0, len(states) - located))
            if left == 0:
                return frozenset(result | ({(len(states), 0)} if granted else set()))
            for action in range(self.actions):
                total = {(len(states), 0)}
                for reading in {int(self.reading[action, s]) for s in states}:
                    alike = [s for s in states if self.reading[action, s] == reading]
                    here = [int(self.after[action, s]) for s in alike]
                    further = after(tuple(sorted(here)), left - 1)
                    total = {(a + c, b + d) for a, b in total for c, d in further}
                result |= total
            return frozenset(result)

        return after(tuple(range(self.size)), squeezes, first=True)

    def least(self, success, squeezes, **options):
        """Returns the least mean number of squeezes of a plan that locates a share `success` of all parts.

        The plan has at most `squeezes` squeezes; without such a plan, the result is infinite. `options` go to
        `outcomes`.
        """
        most = (1.0 - success) * self.size + 1e-9
        plans = self.outcomes(squeezes, **options)
        means = [cost / self.size for cost, missed in plans if missed <= most]
        return min(means, default=np.inf)


def poses_of(states):
    """Returns the poses (n, 3) whose numbers are `states` (n,)."""
    states = np.asarray(states, float)
    return np.column_stack([SPACING_MM * states, np.zeros((len(states), 2))])
