"""A compiled table as one picture, after the paper's Figs 2 and 6.

Every node shows the belief when it is reached, as outlines whose overlap darkens, and the fingers of the
squeeze that led there, at their expected width. Arrow heads close along the next squeeze. Leaves, framed,
show the predicted pose. Lengths on the page are pixels at a hundred to the inch.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, PathPatch, Polygon
from matplotlib.path import Path as Curve
from matplotlib.transforms import Bbox, TransformedBbox

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluate import placement_of
from planner.frames import to_world
from planner.job import Job
from planner.part.outline import simplified
from planner.report import canvas
from planner.report.labels import DIM, degrees, interval, leaf_lines, percent
from planner.report.layout import Layout, Sizes, Spot, tidy
from planner.report.replay import Replay, replay
from runtime.table import PPM, Branch, Node, Table

LINE = "#8c8c8c"
PANEL = 64.0
GAP = 53.0
BUS = 14.0
"""How far below a panel its branches part."""
EDGE = 5.0
FONT_PX = 9.5
LINE_PX = 17.0
SIZES = Sizes(panel=0.5 * PANEL, label=29.0, text=29.0, margin=6.0)
LEGEND = (
    (canvas.BLUE, "belief on arrival, darker where denser"),
    (canvas.RED, "fingers after the squeeze, at their expected width"),
    (canvas.GREEN, "leaf: predicted x, y (mm) and angle; success in its trials"),
    (canvas.BLACK, "arrow heads: how the next squeeze closes; below, the angle of the hand"),
    (LINE, "branch: interval of widths between the fingers (mm), share of all parts"),
)
LEGEND_PX = 480.0
"""Room for the longest line of the legend."""
OUTLINES = 60
"""Most outlines drawn in one panel."""
CORNERS = 1100
"""Most corners of them: an outline of many is drawn less often, which keeps the file small."""
IN_ALL = 4600
"""And most outlines in a picture: one of many panels draws fewer in each."""
SHARPNESS_PX = 0.25
"""How far an outline that is drawn may be from the true one."""
DARKNESS = 0.7
"""Of the place that all outlines of a panel cover."""
TRIALS = 20_000


def draw(table: Table, job: Job, path: Path, trials: int = TRIALS, seed: int = 0) -> None:
    """Draws a table.

    Args:
        table: canonical.
        job: the job it was compiled from.
        path: the picture; ends in .png, .svg or .pdf.
        trials: parts sent through the table, to find the beliefs.
        seed: of these.
    """
    with canvas.style():
        canvas.save(figure(table, job, replay(table, job, trials, seed)), path)


def figure(table: Table, job: Job, beliefs: Replay) -> Figure:
    """The picture; each panel is a group named `node-3` or `leaf-0` in an SVG."""
    return Page(table, job, beliefs, tidy(table, SIZES)).draw()


class Page:
    """The page under way, the root on top: one pair of axes in pixels, y downwards."""

    def __init__(self, table: Table, job: Job, beliefs: Replay, layout: Layout) -> None:
        self.table, self.beliefs, self.layout = table, beliefs, layout
        self.jaws = canvas.jaws_of(job)
        self.scale = 0.5 * PANEL / reach(table, job.part.outline_mm, self.jaws, beliefs)  # px per mm
        self.outline = simplified(job.part.outline_mm, SHARPNESS_PX / self.scale)
        panels = len(table.nodes) + len(table.leaves)
        self.most = max(min(OUTLINES, CORNERS // len(self.outline), IN_ALL // panels), 1)
        self.left = self.width = self.height = self.legend_y = 0.0
        self.measure()
        self.figure = Figure(figsize=(self.width / 100, self.height / 100), facecolor="white")
        self.axes: Axes = self.figure.add_axes((0, 0, 1, 1), xlim=(0, self.width), ylim=(self.height, 0))
        self.axes.set_axis_off()

    def measure(self) -> None:
        """Sets how large the page is, where the tree begins and where the legend."""
        layout = self.layout
        self.width = max(2 * EDGE + layout.width, LEGEND_PX)
        self.left = 0.5 * (self.width - layout.width)
        self.legend_y = EDGE + (layout.rows - 1) * (PANEL + GAP)
        last = [spot.x for spot in (*layout.nodes, *layout.leaves) if spot.depth == layout.rows - 1]
        if self.left + min(last) - 0.5 * PANEL < LEGEND_PX:  # no room beside the last row
            self.legend_y += PANEL + GAP
        lines = LINE_PX * (len(LEGEND) + 1)
        self.height = max(EDGE + layout.rows * (PANEL + GAP), self.legend_y + lines)

    def draw(self) -> Figure:
        """Draws all of it."""
        self.draw_nodes()
        self.draw_leaves()
        self.draw_legend()
        return self.figure

    def draw_nodes(self) -> None:
        """All nodes, each with the branches that leave it."""
        trials = len(self.beliefs.visits[0].before)
        self._belief("node-0", self.layout.nodes[0], self.beliefs.visits[0].before)
        for node, spot, visit in zip(self.table.nodes, self.layout.nodes, self.beliefs.visits, strict=True):
            self._frame(spot, canvas.PALE, 0.7, "solid")
            self._next_squeeze(spot, node)
            for number, branch in enumerate(node.branches):
                poses, target = visit.through(number), branch.target
                child = self.layout.nodes[target] if target >= 0 else self.layout.leaves[~target]
                self.draw_branch(spot, child, branch, len(poses) / trials)
                self._belief(f"node-{target}" if target >= 0 else f"leaf-{~target}", child, poses)
                self._fingers(child, node, branch)

    def draw_leaves(self) -> None:
        """The predicted poses, framed, with their figures below."""
        for leaf, spot in zip(self.table.leaves, self.layout.leaves, strict=True):
            if leaf.resolved:
                pose = np.array([[leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6]])
                self._polygon(spot, canvas.outlines(self.outline, pose)[0], canvas.GREEN, 1.0, 0.0, 4)
                self._frame(spot, canvas.GREEN, 1.6, "solid")
            else:
                self._frame(spot, LINE, 1.2, "dashed")
            self.draw_leaf_text(spot, leaf_lines(leaf, self.table.goal.symmetry))

    def draw_legend(self) -> None:
        """What the signs mean, and how good the whole is."""
        predicted = self.table.predicted
        total = (
            f"{len(self.table.nodes)} squeezes planned, {predicted.mean_squeezes_ppm / PPM:.2f} a part on "
            f"average; success {100 * predicted.success_ppm / PPM:.2f} %, "
            f"rejected {100 * predicted.reject_ppm / PPM:.2f} % of {predicted.trials}"
        )
        for k, (color, text) in enumerate((*LEGEND, ("", total))):
            y = self.legend_y + LINE_PX * (k + 0.5)
            self.write(EDGE + 17, y, text)
            if color:
                self._sign(y, color)

    def _sign(self, y: float, color: str) -> None:
        """A line, an arrow head or a swatch, at the left of a line of the legend."""
        if color == LINE:
            self.axes.plot([EDGE + 1, EDGE + 11], [y, y], color=color, linewidth=2.0)
        elif color == canvas.BLACK:
            head = np.array([(EDGE + 9, y), (EDGE + 3, y - 3), (EDGE + 3, y + 3)])
            self.axes.add_patch(Polygon(head, facecolor=color, edgecolor="none"))
        else:
            swatch = FancyBboxPatch((EDGE + 1, y - 4), 10, 8, boxstyle="round,pad=0,rounding_size=1.5")
            swatch.set(facecolor=to_rgba(color, 0.25), edgecolor=color, linewidth=0.9)
            self.axes.add_patch(swatch)

    def _belief(self, name: str, spot: Spot, poses: Array) -> None:
        """A sample of the poses, so transparent that full overlap looks alike in all panels."""
        poses = subsample(poses, self.most)
        fill = 1.0 - (1.0 - DARKNESS) ** (1.0 / max(len(poses), 1))
        parts = PolyCollection(
            list(self._at(spot, canvas.outlines(self.outline, poses))),
            facecolors=to_rgba(canvas.BLUE, fill), edgecolors=to_rgba(canvas.BLUE, min(0.8, 4.0 * fill)),
            linewidths=0.35, zorder=2, gid=name,
        )  # fmt: skip
        self.axes.add_collection(parts, autolim=False)
        x, y = self._corner(spot)
        parts.set_clip_box(TransformedBbox(Bbox([[x, y], [x + PANEL, y + PANEL]]), self.axes.transData))

    def _fingers(self, spot: Spot, node: Node, branch: Branch) -> None:
        boxes = canvas.finger_boxes(self.jaws, branch.expected_um / 1e3)
        for box in in_world(boxes, node):
            self._polygon(spot, box, canvas.RED, 0.8, 0.2, 3)

    def _frame(self, spot: Spot, color: str, width: float, dashes: str) -> None:
        frame = FancyBboxPatch(self._corner(spot), PANEL, PANEL, boxstyle="round,pad=0,rounding_size=3")
        frame.set(fill=False, edgecolor=color, linewidth=width, linestyle=dashes, zorder=5)
        self.axes.add_patch(frame)

    def _next_squeeze(self, spot: Spot, node: Node) -> None:
        """Two arrow heads that close along the next squeeze, and below them the hand's angle."""
        angle = node.squeeze.angle_urad / 1e6
        along = np.array([-np.sin(angle), np.cos(angle)])  # the hand's y in the world
        across = np.array([along[1], -along[0]])
        middle = self.middle(spot)
        rim = min(0.5 * PANEL / np.max(np.abs(along)), 0.66 * PANEL) - 2.5
        for side in (1.0, -1.0):
            head = side * np.array(
                [(rim - 6.0) * along, rim * along + 3.0 * across, rim * along - 3.0 * across]
            )
            self.axes.add_patch(
                Polygon(middle + head * (1.0, -1.0), facecolor=canvas.BLACK, edgecolor="none", zorder=6)
            )
        self.draw_angle(middle, float(np.degrees(angle)))

    def draw_angle(self, middle: Array, angle_deg: float) -> None:
        """The hand's angle of the next squeeze, below the middle of a panel."""
        self.write(middle[0] + 4.0, middle[1] + 0.5 * (PANEL + BUS), degrees(angle_deg))

    def draw_branch(self, spot: Spot, child: Spot, branch: Branch, share: float) -> None:
        """The line to a child, and what it says."""
        x0, y0 = self.middle(spot)
        x1, y1 = self.middle(child)
        y0, y1 = y0 + 0.5 * PANEL, y1 - 0.5 * PANEL
        self.line([(x0, y0), (x0, y0 + BUS), (x1, y0 + BUS), (x1, y1)], share)
        self.write(x1, y0 + BUS + 10.0, interval(branch), ha="center", ground=True)
        self.write(x1, y0 + BUS + 21.0, percent(share), DIM, ha="center", ground=True)

    def line(self, points: list[tuple[float, float]], share: float) -> None:
        """A line as thick as the share of parts that takes it."""
        line = PathPatch(Curve(points), fill=False, zorder=1)
        line.set(edgecolor=LINE, linewidth=0.6 + 3.0 * share, joinstyle="round", capstyle="butt")
        self.axes.add_patch(line)

    def draw_leaf_text(self, spot: Spot, lines: list[tuple[str, str]]) -> None:
        """The lines of a leaf, each with its colour."""
        x, y = self.middle(spot)
        for k, (line, color) in enumerate(lines):
            self.write(x, y + 0.5 * PANEL + 9.0 + 11.0 * k, line, color, ha="center")

    def _polygon(
        self, spot: Spot, points: Array, color: str, width: float, opacity: float, zorder: float
    ) -> None:
        polygon = Polygon(self._at(spot, points), edgecolor=color, linewidth=width, zorder=zorder)
        polygon.set_facecolor(to_rgba(color, opacity))
        self.axes.add_patch(polygon)

    def write(
        self, x: float, y: float, text: str, color: str = canvas.BLACK, ha: str = "left",
        zorder: float = 5, ground: bool = False,
    ) -> None:  # fmt: skip
        """Text at the middle of its height; on white ground where a line runs behind it."""
        written = self.axes.text(x, y, text, color=color, fontsize=0.72 * FONT_PX, zorder=zorder)
        written.set(ha=ha, va="center_baseline")
        if ground:
            written.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8})

    def middle(self, spot: Spot) -> Array:
        """The middle of a panel on the page."""
        return np.array([self.left + spot.x, EDGE + spot.depth * (PANEL + GAP) + 0.5 * PANEL])

    def _corner(self, spot: Spot) -> tuple[float, float]:
        x, y = self.middle(spot) - 0.5 * PANEL
        return float(x), float(y)

    def _at(self, spot: Spot, points: Array) -> Array:
        """Points of the world (..., 2) on the page, in a panel."""
        return np.asarray(self.middle(spot) + self.scale * points * np.array([1.0, -1.0]))


def in_world(boxes: Array, node: Node) -> Array:
    """Boxes (2, 4, 2) from the frame of a node's hand to the world."""
    return to_world(np.concatenate([boxes, np.zeros((2, 4, 1))], axis=-1), placement_of(node.squeeze))[
        ..., :2
    ]


def reach(table: Table, outline: Array, jaws: Array, beliefs: Replay) -> float:
    """Half the side of a square in the world that holds nearly all beliefs and all closed fingers [mm]."""
    part = float(np.max(np.hypot(*outline.T)))
    reach = float(np.quantile(np.hypot(*beliefs.visits[0].before[:, :2].T), 0.9)) + part
    for node in table.nodes:
        for branch in node.branches:
            boxes = in_world(canvas.finger_boxes(jaws, branch.expected_um / 1e3), node)
            reach = max(reach, float(np.max(np.abs(boxes))))
    return 1.03 * reach
