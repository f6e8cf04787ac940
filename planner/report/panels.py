"""A tree as shapes for a page: panels of outlines and fingers, the lines between them, in pixels.

The same picture as `tree`, but each panel is a small view of the world in mm, so that a browser draws the
part once and places it wherever a pose says.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.job import Job
from planner.report import canvas
from planner.report.labels import percent, signed
from planner.report.layout import Layout, Spot, tidy
from planner.report.replay import Replay
from planner.report.tree import BUS, DARKNESS, GAP, PANEL, SIZES, in_world, reach
from runtime.table import PPM, Leaf, Node, Table

EDGE = 8.0
MOST = 40
"""Most outlines in one panel."""
BUDGET = 4000
"""Outlines that a page draws at once without a wait; shared by all panels."""


class Panel(NamedTuple):
    """One node or leaf.

    Attributes:
        key: "node-3" or "leaf-0".
        kind: "node", "leaf" or "unresolved".
        label: in words, for those who do not see it.
        x: left edge [px].
        y: upper edge [px].
        poses: of the outlines, SVG transforms.
        opacity: of one outline, so that full overlap looks alike in all panels.
        fingers: of the squeeze that led here, SVG points [mm].
        arrows: of the next squeeze, SVG points [px, from the middle].
        lines: text below: the angle of the hand, or the leaf's pose and success.
        predicted: the pose of a leaf, an SVG transform, or "".
    """

    key: str
    kind: str
    label: str
    x: float
    y: float
    poses: list[str]
    opacity: float
    fingers: list[str]
    arrows: list[str]
    lines: list[str]
    predicted: str


class Line(NamedTuple):
    """One branch: `key` is that of the panel it leads to."""

    key: str
    path: str
    width: float
    x: float
    y: float
    interval: str
    share: str


class Drawing(NamedTuple):
    """A whole tree [px]; `reach` is half the side of what a panel shows [mm]."""

    width: float
    height: float
    reach: float
    panels: list[Panel]
    lines: list[Line]


def drawing(table: Table, job: Job, beliefs: Replay) -> Drawing:
    """Arranges a table's panels.

    Args:
        table: canonical.
        job: the job it was compiled from.
        beliefs: of the same table.
    """
    sketch = _Sketch(table, job, beliefs, tidy(table, SIZES))
    return Drawing(
        width=sketch.layout.width + 2 * EDGE,
        height=2 * EDGE + sketch.layout.rows * (PANEL + GAP),
        reach=sketch.reach,
        panels=[*sketch.node_panels(), *sketch.leaf_panels()],
        lines=sketch.lines(),
    )


def transform(pose: Array) -> str:
    """A pose [mm, mm, rad] as an SVG transform; the picture's y axis points up."""
    x, y, turn = pose
    return f"translate({x:.2f} {y:.2f})rotate({np.degrees(turn):.1f})"


def points(shape: Array) -> str:
    """Vertices (n, 2) as SVG points."""
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in shape)


