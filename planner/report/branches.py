"""A table as nested branches for a page: each node and leaf with its picture and figures."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from planner.evaluation.expectation import bins_of
from planner.job.model import Job
from planner.report.replay import Replay
from planner.report.run_log import RunLog
from planner.report.tree import Line, Panel, drawing, key_of, names_parts, percent, signed
from runtime.pages.charts import Band, histogram
from runtime.table import PPM, REJECT, Branch, Leaf, Node, Table, wilson_interval

MOST_SHOWN = 24  # most panels that a page shows at first
MARGIN_MM = 3.0  # margin beside the branches in the chart of a node
# Subtrees that fewer parts reach are folded away: the first of these shares at which `MOST_SHOWN` suffices.
LEAST_SHARES = (0.0, 0.001, 0.005, 0.01, 0.03, 0.1, 0.3)


class Way(NamedTuple):
    """One branch of a node: its widths, the panel it leads to and how many parts took it."""

    key: str  # key of the panel that the branch leads to
    low_mm: float
    high_mm: float
    planned: float  # share of the parts at the node that the table expects to take it
    parts: int  # parts that took it: in the cell if its journal is shown, else in the replay


class Place(NamedTuple):
    """A node or a leaf as a page shows it, with the subtrees below it."""

    panel: Panel
    line: Line | None  # branch that leads to it; None for the root
    came: str  # how many of the journal's parts came here; "" without a journal
    parent: str | None  # key of the panel above; None for the root
    facts: dict[str, str]  # texts about the node or leaf, by their headings
    chart: str  # HTML: chart of the readings at a node
    ways: list[Way]
    heavy: "list[Place]"  # subtrees that are shown
    light: "list[Place]"  # subtrees that are folded away, since few parts get there

    @property
    def light_words(self) -> str:
        """Text for the number of subtrees that are folded away."""
        shares = [place.line.share for place in self.light if place.line]
        return f"1 more, {shares[0]}" if len(shares) == 1 else f"{len(shares)} more"


class Tree(NamedTuple):
    """All nodes and leaves of a table, nested for a page."""

    root: Place
    places: list[Place]  # nodes, then leaves
    reach: float  # half the side of a panel [mm]
    levels: int  # depth of the tree that is shown, in panels


def tree_of(table: Table, job: Job, beliefs: Replay, log: RunLog | None) -> Tree:
    """Nests the nodes and leaves of a table; with `log`, also counts the journal's parts at each of them."""
    return _Places(table, job, beliefs, log).tree()


