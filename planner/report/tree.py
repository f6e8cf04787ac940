"""A compiled table as a tree of panels, after the paper's Figs 2 and 6: for a page, or as a picture.

Every node shows its belief on arrival and the fingers of the squeeze that led there; arrow heads point
along the next squeeze. Lengths are pixels; each panel is a small view of the world in mm. The tree is tidy
(Reingold and Tilford, 1981): every depth has two slots, the panels and the gap below them, so that labels
in the gap (the branches of a node, the text of a leaf) do not overlap either.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluation.trials import placement_of
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.part.outline import reach
from planner.report import canvas
from planner.report.canvas import template
from planner.report.replay import Replay
from runtime.table import Leaf, Table, predicted_pose


class Sizes(NamedTuple):
    """Half widths of the elements of a tree, and the least distance between neighbours."""

    panel: float  # half the width of a panel
    label: float  # half the width of a branch's label
    text: float  # half the width of a leaf's text
    margin: float  # least distance between two of these


class Spot(NamedTuple):
    """A panel's place: the middle along its row, and its depth in the tree from 0."""

    x: float
    depth: int


class Layout(NamedTuple):
    """The places of all panels."""

    spots: dict[int, Spot]  # by target: a node, or ~leaf
    rows: int  # number of depths
    width: float  # extent of the whole, from 0


@dataclass(slots=True)
class _Subtree:
    """A node or leaf with the subtrees below it; all positions are relative to the middle of its panel."""

    target: int
    contour: dict[int, tuple[float, float]]  # least and greatest place used in each slot
    children: list[tuple[float, "_Subtree"]] = field(default_factory=list)  # with their places


def tidy(table: Table, sizes: Sizes) -> Layout:
    """Places the panels of a table."""
    root = _subtree(table, 0, 0, sizes)
    left = min(low for low, _ in root.contour.values())
    right = max(high for _, high in root.contour.values())
    spots: dict[int, Spot] = {}
    waiting = [(root, Spot(-left, 0))]
    while waiting:
        subtree, spot = waiting.pop()
        spots[subtree.target] = spot
        waiting.extend((child, Spot(spot.x + x, spot.depth + 1)) for x, child in subtree.children)
    return Layout(spots, 1 + max(spot.depth for spot in spots.values()), right - left)


def _subtree(table: Table, target: int, depth: int, sizes: Sizes) -> _Subtree:
    panel = {2 * depth: (-sizes.panel, sizes.panel)}
    if target < 0:
        return _Subtree(target, panel | {2 * depth + 1: (-sizes.text, sizes.text)})
    targets = (branch.target for branch in table.nodes[target].branches)
    children = [_subtree(table, below, depth + 1, sizes) for below in targets]
    xs, merged = _row(children, sizes.margin)
    middle = 0.5 * (xs[0] + xs[-1])
    contour = {slot: (low - middle, high - middle) for slot, (low, high) in merged.items()}
    first, last = xs[0] - middle, xs[-1] - middle
    contour |= panel | {2 * depth + 1: (first - sizes.label, last + sizes.label)}
    placed = [(x - middle, child) for x, child in zip(xs, children, strict=True)]
    return _Subtree(target, contour, placed)


def _row(
    subtrees: list[_Subtree], margin: float
) -> tuple[list[float], dict[int, tuple[float, float]]]:
    """Packs subtrees side by side without overlap; returns their positions and their common contour."""
    xs: list[float] = []
    merged: dict[int, tuple[float, float]] = {}
    for subtree in subtrees:
        shared = merged.keys() & subtree.contour.keys()
        ends = (merged[slot][1] - subtree.contour[slot][0] + margin for slot in shared)
        x = max(ends, default=0.0)
        xs.append(x)
        for slot, (low, high) in subtree.contour.items():
            held = merged.get(slot, (low + x, high + x))
            merged[slot] = (min(held[0], low + x), max(held[1], high + x))
    return xs, merged


