"""The collision detector: would the open hand come down on the part? By a classification tree (paper V.B).

One tree stands for both fingers and for any opening. It looks at one finger as it descends, a box that starts
at the inner face: where the part's centre lies from the middle of that face, how the part is turned, and
where the box's corners lie in the part's frame. An opening only shifts the face, and half a turn of the hand
makes the lower finger the upper one.

The tree learns from a finger a little larger than the real one, and takes a pose for free only if nearly all
of what it learned about its leaf is. How nearly is chosen on placements of the job, so that hardly any
colliding one passes; the price is false alarms. `exact` is the polygon test beside it, whose verdict the tree
learns. Compiled, it is as fast as the tree for outlines of a few vertices; so the planner goes by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from sklearn.tree import DecisionTreeClassifier

from planner.arrays import Array, BoolArray
from planner.kernel import kernel
from planner.mechanics.clearance import blocked
from planner.mechanics.contacts import place
from planner.paper.flat_tree import Features, FlatTree, probability
from planner.part.outline import min_width

SAMPLES = 120_000
NEAR_SHARE = 0.8
"""Of the samples, near the boundary between free and colliding, where the tree must cut."""
NEAR_MM = (-1.0, 0.8)
"""There, a finger larger by the second collides, and one larger by the first does not."""
LEAF_SIZE = 5
MARGINS_MM = (0.2, 0.3, 0.4, 0.6, 0.8)
"""How much larger the finger is in learning: tried until false alarms no longer become fewer."""
MISSES = 3e-4
"""Share of colliding placements that may pass where the threshold is chosen: a third of the promise."""
VALIDATION = 200_000
DRAWN_AT_ONCE = 400_000


class Confusion(NamedTuple):
    """A detector's verdicts beside the exact ones.

    Attributes:
        free: placements that are free.
        colliding: placements that are not.
        false_alarms: free ones that the detector calls colliding.
        missed: colliding ones that it calls free.
    """

    free: int
    colliding: int
    false_alarms: int
    missed: int

    @property
    def false_alarm_rate(self) -> float:
        """Share of the free placements that are lost."""
        return self.false_alarms / max(self.free, 1)

    @property
    def miss_rate(self) -> float:
        """Share of the colliding placements that pass."""
        return self.missed / max(self.colliding, 1)


@dataclass(frozen=True, slots=True, eq=False)
class CollisionDetector:
    """A classification tree of one finger, asked about both.

    Attributes:
        tree: on the columns of `_features`; its values are the shares of colliding samples.
        threshold: value from which on a pose counts as colliding.
        margin_mm: how much larger the finger was in learning.
        reach_mm: greatest distance of the part's boundary from its centre.
        half_length_mm: half the finger's length.
        thickness_mm: the finger's thickness.
        order: rotational order of the part.
    """

    tree: FlatTree
    threshold: float
    margin_mm: float
    reach_mm: float
    half_length_mm: float
    thickness_mm: float
    order: int

    @classmethod
    def fit(
        cls, outline: Array, jaws: Array, order: int, radius_mm: float, rng: np.random.Generator,
        samples: int = SAMPLES,
    ) -> Self:  # fmt: skip
        """Learns from the exact test.

        Args:
            outline: (N, 2) the part [mm].
            jaws: opening, finger length, finger thickness [mm].
            order: rotational order of the part.
            radius_mm: of the disc of part centres about the hand that the threshold is chosen for.
            rng: source of all randomness.
            samples: poses to learn from.
        """
        half, thickness = 0.5 * float(jaws[1]), float(jaws[2])
        reach = float(np.max(np.hypot(outline[:, 0], outline[:, 1])))
        poses = _near_boundary(outline, half, thickness, reach, order, samples, rng)
        X = _features(poses, half, thickness, order)
        checks = []
        for any_opening in (True, False):
            check = placements(outline, jaws, radius_mm, VALIDATION, rng, any_opening)
            checks.append((*check, exact(outline, float(jaws[1]), thickness, *check)))
        fewest = math.inf
        for margin in MARGINS_MM:
            hits = _stands(outline, poses, half, thickness, margin)
            fitted = DecisionTreeClassifier(min_samples_leaf=LEAF_SIZE, random_state=0).fit(X, hits)
            tree = probability(fitted, True)
            detector, alarms = cls(tree, 0.0, margin, reach, half, thickness, order)._tuned(checks)
            if alarms < fewest:
                best, fewest = detector, alarms
            elif best.threshold > 0.0:
                break
        return best

    def collides(self, poses: Array, opening_mm: Array | float) -> BoolArray:
        """Where a finger would come down on the part, to be on the safe side.

        Args:
            poses: (n, 3) of the part in the hand frame [mm, mm, rad].
            opening_mm: between the inner faces, one for all or (n,).
        """
        return self.score(poses, opening_mm) >= self.threshold

    def score(self, poses: Array, opening_mm: Array | float) -> Array:
        """Share of colliding samples in a pose's leaf, by the worse finger; -1 where none is in reach."""
        worst = np.full(len(poses), -1.0)
        for finger in (1, -1):
            seen = from_finger(poses, opening_mm, finger)
            close = np.flatnonzero(self._in_reach(seen))
            said = self.tree.predict(
                _features(seen[close], self.half_length_mm, self.thickness_mm, self.order)
            )
            worst[close] = np.maximum(worst[close], said)
        return worst

    def judged(self, outline: Array, poses: Array, opening_mm: Array) -> Confusion:
        """How the detector does on placements (n, 3) with openings (n,)."""
        hits = exact(outline, 2.0 * self.half_length_mm, self.thickness_mm, poses, opening_mm)
        said = self.collides(poses, opening_mm)
        return Confusion(
            int(np.count_nonzero(~hits)),
            int(np.count_nonzero(hits)),
            int(np.count_nonzero(said & ~hits)),
            int(np.count_nonzero(hits & ~said)),
        )

    def _in_reach(self, seen: Array) -> BoolArray:
        """Where the circle about the part meets the finger's box, for poses seen from the finger."""
        dx = np.maximum(np.abs(seen[:, 0]) - self.half_length_mm, 0.0)
        middle = 0.5 * self.thickness_mm
        dy = np.maximum(np.abs(seen[:, 1] - middle) - middle, 0.0)
        return np.asarray(np.hypot(dx, dy) <= self.reach_mm)

    def _tuned(self, checks: list[tuple[Array, Array, BoolArray]]) -> tuple[Self, float]:
        """The detector with the greatest threshold that keeps `MISSES`, and the share of false alarms.

        Args:
            checks: placements (n, 3), openings (n,) and where they collide (n,); the worst of them counts.
        """
        scores = [self.score(poses, opening) for poses, opening, _ in checks]
        threshold = math.inf
        for score, (_, _, hits) in zip(scores, checks, strict=True):
            rising = np.sort(score[hits])
            if len(rising):
                threshold = min(threshold, float(rising[int(MISSES * len(rising))]))
        alarms = [
            float(np.mean(score[~hits] >= threshold)) if not hits.all() else 0.0
            for score, (_, _, hits) in zip(scores, checks, strict=True)
        ]
        return replace(self, threshold=threshold), max(alarms)


