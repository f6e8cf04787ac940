"""A compiled table as a tree of panels, after the paper's Figs 2 and 6: for a page, or a picture of its own.

Every node shows the belief when it is reached, as outlines whose overlap darkens, and the fingers of the
squeeze that led there, at their expected width. Arrow heads close along the next squeeze. Leaves, framed,
show the predicted pose. Lengths are pixels; each panel is a small view of the world in mm, so that a browser
draws the part once and places it wherever a pose says.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluation.evaluate import placement_of
from planner.frames import to_world
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.report import canvas
from planner.report.layout import Sizes, Spot, tidy
from planner.report.replay import Replay, replay
from planner.report.templating import template
from runtime.shell.files import writing
from runtime.table import Leaf, Node, Table

PANEL = 64.0
EDGE = 8.0
DARKNESS = 0.7
"""Of the place that all outlines of a panel cover."""
MOST = 40
"""Most outlines in one panel."""
BUDGET = 4000
"""Outlines that a page draws at once without a wait; shared by all panels."""
TRIALS = 20_000


class Style(NamedTuple):
    """Which way a tree grows.

    Attributes:
        sideways: the root on the left, for trees that are too wide with it on top.
        sizes: of what stands beside each other.
        gap: between a panel and its children [px].
        bus: how far from a panel its branches part [px].
    """

    sideways: bool
    sizes: Sizes
    gap: float
    bus: float


DOWNWARDS = Style(False, Sizes(panel=0.5 * PANEL, label=29.0, text=29.0, margin=6.0), 53.0, 14.0)
SIDEWAYS = Style(True, Sizes(panel=0.5 * PANEL, label=12.0, text=23.0, margin=3.0), 71.0, 8.0)


class Label(NamedTuple):
    """Where text stands [px], and its SVG anchor."""

    x: float
    y: float
    anchor: str = "middle"


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
        lines: text: the angle of the hand, or the leaf's pose and success.
        text: where it begins [px], and its anchor.
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
    text: Label
    predicted: str


class Line(NamedTuple):
    """One branch: `key` is that of the panel it leads to; `x`, `y` are the place of its interval [px]."""

    key: str
    path: str
    width: float
    x: float
    y: float
    interval: str
    share: str
    share_y: float


class Drawing(NamedTuple):
    """A whole tree [px]; `reach` is half the side of what a panel shows [mm]."""

    width: float
    height: float
    reach: float
    panels: list[Panel]
    lines: list[Line]


def drawing(table: Table, job: Job, beliefs: Replay, style: Style = DOWNWARDS) -> Drawing:
    """Arranges a table's panels.

    Args:
        table: any.
        job: the job it was compiled from.
        beliefs: of the same table.
        style: which way it grows.
    """
    panels = _TreePanels(table, job, beliefs, style)
    along = panels.layout.rows * (PANEL + style.gap) + 2 * EDGE
    across = panels.layout.width + 2 * EDGE
    return Drawing(
        width=along if style.sideways else across,
        height=across if style.sideways else along,
        reach=panels.reach,
        panels=[*panels.node_panels(), *panels.leaf_panels()],
        lines=panels.lines(),
    )


def picture(table: Table, job: Job, beliefs: Replay, style: Style = DOWNWARDS) -> str:
    """The tree as an SVG of its own, with a legend; arguments as of `drawing`."""
    return template("tree.svg").render(
        table=table, drawing=drawing(table, job, beliefs, style), part=points(job.part.outline_mm),
        colors=vars(canvas),
    )  # fmt: skip


def draw(table: Table, job: Job, path: Path, trials: int = TRIALS, seed: int = 0) -> None:
    """Draws a table.

    Args:
        table: any.
        job: the job it was compiled from.
        path: the picture; ends in .svg.
        trials: parts sent through the table, to find the beliefs.
        seed: of these.
    """
    text = picture(table, job, replay(table, job, trials, seed))
    with writing(path) as file:
        file.write_text(text, encoding="utf-8")


def transform(pose: Array) -> str:
    """A pose [mm, mm, rad] as an SVG transform; the picture's y axis points up."""
    x, y, turn = pose
    return f"translate({x:.2f} {y:.2f})rotate({np.degrees(turn):.1f})"


