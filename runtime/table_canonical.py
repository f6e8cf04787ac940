"""The one form of a table that has a file: breadth-first numbers, values on the file's grid."""

from runtime.errors import TableError
from runtime.table_model import (
    CLEARANCE_GRID_UM,
    POSE_GRID_UM,
    POSE_GRID_URAD,
    PPM,
    SHARE_GRID_PPM,
    WIDTH_GRID_UM,
    Branch,
    Leaf,
    Node,
    Table,
)
from runtime.table_proof import prove_header, prove_shape

# Shares that were rounded to ppm one by one miss the whole by less than this.
SUM_TOLERANCE_PPM = 1000


def canonical(table: Table) -> Table:
    """Put a table into the form its file will give back.

    `loads(dumps(table)) == canonical(table)`. Nodes and leaves are numbered breadth first; intervals are
    rounded outwards to 50 um, poses to 10 um and 1 mrad, shares to 100 ppm (a node's add up to one), the
    clearance down to 0.1 mm. Doing it twice changes nothing. A compiler should evaluate this form.

    Raises:
        TableError: the targets do not form a tree, or a node's shares are far from adding up to one.
    """
    prove_header(table)
    prove_shape(table)
    node_order, leaf_order = [0], list[int]()
    for index in node_order:  # grows while it is walked: that is the breadth-first order
        for branch in table.nodes[index].branches:
            (node_order if branch.target >= 0 else leaf_order).append(
                branch.target if branch.target >= 0 else ~branch.target
            )
    numbers = {old: new for new, old in enumerate(node_order)}
    numbers |= {~old: ~new for new, old in enumerate(leaf_order)}
    return Table(
        tool=table.tool,
        job_digest=table.job_digest,
        gripper=table.gripper,
        goal=table.goal,
        limits=table.limits,
        nodes=tuple(_node(old, table.nodes[old], numbers) for old in node_order),
        leaves=tuple(_leaf(table.leaves[old]) for old in leaf_order),
        predicted=table.predicted,
        job=table.job,
    )


def _node(index: int, node: Node, numbers: dict[int, int]) -> Node:
    squeeze = node.squeeze._replace(clearance_um=_down(node.squeeze.clearance_um, CLEARANCE_GRID_UM))
    shares = _shares(index, [branch.probability_ppm for branch in node.branches])
    branches = (
        _branch(branch, share, numbers[branch.target])
        for branch, share in zip(node.branches, shares, strict=True)
    )
    return Node(squeeze, tuple(branches))


def _branch(branch: Branch, share_ppm: int, target: int) -> Branch:
    low = _down(branch.low_um, WIDTH_GRID_UM)
    high = -_down(-branch.high_um, WIDTH_GRID_UM)
    return Branch(low, _near(branch.expected_um, WIDTH_GRID_UM), high, share_ppm, target)


def _leaf(leaf: Leaf) -> Leaf:
    return leaf._replace(
        x_um=_near(leaf.x_um, POSE_GRID_UM),
        y_um=_near(leaf.y_um, POSE_GRID_UM),
        theta_urad=_near(leaf.theta_urad, POSE_GRID_URAD),
        success_ppm=_near(leaf.success_ppm, SHARE_GRID_PPM),
    )


def _shares(index: int, parts_ppm: list[int]) -> list[int]:
    """Shares on the grid that add up to one, by the method of the largest remainder."""
    total, units = sum(parts_ppm), PPM // SHARE_GRID_PPM
    if abs(total - PPM) > SUM_TOLERANCE_PPM or min(parts_ppm) < 0:
        raise TableError(f"node {index}: the branches' probabilities {parts_ppm} do not sum to {PPM} ppm")
    whole = [part * units // total for part in parts_ppm]
    by_remainder = sorted(range(len(parts_ppm)), key=lambda at: (-(parts_ppm[at] * units % total), at))
    for at in by_remainder[: units - sum(whole)]:
        whole[at] += 1
    return [share * SHARE_GRID_PPM for share in whole]


def _down(value: int, grid: int) -> int:
    return value // grid * grid


def _near(value: int, grid: int) -> int:
    return (value + grid // 2) // grid * grid