def placements(
    outline: Array, jaws: Array, radius_mm: float, n: int, rng: np.random.Generator, any_opening: bool = True
) -> tuple[Array, Array]:
    """Draws poses to judge a detector by.

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
        radius_mm: of the disc of part centres about the hand.
        n: how many.
        rng: source of all randomness.
        any_opening: open the jaws to anything from the part's least width on, instead of fully.

    Returns:
        (n, 3) poses in the hand frame, at any angle, and (n,) openings.
    """
    radius, bearing = radius_mm * np.sqrt(rng.random(n)), rng.uniform(-math.pi, math.pi, n)
    turn = rng.uniform(-math.pi, math.pi, n)
    poses = np.column_stack([radius * np.cos(bearing), radius * np.sin(bearing), turn])
    widest = float(jaws[0])
    least = min(min_width(outline), widest) if any_opening else widest
    return poses, rng.uniform(least, widest, n)


def exact(
    outline: Array, finger_length_mm: float, thickness_mm: float, poses: Array, opening_mm: Array | float
) -> BoolArray:
    """Where part and fingers share any area, by polygons.

    Args:
        outline: (N, 2) the part [mm].
        finger_length_mm: along x of the hand frame.
        thickness_mm: the fingers' extent along y.
        poses: (n, 3) in the hand frame [mm, mm, rad].
        opening_mm: between the inner faces, one for all or (n,).

    Returns:
        (n,) True where either finger stands on the part.
    """
    hits = np.zeros(len(poses), np.bool_)
    for finger in (1, -1):
        hits |= _stands(
            outline, from_finger(poses, opening_mm, finger), 0.5 * finger_length_mm, thickness_mm, 0.0
        )
    return hits