def points(shape: Array) -> str:
    """Vertices (n, 2) as SVG points."""
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in shape)


def in_world(boxes: Array, node: Node) -> Array:
    """Boxes (2, 4, 2) from the frame of a node's hand to the world."""
    flat = np.concatenate([boxes, np.zeros((2, 4, 1))], axis=-1)
    return to_world(flat, placement_of(node.squeeze))[..., :2]


class _TreePanels:
    """What the panels of one table have in common."""

    def __init__(self, table: Table, job: Job, beliefs: Replay, style: Style) -> None:
        self.table, self.beliefs, self.style = table, beliefs, style
        self.layout = tidy(table, style.sizes)
        self.jaws = jaws_of(job.gripper)
        self.parent = {
            branch.target: (index, number)
            for index, node in enumerate(table.nodes)
            for number, branch in enumerate(node.branches)
        }
        self.reach = self._reach(job.part.outline_mm)
        self.most = max(1, min(MOST, BUDGET // (len(table.nodes) + len(table.leaves))))
        self.trials = len(beliefs.visits[0].before)

    def node_panels(self) -> list[Panel]:
        """One panel a node."""
        panels = []
        for index, (node, spot) in enumerate(zip(self.table.nodes, self.layout.nodes, strict=True)):
            angle = float(np.degrees(node.squeeze.angle_urad / 1e6))
            arrivals = self.beliefs.visits[index].before
            seen = percent(len(arrivals) / self.trials)
            label = f"Node {index}: squeeze at {angle:.0f} degrees, {len(node.branches)} outcomes, {seen}"
            x, y = self._corner(spot)
            text = Label(x + 44.0, y + 74.0)
            if self.style.sideways:  # in that lower corner which has no arrow head
                left = np.sin(np.radians(2.0 * angle)) > 0.0
                text = Label(x + 3.0, y + 61.0, "start") if left else Label(x + 61.0, y + 61.0, "end")
            panels.append(
                Panel(
                    f"node-{index}", "node", f"{label} of the parts", x, y, *self._belief(arrivals),
                    self._fingers(index), _arrows(node), [f"{signed(angle, 0)}°"], text, "",
                )
            )  # fmt: skip
        return panels

    def leaf_panels(self) -> list[Panel]:
        """One panel a leaf."""
        panels = []
        for index, (leaf, spot) in enumerate(zip(self.table.leaves, self.layout.leaves, strict=True)):
            x, y = self._corner(spot)
            pose = np.array([leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6])
            lines = leaf_lines(leaf)
            text = Label(x + 32.0, y + 74.0)
            if self.style.sideways:
                text = Label(x + PANEL + 4.0, y + 35.0 - 5.5 * (len(lines) - 1), "start")
            panels.append(
                Panel(
                    f"leaf-{index}", "leaf" if leaf.resolved else "unresolved", leaf_label(index, leaf), x, y,
                    *self._belief(self.beliefs.leaves[index]), self._fingers(~index), [], lines, text,
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
            path, x, y, share_y = self._path(self.layout.nodes[index], child)
            interval = f"{branch.low_um / 1e3:.1f}\N{EN DASH}{branch.high_um / 1e3:.1f}"
            key = f"node-{target}" if target >= 0 else f"leaf-{~target}"
            found.append(Line(key, path, 0.8 + 3.0 * share, x, y, interval, percent(share), share_y))
        return found

    def _path(self, spot: Spot, child: Spot) -> tuple[str, float, float, float]:
        """The line from a panel to a child; x and y of what it says, and y of the share below that."""
        (x0, y0), (x1, y1), bus = self._middle(spot), self._middle(child), self.style.bus
        if self.style.sideways:
            x0, x1 = x0 + 0.5 * PANEL, x1 - 0.5 * PANEL
            path = f"M{x0:.1f} {y0:.1f}H{x0 + bus:.1f}V{y1:.1f}H{x1:.1f}"
            return path, 0.5 * (x0 + bus + x1), y1 - 4.0, y1 + 11.0
        y0, y1 = y0 + 0.5 * PANEL, y1 - 0.5 * PANEL
        return f"M{x0:.1f} {y0:.1f}V{y0 + bus:.1f}H{x1:.1f}V{y1:.1f}", x1, y0 + bus + 13.0, y0 + bus + 24.0

    def _belief(self, poses: Array) -> tuple[list[str], float]:
        poses = subsample(poses, self.most)
        opacity = round(1.0 - (1.0 - DARKNESS) ** (1.0 / max(len(poses), 1)), 4)
        return [transform(pose) for pose in poses], opacity

    def _fingers(self, target: int) -> list[str]:
        return [points(box) for box in self._boxes(target)] if target in self.parent else []

    def _boxes(self, target: int) -> Array:
        """The fingers (2, 4, 2) in the world after the squeeze that leads to a target."""
        index, number = self.parent[target]
        node = self.table.nodes[index]
        return in_world(canvas.finger_boxes(self.jaws, node.branches[number].expected_um / 1e3), node)

    def _reach(self, outline: Array) -> float:
        """Half the side of a square in the world that holds nearly all beliefs and closed fingers [mm]."""
        spread = np.hypot(*self.beliefs.visits[0].before[:, :2].T)
        reach = float(np.quantile(spread, 0.9)) + float(np.max(np.hypot(*outline.T)))
        return 1.03 * max(reach, *(float(np.max(np.abs(self._boxes(target)))) for target in self.parent))

    def _middle(self, spot: Spot) -> tuple[float, float]:
        along = EDGE + spot.depth * (PANEL + self.style.gap) + 0.5 * PANEL
        return (along, EDGE + spot.x) if self.style.sideways else (EDGE + spot.x, along)

    def _corner(self, spot: Spot) -> tuple[float, float]:
        x, y = self._middle(spot)
        return round(x - 0.5 * PANEL, 1), round(y - 0.5 * PANEL, 1)


def leaf_label(index: int, leaf: Leaf) -> str:
    """A leaf in words."""
    if not leaf.resolved:
        return f"Leaf {index}: unresolved, {leaf.trials} trials ended here"
    x, y, turn = leaf.x_um / 1e3, leaf.y_um / 1e3, np.degrees(leaf.theta_urad / 1e6)
    place = f"Leaf {index}: part at {x:.1f}, {y:.1f} mm, {turn:.0f} degrees"
    success = "untried" if leaf.success is None else f"success {100 * leaf.success:.2f} percent"
    return f"{place}; {success}"


def leaf_lines(leaf: Leaf) -> list[str]:
    """What stands at a leaf."""
    if not leaf.resolved:
        return ["unresolved", f"of {leaf.trials}" if leaf.trials else "untried"]
    place = f"{signed(leaf.x_um / 1e3)}, {signed(leaf.y_um / 1e3)}"
    lines = [place, f"{signed(float(np.degrees(leaf.theta_urad / 1e6)))}°"]
    if leaf.success is None:
        return [*lines, "untried"]
    return [*lines, f"{100 * leaf.success:.1f} %", f"of {leaf.trials}"]


def percent(share: float) -> str:
    """A share of all parts, with a digit more where it is small."""
    if 0.0 < share < 0.001:
        return "< 0.1 %"
    return f"{100 * share:.1f} %" if share < 0.0995 else f"{100 * share:.0f} %"


def signed(value: float, digits: int = 1) -> str:
    """A rounded number, with a minus sign of the right length and no negative zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _arrows(node: Node) -> list[str]:
    """Two arrow heads that close along the squeeze."""
    angle = node.squeeze.angle_urad / 1e6
    along = np.array([-np.sin(angle), np.cos(angle)])  # the hand's y in the world
    across = np.array([along[1], -along[0]])
    rim = min(0.5 * PANEL / np.max(np.abs(along)), 0.66 * PANEL) - 2.5
    heads = np.array([(rim - 7.0) * along, rim * along + 3.5 * across, rim * along - 3.5 * across])
    return [points(side * heads * (1.0, -1.0)) for side in (1.0, -1.0)]
