"""A compiled table as a picture with the root on the left: tall, where the other one is too wide."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from planner.arrays import Array
from planner.job import Job
from planner.report.labels import DIM, degrees, interval, percent
from planner.report.layout import Sizes, Spot, tidy
from planner.report.replay import Replay
from planner.report.tree import EDGE, LEGEND, LEGEND_PX, LINE_PX, PANEL, Page
from runtime.table import Branch, Table

SIZES = Sizes(panel=0.5 * PANEL, label=12.0, text=23.0, margin=3.0)
GAP = 71.0
"""Between columns: the branches part, and say their widths."""
BUS = 8.0
TEXT = 58.0
"""Room for what is written at a leaf of the last column."""


def figure(table: Table, job: Job, beliefs: Replay) -> Figure:
    """The picture; arguments and groups are those of `planner.report.tree.figure`."""
    return SidePage(table, job, beliefs, tidy(table, SIZES)).draw()


class SidePage(Page):
    """The page under way: depth runs to the right, what stands beside each other stands below each other."""

    def measure(self) -> None:
        """Sets how large the page is; the legend stands below the tree."""
        columns = self.layout.rows * (PANEL + GAP) - GAP
        self.width = max(2 * EDGE + columns + TEXT, LEGEND_PX)
        self.left = EDGE
        self.legend_y = 3 * EDGE + self.layout.width
        self.height = self.legend_y + LINE_PX * (len(LEGEND) + 1)

    def middle(self, spot: Spot) -> Array:
        """The middle of a panel on the page."""
        return np.array([self.left + spot.depth * (PANEL + GAP) + 0.5 * PANEL, EDGE + spot.x])

    def draw_angle(self, middle: Array, angle_deg: float) -> None:
        """The hand's angle of the next squeeze, in that lower corner of a panel which has no arrow head."""
        side = -1.0 if np.sin(np.radians(2.0 * angle_deg)) > 0.0 else 1.0
        x = middle[0] + side * (0.5 * PANEL - 3.0)
        self.write(
            x,
            middle[1] + 0.5 * PANEL - 6.5,
            degrees(angle_deg),
            ha="left" if side < 0.0 else "right",
            ground=True,
        )

    def draw_branch(self, spot: Spot, child: Spot, branch: Branch, share: float) -> None:
        """The line to a child, and above and below it what it says."""
        x0, y0 = self.middle(spot)
        x1, y1 = self.middle(child)
        x0, x1 = x0 + 0.5 * PANEL, x1 - 0.5 * PANEL
        self.line([(x0, y0), (x0 + BUS, y0), (x0 + BUS, y1), (x1, y1)], share)
        middle = 0.5 * (x0 + BUS + x1)
        self.write(middle, y1 - 7.5, interval(branch), ha="center")
        self.write(middle, y1 + 7.5, percent(share), DIM, ha="center")

    def draw_leaf_text(self, spot: Spot, lines: list[tuple[str, str]]) -> None:
        """The lines of a leaf, to its right."""
        x, y = self.middle(spot)
        for k, (line, color) in enumerate(lines):
            self.write(x + 0.5 * PANEL + 4.0, y + 11.0 * (k - 0.5 * (len(lines) - 1)), line, color)