def from_finger(poses: Array, opening_mm: Array | float, finger: int) -> Array:
    """Poses (n, 3) seen from the middle of a finger's inner face, the finger extending towards +y.

    Args:
        poses: (n, 3) in the hand frame [mm, mm, rad].
        opening_mm: between the inner faces, one for all or (n,).
        finger: +1 or -1, which is turned by half a turn.
    """
    turn = 0.0 if finger > 0 else math.pi
    return np.column_stack(
        [finger * poses[:, 0], finger * poses[:, 1] - 0.5 * opening_mm, poses[:, 2] + turn]
    )


def _near_boundary(
    outline: Array, half: float, thickness: float, reach: float, order: int, n: int, rng: np.random.Generator
) -> Array:
    """Draws (n, 3) poses seen from a finger, most of them near where free and colliding meet."""
    low = np.array([-half - reach, -reach, 0.0])
    high = np.array([half + reach, thickness + reach, math.tau / order])
    wanted, smaller = int(NEAR_SHARE * n), max(NEAR_MM[0], -0.4 * thickness, -0.8 * half)
    near, others = np.empty((0, 3)), np.empty((0, 3))
    while len(near) < wanted:
        drawn = rng.uniform(low, high, (DRAWN_AT_ONCE, 3))
        outer = _stands(outline, drawn, half, thickness, NEAR_MM[1])
        between = outer & ~_stands(outline, drawn, half, thickness, smaller)
        near, others = np.concatenate([near, drawn[between]]), np.concatenate([others, drawn[~between]])
    return np.concatenate([near[:wanted], others[: n - wanted]])


def _features(seen: Array, half: float, thickness: float, order: int) -> Features:
    """What the tree splits on: the pose seen from the finger, the box's corners in the part's frame."""
    turned = order * seen[:, 2]
    columns = [seen[:, 0], seen[:, 1], np.cos(turned), np.sin(turned)]
    angle = np.mod(seen[:, 2], math.tau / order)
    c, s = np.cos(angle), np.sin(angle)
    for x, y in ((-half, 0.0), (half, 0.0), (-half, thickness), (half, thickness)):
        dx, dy = x - seen[:, 0], y - seen[:, 1]
        columns += [c * dx + s * dy, c * dy - s * dx]
    return np.column_stack(columns).astype(np.float32)


def _stands(outline: Array, seen: Array, half: float, thickness: float, margin: float) -> BoolArray:
    """Where one finger, larger by a margin on all sides, shares any area with the part. (n,)."""
    hits = np.zeros(len(seen), np.bool_)
    n = len(outline)
    _stand(
        outline, np.ascontiguousarray(seen), -margin, half + margin, thickness + 2.0 * margin,
        np.empty((n, 2)), hits,
    )  # fmt: skip
    return hits


@kernel
def _stand(
    outline: Array, seen: Array, face: float, half: float, thickness: float, points: Array, hits: BoolArray
) -> None:
    """`_stands` with a workspace (N, 2); `hits` in place."""
    listed = np.arange(outline.shape[0])
    for k in range(seen.shape[0]):
        place(outline, seen[k], points, listed, outline.shape[0])
        hits[k] = blocked(points, 1, face, half, thickness)