PANEL = 64.0
EDGE = 8.0
MOST = 40  # most outlines in one panel
NAME = 11  # most characters of a part's name below a leaf
BUDGET = 4000  # outlines that a page draws without delay; shared by all panels
NOTHING = np.empty((0, 3, 2))


class Style(NamedTuple):
    """Direction of growth and sizes of a tree; lengths in pixels."""

    sideways: bool  # the root on the left, for trees that are too wide otherwise
    sizes: Sizes  # of panels beside each other
    gap: float  # between a panel and its children
    bus: float  # distance from a panel at which its branches separate


DOWNWARDS = Style(False, Sizes(panel=0.5 * PANEL, label=29.0, text=29.0, margin=6.0), 53.0, 14.0)
SIDEWAYS = Style(True, Sizes(panel=0.5 * PANEL, label=12.0, text=23.0, margin=3.0), 71.0, 8.0)


class Panel(NamedTuple):
    """A node or a leaf as it is drawn in the picture of a tree."""

    key: str  # "node-3" or "leaf-0"
    kind: str  # "node", "leaf", "untried" or "unresolved"
    label: str  # alternative text
    x: float  # left edge [px]
    y: float  # upper edge [px]
    poses: Array  # (m, 3) of the outlines [mm, mm, rad], or (m, 4) with their hypotheses
    opacity: float  # of one outline; full overlap looks alike in all panels
    fingers: Array  # (0 or 2, 4, 2) of the squeeze that led here [mm]
    lines: list[str]  # text: the angle of the hand, or the leaf's pose and success
    text: tuple[float, float, str]  # where it begins [px, from the corner], and its SVG anchor
    arrows: Array = NOTHING  # (0 or 2, 3, 2) of a node's squeeze [px, from the middle]
    predicted: Array | None = None  # a resolved leaf's pose and hypothesis (4,) [mm, mm, rad, -]


class Line(NamedTuple):
    """One branch, as a line between two panels."""

    key: str  # of the panel it leads to
    path: str  # SVG path of the line
    width: float  # of the line [px]
    x: float  # place of both texts [px]
    y: float  # place of the text `interval` [px]
    interval: str  # text: the widths of the branch
    share: str  # text: the share of all parts that take the branch
    share_y: float  # place of the text `share` [px]


class Drawing(NamedTuple):
    """A whole tree [px]; `reach` is half the side of a panel [mm]."""

    width: float
    height: float
    reach: float
    panels: list[Panel]
    lines: list[Line]


def drawing(table: Table, job: Job, beliefs: Replay, style: Style = DOWNWARDS) -> Drawing:
    """Lays out the tree of a table; its panels show the poses of the replayed parts `beliefs`."""
    tree = _Tree(table, job, beliefs, style)
    along = tree.layout.rows * (PANEL + style.gap) + 2 * EDGE
    across = tree.layout.width + 2 * EDGE
    width, height = (along, across) if style.sideways else (across, along)
    panels = [*map(tree.node, range(len(table.nodes))), *map(tree.leaf, range(len(table.leaves)))]
    lines = [tree.line(*step) for step in tree.parent.items()]
    return Drawing(width, height, tree.reach, panels, lines)


def picture(table: Table, job: Job, beliefs: Replay, style: Style = DOWNWARDS) -> str:
    """The tree as a standalone SVG with a legend; arguments as for `drawing`."""
    return template("tree.svg").render(
        table=table,
        drawing=drawing(table, job, beliefs, style),
        colors=vars(canvas),
        outlines=[alone.part.outline_mm for alone in job.alone],
    )