class _Places:
    def __init__(self, table: Table, job: Job, beliefs: Replay, log: RunLog | None) -> None:
        self.table, self.job, self.beliefs = table, job, beliefs
        self.counts = None if log is None else log.branch_counts()
        self.drawing = drawing(table, job, beliefs)
        self.panels = {panel.key: panel for panel in self.drawing.panels}
        self.lines = {line.key: line for line in self.drawing.lines}
        self.trials = len(beliefs.visits[0].before)
        self.least = next((s for s in LEAST_SHARES if self._shown(0, s) <= MOST_SHOWN), 1.0)

    def tree(self) -> Tree:
        root = self._place(0, None, "")
        places = {place.panel.key: place for place in _all(root)}
        ordered = [places[panel.key] for panel in self.drawing.panels]
        return Tree(root, ordered, self.drawing.reach, _levels(root))

    def _visits(self, target: int) -> int:
        here = self.beliefs.arrivals[target] if target >= 0 else self.beliefs.leaves[~target]
        return len(here)

    def _shown(self, target: int, least: float) -> int:
        below = self.table.nodes[target].branches if target >= 0 else ()
        heavy = (b.target for b in below if self._visits(b.target) >= least * self.trials)
        return 1 + sum(self._shown(target, least) for target in heavy)

    def _place(self, target: int, parent: str | None, came: str) -> Place:
        key = key_of(target)
        panel, line = self.panels[key], self.lines.get(key)
        if target < 0:
            facts = self._leaf_facts(~target, came)
            return Place(panel, line, came, parent, facts, "", [], [], [])
        node, heavy, light = self.table.nodes[target], list[Place](), list[Place]()
        for branch in node.branches:
            seen = "" if self.counts is None else f"{self.counts[target, branch.target]}\u00d7"
            place = self._place(branch.target, key, seen)
            weighty = self._visits(branch.target) >= self.least * self.trials
            (heavy if weighty else light).append(place)
        ways = [self._way(target, number, branch) for number, branch in enumerate(node.branches)]
        facts, chart = self._node_facts(target, node), self._chart(target, ways)
        return Place(panel, line, came, parent, facts, chart, ways, heavy, light)

    def _way(self, index: int, number: int, branch: Branch) -> Way:
        replayed = int((self.beliefs.visits[index].branch == number).sum())
        parts = replayed if self.counts is None else self.counts[index, branch.target]
        low_mm, high_mm = (round(um / 1e3, 2) for um in (branch.low_um, branch.high_um))
        return Way(key_of(branch.target), low_mm, high_mm, branch.probability_ppm / PPM, parts)

    def _chart(self, index: int, ways: list[Way]) -> str:
        gripper, steps = self.table.gripper, self.beliefs.visits[index].steps
        read = Counter(bins_of(self.table, steps).tolist())
        low, high = span_of(ways)
        bin_mm = gripper.opening_um / gripper.bins / 1e3
        widths = [(bin_mm * number, n) for number, n in sorted(read.items())]
        counts = [(width, n) for width, n in widths if low <= width <= high]
        bands = [Band(way.low_mm, way.high_mm, str(k)) for k, way in enumerate(ways)]
        label = "Widths read in the replay"
        return histogram(label, counts, bands, (low, high), "mm")

    def _node_facts(self, index: int, node: Node) -> dict[str, str]:
        squeeze = node.squeeze
        opening, clearance = squeeze.opening_um / 1e3, squeeze.clearance_um / 1e3
        visits = self._visits(index)
        rejected = int((self.beliefs.visits[index].branch == REJECT).sum())
        facts = {
            "hand": _pose_text(squeeze.x_um, squeeze.y_um, squeeze.angle_urad),
            "opening": f"{opening:.2f} mm, {clearance:.2f} mm clear of the parts",
            "closes": f"with {squeeze.force_mn / 1e3:.0f} N at {squeeze.speed_um_s / 1e3:.0f} mm/s",
            "parts here": f"{visits} of {self.trials} replayed ({percent(visits / self.trials)})",
            "rejected here": str(rejected if self.counts is None else self.counts[index, None]),
        }
        if node.release:
            facts["dragged to"] = ", ".join(f"{um / 1e3:.2f}" for um in node.release) + " mm"
        for number, push in enumerate(node.pushes, 1):
            start = f"from {push.x_um / 1e3:.2f}, {push.y_um / 1e3:.2f} mm"
            way = f"{push.length_um / 1e3:.2f} mm along {_degrees(push.angle_urad)}"
            facts[f"push {number}"] = f"{start}, {way}, jaws {push.opening_um / 1e3:.2f} mm"
        return facts

    def _leaf_facts(self, index: int, came: str) -> dict[str, str]:
        leaf, visits = self.table.leaves[index], self._visits(~index)
        posed = self.table.goal.kind != "identity"
        facts = {"says": self._says(leaf, posed)}
        if posed:
            facts |= self._pose_facts(leaf)
        success = round(leaf.success_ppm * leaf.trials / PPM)
        low, high = wilson_interval(success, leaf.trials)
        facts["success"] = "untried"
        if leaf.trials:
            share = leaf.success_ppm / PPM
            facts["success"] = f"{share:.2%} of {leaf.trials} (95 %: {low:.2%} to {high:.2%})"
        facts["parts here"] = f"{visits} of {self.trials} replayed"
        return facts | ({"in the cell": came} if came else {})

    def _says(self, leaf: Leaf, posed: bool) -> str:
        if not leaf.resolved:
            return "unresolved: it does not know"
        if names_parts(self.table):
            return f"{'located' if posed else 'named'}: {self.table.name_of(leaf)}"
        return "the part is located"

    def _pose_facts(self, leaf: Leaf) -> dict[str, str]:
        x, y, turn = leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6
        facts = {"pose": _pose_text(leaf.x_um, leaf.y_um, leaf.theta_urad)}
        part = self.job.alone[leaf.hypothesis].part
        if part.datum is not None:
            dx, dy, angle = part.datum
            at = complex(x, y) + np.exp(1j * turn) * complex(dx, dy)
            degrees = signed(float(np.degrees(turn) + angle))
            facts["datum"] = f"{at.real:.2f}, {at.imag:.2f} mm, {degrees}°"
        spread = np.sqrt(np.maximum([leaf.covariance.xx, leaf.covariance.yy], 0)) / 10
        angle = np.degrees(np.sqrt(max(leaf.covariance.tt, 0)) / 100)
        facts["spread"] = f"{spread[0]:.2f}, {spread[1]:.2f} mm, {angle:.1f}°"
        for number, pose in enumerate(leaf.alternatives):
            place = f"or at ({number + 1})" if number else "or at"
            facts[place] = _pose_text(pose.x_um, pose.y_um, pose.theta_urad)
        return facts


def span_of(ways: list[Way]) -> tuple[float, float]:
    """Least and greatest width of a node's chart [mm]: the widths of the branches `ways`, with a margin."""
    low, high = min(way.low_mm for way in ways), max(way.high_mm for way in ways)
    return max(low - MARGIN_MM, 0.0), high + MARGIN_MM


def _all(place: Place) -> list[Place]:
    return [place, *(p for below in (*place.heavy, *place.light) for p in _all(below))]


def _levels(place: Place) -> int:
    return 1 + max(map(_levels, place.heavy), default=0)


def _pose_text(x_um: int, y_um: int, angle_urad: int) -> str:
    return f"{x_um / 1e3:.2f}, {y_um / 1e3:.2f} mm, {_degrees(angle_urad)}"


def _degrees(urad: int) -> str:
    return f"{signed(float(np.degrees(urad / 1e6)))}°"