class _Sketch:
    """What the panels of one table have in common."""

    def __init__(self, table: Table, job: Job, beliefs: Replay, layout: Layout) -> None:
        self.table, self.beliefs, self.layout = table, beliefs, layout
        self.jaws = canvas.jaws_of(job)
        self.reach = reach(table, job.part.outline_mm, self.jaws, beliefs)
        self.most = max(1, min(MOST, BUDGET // (len(table.nodes) + len(table.leaves))))
        self.trials = len(beliefs.visits[0].before)
        self.parent = {
            branch.target: (index, number)
            for index, node in enumerate(table.nodes)
            for number, branch in enumerate(node.branches)
        }

    def node_panels(self) -> list[Panel]:
        """One panel a node."""
        panels = []
        for index, (node, spot) in enumerate(zip(self.table.nodes, self.layout.nodes, strict=True)):
            angle = np.degrees(node.squeeze.angle_urad / 1e6)
            arrivals = self.beliefs.visits[index].before
            seen = percent(len(arrivals) / self.trials)
            label = f"Node {index}: squeeze at {angle:.0f} degrees, {len(node.branches)} outcomes, {seen}"
            x, y = _corner(spot)
            panels.append(
                Panel(
                    f"node-{index}", "node", f"{label} of the parts", x, y, *self._belief(arrivals),
                    self._fingers(index), _arrows(node), [f"{angle:.0f}°"], "",
                )
            )  # fmt: skip
        return panels

    def leaf_panels(self) -> list[Panel]:
        """One panel a leaf."""
        panels = []
        for index, (leaf, spot) in enumerate(zip(self.table.leaves, self.layout.leaves, strict=True)):
            x, y = _corner(spot)
            pose = np.array([leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6])
            panels.append(
                Panel(
                    f"leaf-{index}", "leaf" if leaf.resolved else "unresolved", leaf_label(index, leaf), x, y,
                    *self._belief(self.beliefs.leaves[index]), self._fingers(~index), [], leaf_lines(leaf),
                    transform(pose) if leaf.resolved else "",
                )
            )  # fmt: skip
        return panels

    def lines(self) -> list[Line]:
        """All branches."""
        found = []
        for target, (index, number) in self.parent.items():
            branch = self.table.nodes[index].branches[number]
            child = self.layout.nodes[target] if target >= 0 else self.layout.leaves[~target]
            share = len(self.beliefs.visits[index].through(number)) / self.trials
            x0, y0 = _middle(self.layout.nodes[index])
            x1, y1 = _middle(child)
            y0, y1 = y0 + 0.5 * PANEL, y1 - 0.5 * PANEL
            found.append(
                Line(
                    f"node-{target}" if target >= 0 else f"leaf-{~target}",
                    f"M{x0:.1f} {y0:.1f}V{y0 + BUS:.1f}H{x1:.1f}V{y1:.1f}", 0.8 + 3.0 * share, x1, y0 + BUS,
                    f"{branch.low_um / 1e3:.1f}\N{EN DASH}{branch.high_um / 1e3:.1f}", percent(share),
                )
            )  # fmt: skip
        return found

    def _belief(self, poses: Array) -> tuple[list[str], float]:
        poses = subsample(poses, self.most)
        return [transform(pose) for pose in poses], round(
            1.0 - (1.0 - DARKNESS) ** (1.0 / max(len(poses), 1)), 4
        )

    def _fingers(self, target: int) -> list[str]:
        if target not in self.parent:
            return []
        index, number = self.parent[target]
        node = self.table.nodes[index]
        width = node.branches[number].expected_um / 1e3
        return [points(box) for box in in_world(canvas.finger_boxes(self.jaws, width), node)]


def leaf_label(index: int, leaf: Leaf) -> str:
    """A leaf in words."""
    if not leaf.resolved:
        return f"Leaf {index}: unresolved, {leaf.trials} trials ended here"
    x, y, turn = leaf.x_um / 1e3, leaf.y_um / 1e3, np.degrees(leaf.theta_urad / 1e6)
    success = 100 * leaf.success_ppm / PPM
    return f"Leaf {index}: part at {x:.1f}, {y:.1f} mm, {turn:.0f} degrees; success {success:.2f} percent"


def leaf_lines(leaf: Leaf) -> list[str]:
    """What stands below a leaf."""
    if not leaf.resolved:
        return ["unresolved", f"of {leaf.trials}" if leaf.trials else "untried"]
    place = f"{signed(leaf.x_um / 1e3)}, {signed(leaf.y_um / 1e3)}"
    lines = [place, f"{signed(float(np.degrees(leaf.theta_urad / 1e6)))}°"]
    if not leaf.trials:
        return [*lines, "untried"]
    return [*lines, f"{100 * leaf.success_ppm / PPM:.1f} %", f"of {leaf.trials}"]


def _arrows(node: Node) -> list[str]:
    """Two arrow heads that close along the squeeze."""
    angle = node.squeeze.angle_urad / 1e6
    along = np.array([-np.sin(angle), np.cos(angle)])  # the hand's y in the world
    across = np.array([along[1], -along[0]])
    rim = min(0.5 * PANEL / np.max(np.abs(along)), 0.66 * PANEL) - 2.5
    heads = np.array([(rim - 7.0) * along, rim * along + 3.5 * across, rim * along - 3.5 * across])
    return [points(side * heads * (1.0, -1.0)) for side in (1.0, -1.0)]


def _middle(spot: Spot) -> tuple[float, float]:
    return EDGE + spot.x, EDGE + spot.depth * (PANEL + GAP) + 0.5 * PANEL


def _corner(spot: Spot) -> tuple[float, float]:
    x, y = _middle(spot)
    return round(x - 0.5 * PANEL, 1), round(y - 0.5 * PANEL, 1)