class _Tree:
    """Builds the panels and lines of a table's tree; a target is a node's index, or ~index of a leaf."""

    def __init__(self, table: Table, job: Job, beliefs: Replay, style: Style) -> None:
        self.table, self.beliefs, self.style = table, beliefs, style
        self.layout = tidy(table, style.sizes)
        self.jaws = jaws_of(job.gripper)
        self.parent = {
            branch.target: (index, number)
            for index, node in enumerate(table.nodes)
            for number, branch in enumerate(node.branches)
        }
        self.trials = len(beliefs.visits[0].before)
        self.most = max(1, min(MOST, BUDGET // (len(table.nodes) + len(table.leaves))))
        # Half the side of a square in the world that contains nearly all beliefs and closed fingers
        # [mm].
        spread = float(np.quantile(np.hypot(*beliefs.visits[0].before[:, :2].T), 0.9))
        farthest = spread + max(reach(alone.part.outline_mm) for alone in job.alone)
        fingers = (float(np.abs(self._fingers(target)).max()) for target in self.parent)
        self.reach = 1.03 * max(farthest, *fingers)

    def node(self, index: int) -> Panel:
        node, arrivals = self.table.nodes[index], self.beliefs.arrivals[index]
        angle = float(np.degrees(node.squeeze.angle_urad / 1e6))
        seen = f"{percent(len(arrivals) / self.trials)} of the parts"
        pushed = {0: "", 1: "a push, "}.get(len(node.pushes), f"{len(node.pushes)} pushes, ")
        label = f"Node {index}: {pushed}squeeze at {angle:.0f} degrees, {len(node.branches)} outcomes, {seen}"
        text = (44.0, 74.0, "middle")
        if self.style.sideways:  # in the lower corner without an arrow head
            left = np.sin(np.radians(2.0 * angle)) > 0.0
            text = (3.0, 61.0, "start") if left else (61.0, 61.0, "end")
        lines = [f"{pushed}{signed(angle, 0)}°"]
        panel = self._panel(index, "node", label, arrivals, lines, text)
        return panel._replace(arrows=_arrows(np.radians(angle)))

    def leaf(self, index: int) -> Panel:
        leaf, poses = self.table.leaves[index], self.beliefs.leaves[index]
        name = self.table.name_of(leaf) if names_parts(self.table) else None
        posed = self.table.goal.kind != "identity"
        lines = leaf_lines(leaf, name, posed)
        text = (32.0, 74.0, "middle")
        if self.style.sideways:
            text = (PANEL + 4.0, 35.0 - 5.5 * (len(lines) - 1), "start")
        kind = ("leaf" if leaf.trials else "untried") if leaf.resolved else "unresolved"
        pose = np.array([*predicted_pose(leaf), leaf.hypothesis])
        panel = self._panel(~index, kind, leaf_label(index, leaf, name, posed), poses, lines, text)
        return panel._replace(predicted=pose if leaf.resolved and posed else None)

    def line(self, target: int, step: tuple[int, int]) -> Line:
        index, number = step
        branch = self.table.nodes[index].branches[number]
        share = len(self.beliefs.visits[index].through(number)) / self.trials
        interval = f"{branch.low_um / 1e3:.1f}\N{EN DASH}{branch.high_um / 1e3:.1f}"
        (x0, y0), (x1, y1), bus = self._middle(index), self._middle(target), self.style.bus
        if self.style.sideways:
            x0, x1 = x0 + 0.5 * PANEL, x1 - 0.5 * PANEL
            path = f"M{x0:.1f} {y0:.1f}H{x0 + bus:.1f}V{y1:.1f}H{x1:.1f}"
            x, y, share_y = 0.5 * (x0 + bus + x1), y1 - 4.0, y1 + 11.0
        else:
            y0, y1 = y0 + 0.5 * PANEL, y1 - 0.5 * PANEL
            path = f"M{x0:.1f} {y0:.1f}V{y0 + bus:.1f}H{x1:.1f}V{y1:.1f}"
            x, y, share_y = x1, y0 + bus + 13.0, y0 + bus + 24.0
        key, width = key_of(target), 0.8 + 3.0 * share
        return Line(key, path, width, x, y, interval, percent(share), share_y)

    def _panel(
        self,
        target: int,
        kind: str,
        label: str,
        poses: Array,
        lines: list[str],
        text: tuple[float, float, str],
    ) -> Panel:
        x, y = (round(middle - 0.5 * PANEL, 1) for middle in self._middle(target))
        shown = subsample(poses, self.most)
        opacity = round(canvas.overlay_opacity(len(shown), canvas.DARKNESS), 4)
        fingers = self._fingers(target) if target in self.parent else NOTHING
        return Panel(key_of(target), kind, label, x, y, shown, opacity, fingers, lines, text)

    def _fingers(self, target: int) -> Array:
        """The fingers (2, 4, 2) in the world after the squeeze that leads to the node or leaf `target`."""
        index, number = self.parent[target]
        node = self.table.nodes[index]
        boxes = canvas.finger_boxes(self.jaws, node.branches[number].expected_um / 1e3)
        return canvas.placed(boxes, placement_of(node.squeeze))

    def _middle(self, target: int) -> tuple[float, float]:
        spot = self.layout.spots[target]
        along = EDGE + spot.depth * (PANEL + self.style.gap) + 0.5 * PANEL
        return (along, EDGE + spot.x) if self.style.sideways else (EDGE + spot.x, along)


def names_parts(table: Table) -> bool:
    """Whether a table has several hypotheses, and its goal requires that leaves name the part."""
    return bool(table.hypotheses) and table.goal.identify


def leaf_label(index: int, leaf: Leaf, name: str | None = None, posed: bool = True) -> str:
    """A leaf in words.

    Args:
        index: number of the leaf.
        leaf: the leaf.
        name: name of the part that the leaf states; None if it states none.
        posed: whether the goal asks for a pose, so that the text states the leaf's pose.
    """
    if not leaf.resolved:
        return f"Leaf {index}: unresolved, {leaf.trials} trials ended here"
    x, y, turn = predicted_pose(leaf)
    pose = f" at {x:.1f}, {y:.1f} mm, {np.degrees(turn):.0f} degrees" if posed else ""
    place = f"Leaf {index}: {name or 'part'}{pose}"
    success = "untried" if leaf.success is None else f"success {100 * leaf.success:.2f} percent"
    return f"{place}; {success}"


def leaf_lines(leaf: Leaf, name: str | None = None, posed: bool = True) -> list[str]:
    """The text at a leaf, at most four lines; arguments as for `leaf_label`."""
    if not leaf.resolved:
        return ["unresolved", f"of {leaf.trials}" if leaf.trials else "untried"]
    x, y, turn = predicted_pose(leaf)
    lines = [f"{signed(x)}, {signed(y)}", f"{signed(float(np.degrees(turn)))}°"] if posed else []
    if name is not None:
        lines.insert(0, name if len(name) <= NAME else f"{name[: NAME - 1]}…")
    if leaf.success is None:
        return [*lines, "untried"]
    lines.append(f"{100 * leaf.success:.1f} %")
    return lines if len(lines) == 4 else [*lines, f"of {leaf.trials}"]


def percent(share: float) -> str:
    """Formats a share in percent; only a share of exactly 0 or 1 is shown as 0 % or 100 %."""
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    digits = next((n for n in (1, 2, 3) if 0.0 < round(100 * share, n) < 100.0), 4)
    return f"{100 * share:.{digits}f} %" if share < 0.1 or share > 0.9 else f"{100 * share:.0f} %"


def signed(value: float, digits: int = 1) -> str:
    """Formats a rounded number with a typographic minus sign and no negative zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def key_of(target: int) -> str:
    """The id of a node's or leaf's panel."""
    return f"node-{target}" if target >= 0 else f"leaf-{~target}"


def _arrows(angle: float) -> Array:
    """Two arrow heads (2, 3, 2) that point along the squeeze of a hand at an angle [px, y down]."""
    along = np.array([-np.sin(angle), np.cos(angle)])  # the hand's y in the world
    across = np.array([along[1], -along[0]])
    rim = min(0.5 * PANEL / np.max(np.abs(along)), 0.66 * PANEL) - 2.5
    heads = np.array([(rim - 7.0) * along, rim * along + 3.5 * across, rim * along - 3.5 * across])
    return np.stack([heads, -heads]) * (1.0, -1.0)
