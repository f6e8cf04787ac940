"""A decision tree of scikit-learn as plain arrays, and its predictions from a kernel.

scikit-learn's own `predict` checks and converts its arguments at every call; a belief of some hundred poses
is gone through in less time than that takes. The values are the same, bit by bit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, IntArray
from planner.kernel import kernel

Features = NDArray[np.float32]
"""scikit-learn compares features in single precision; so do we."""


class FlatTree(NamedTuple):
    """A tree of m nodes, the root first.

    Attributes:
        feature: (m,) column that a node tests, -1 at a leaf.
        threshold: (m,) rows whose feature is at most that go left.
        left: (m,) the child on the left.
        right: (m,) the other one.
        value: (m,) what a leaf says.
    """

    feature: IntArray
    threshold: Array
    left: IntArray
    right: IntArray
    value: Array

    @property
    def leaves(self) -> int:
        """How many there are."""
        return int(np.count_nonzero(self.feature < 0))

    def predict(self, features: Features) -> Array:
        """What the tree says of rows (n, columns): (n,)."""
        said = np.empty(len(features))
        _descend(self, features, said)
        return said


def regression(fitted: Any) -> FlatTree:
    """The tree of a fitted `DecisionTreeRegressor` of one output."""
    return _flat(fitted.tree_, fitted.tree_.value[:, 0, 0])


def probability(fitted: Any, label: object) -> FlatTree:
    """The tree of a fitted `DecisionTreeClassifier`; its values are the shares of a label."""
    shares = fitted.tree_.value[:, 0, :]
    column = list(fitted.classes_).index(label)
    return _flat(fitted.tree_, shares[:, column] / shares.sum(axis=1))


def _flat(tree: Any, value: Array) -> FlatTree:
    leaf = tree.children_left < 0
    return FlatTree(
        np.where(leaf, -1, tree.feature).astype(np.int64),
        np.array(tree.threshold, dtype=np.float64),
        tree.children_left.astype(np.int64),
        tree.children_right.astype(np.int64),
        np.array(value, dtype=np.float64),
    )


@kernel
def _descend(tree: FlatTree, features: Features, said: Array) -> None:
    """`FlatTree.predict`; `said` (n,) in place."""
    for i in range(features.shape[0]):
        node = 0
        while tree.feature[node] >= 0:
            if features[i, tree.feature[node]] <= tree.threshold[node]:
                node = tree.left[node]
            else:
                node = tree.right[node]
        said[i] = tree.value[node]
