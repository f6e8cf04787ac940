"""The one form of a table that has a file: breadth-first numbers, values on the file's grid."""

from dataclasses import replace
from math import isqrt

from runtime.errors import TableError
from runtime.table_grid import (
    WidthGrid,
    angle_number,
    angle_urad,
    correlation_number,
    covariance,
    failures,
    near,
    spread,
    spread_number,
    spread_number_below,
    success_ppm,
)
from runtime.table_header import prove_header
from runtime.table_model import (
    CLEARANCE_GRID_UM,
    POSE_GRID_UM,
    PPM,
    SHARE_GRID_PPM,
    Branch,
    GripperSpec,
    Leaf,
    Node,
    Squeeze,
    Table,
)
from runtime.table_proof import prove_order, prove_shape
from runtime.table_values import prove_types, prove_values

# Shares that were rounded to ppm one by one miss the whole by less than this.
SUM_TOLERANCE_PPM = 1000
Pose = tuple[int, int, int]


def canonical(table: Table) -> Table:
    """Put a table into the form its file will give back.

    `loads(dumps(table)) == canonical(table)`. Nodes and leaves are numbered breadth first. Intervals end
    midway between two counts and keep the counts they hold on the default line. Rounded are expected widths
    to a quarter of a count, placements and poses to 100 um and a quarter of a degree, shares to 5000 ppm (a
    node's add up to one), variances to a fifth, correlations to an eighth, and clearances down by a fifth at
    most, after what the placement was moved by. Doing it twice changes nothing. A compiler plans on this grid
    and evaluates this form.

    Raises:
        TableError: a value is none, the targets do not form a tree, a node's shares are far from adding up
            to one, or a placement loses its clearance.
    """
    prove_header(table)
    prove_types(table)
    prove_values(table)
    prove_shape(table)
    prove_order(table.nodes)
    node_order, leaf_order = [0], list[int]()
    for index in node_order:  # grows while it is walked: that is the breadth-first order
        for branch in table.nodes[index].branches:
            (node_order if branch.target >= 0 else leaf_order).append(
                branch.target if branch.target >= 0 else ~branch.target
            )
    numbers = {old: new for new, old in enumerate(node_order)}
    numbers |= {~old: ~new for new, old in enumerate(leaf_order)}
    gripper, grid = table.gripper, WidthGrid.of(table.gripper)
    return replace(
        table,
        nodes=tuple(_node(old, table.nodes[old], numbers, gripper, grid) for old in node_order),
        leaves=tuple(_leaf(table.leaves[old]) for old in leaf_order),
    )


def _node(index: int, node: Node, numbers: dict[int, int], gripper: GripperSpec, grid: WidthGrid) -> Node:
    shares = _shares(index, [branch.probability_ppm for branch in node.branches])
    branches = (
        _branch(branch, share, numbers[branch.target], grid)
        for branch, share in zip(node.branches, shares, strict=True)
    )
    release = node.release and (near(node.release[0], POSE_GRID_UM), near(node.release[1], POSE_GRID_UM))
    return Node(_squeeze(index, node.squeeze, gripper), tuple(branches), release)


def _squeeze(index: int, squeeze: Squeeze, gripper: GripperSpec) -> Squeeze:
    x, y, angle = _pose(squeeze[:3])
    moved = isqrt((x - squeeze.x_um) ** 2 + (y - squeeze.y_um) ** 2)
    turned = abs(angle - squeeze.angle_urad)
    reach = squeeze.opening_um // 2 + gripper.finger_width_um + gripper.finger_length_um // 2
    least = squeeze.clearance_um - moved - -(-turned * reach // PPM)
    if least < 0 < squeeze.clearance_um:
        raise TableError(
            f"node {index}: on the file's grid the open fingers may touch the part; plan on multiples of "
            f"{POSE_GRID_UM} um and 0.25 deg, or with more clearance than {squeeze.clearance_um} um"
        )
    clearance = CLEARANCE_GRID_UM * spread(spread_number_below(max(least, 0) // CLEARANCE_GRID_UM))
    return squeeze._replace(x_um=x, y_um=y, angle_urad=angle, clearance_um=clearance)


def _branch(branch: Branch, share_ppm: int, target: int, grid: WidthGrid) -> Branch:
    low = grid.ends_um[grid.low_number(branch.low_um)]
    high = grid.ends_um[grid.high_number(branch.high_um)]
    expected = grid.expected_um(grid.expected_number(branch.expected_um))
    return Branch(low, min(max(expected, low), high), high, share_ppm, target)


def _leaf(leaf: Leaf) -> Leaf:
    x, y, theta = _pose((leaf.x_um, leaf.y_um, leaf.theta_urad))
    xx, xy, yy, xt, yt, tt = leaf.covariance
    xx, yy, tt = (spread(spread_number(variance)) for variance in (xx, yy, tt))
    return Leaf(
        x_um=x,
        y_um=y,
        theta_urad=theta,
        covariance=(xx, _shared(xy, xx, yy), yy, _shared(xt, xx, tt), _shared(yt, yy, tt), tt),
        success_ppm=success_ppm(failures(leaf.success_ppm, leaf.trials), leaf.trials),
        trials=leaf.trials,
        resolved=leaf.resolved,
        alternatives=tuple(map(_pose, leaf.alternatives)),
    )


def _pose(pose: Pose) -> Pose:
    x, y, theta = pose
    return near(x, POSE_GRID_UM), near(y, POSE_GRID_UM), angle_urad(angle_number(theta))


def _shared(both: int, one: int, other: int) -> int:
    return covariance(correlation_number(both, one, other), one, other)


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
