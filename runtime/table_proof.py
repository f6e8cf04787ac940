"""The proof of a table: every reason not to execute it, looked for at every write and every read."""

from math import exp, log, sqrt

from runtime.errors import TableError
from runtime.table_header import prove_header, within
from runtime.table_lookup import REJECT, Calibration, decisions, won
from runtime.table_model import HELD_UM, PPM, GoalSpec, Leaf, Limits, Node, Table
from runtime.table_values import prove_types, prove_values

WILSON_Z = 1.959964  # two-sided 95 %
LEVEL = 0.025
MOST_TERMS = 1000
LEAST_LOG = -700.0  # exp of less is zero


def prove(table: Table) -> None:
    """Check that a table may be executed.

    Raises:
        TableError: naming the first node, branch, leaf or field that is wrong.
    """
    prove_header(table)
    prove_types(table)
    prove_read(table)


def prove_read(table: Table) -> None:
    """As `prove`, for a table that was read from a file and is therefore made of integers.

    Raises:
        TableError: as `prove`.
    """
    prove_header(table)
    prove_values(table)
    prove_shape(table)
    prove_order(table.nodes)
    _prove_shares(table.nodes)
    _prove_readable(table.nodes, Calibration.linear(table.gripper))
    for index, leaf in enumerate(table.leaves):
        if leaf.resolved:
            _prove_resolved(index, leaf, table.goal, table.limits)


def prove_shape(table: Table) -> None:
    """Check that the targets, each in its range, form one tree: all reached exactly once, depth bounded.

    Raises:
        TableError: naming the first node or leaf that is reached twice, never, or too deep.
    """
    nodes_reached = [False] * len(table.nodes)
    leaves_reached = [False] * len(table.leaves)
    nodes_reached[0] = True
    level, depth = [0], 0
    while level:
        depth += 1
        if depth > table.limits.max_depth:
            raise TableError(f"node {level[0]} is deeper than limits.max_depth = {table.limits.max_depth}")
        deeper = []
        for index in level:
            for number, branch in enumerate(table.nodes[index].branches):
                reached, target = (
                    (nodes_reached, branch.target) if branch.target >= 0 else (leaves_reached, ~branch.target)
                )
                if reached[target]:
                    kind = "node" if branch.target >= 0 else "leaf"
                    raise TableError(
                        f"node {index}, branch {number}: {kind} {target} is reached a second time"
                    )
                reached[target] = True
                if branch.target >= 0:
                    deeper.append(target)
        level = deeper
    for reached, kind in ((nodes_reached, "node"), (leaves_reached, "leaf")):
        if not all(reached):
            raise TableError(f"{kind} {reached.index(False)} is never reached")


def wilson_upper(successes: float, trials: int) -> float:
    """Upper end of the 95 % Wilson score interval of a share; 1 without trials."""
    if trials == 0:
        return 1.0
    share, z2 = successes / trials, WILSON_Z**2
    spread = WILSON_Z * sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    return (share + z2 / (2 * trials) + spread) / (1 + z2 / trials)


def refuted(successes: int, trials: int, confidence: float) -> bool:
    """Whether trials speak against a success probability of at least `confidence`, at the 2.5 % level.

    Exact binomial test (Clopper and Pearson 1934) where its sum is short; Wilson's interval for more misses
    than that, where the two agree. Thin leaves need the exact one: one miss in ten trials refutes nothing.
    """
    misses, log_none = trials - successes, trials * log(confidence)
    if misses > MOST_TERMS or log_none < LEAST_LOG:
        return wilson_upper(successes, trials) < confidence
    term, fewer = exp(log_none), 0.0  # probability of k misses, and of fewer than `misses`
    for k in range(misses):
        fewer += term
        term *= (trials - k) / (k + 1) * (1.0 - confidence) / confidence
    return 1.0 - fewer < LEVEL


def prove_order(nodes: tuple[Node, ...]) -> None:
    """Check that the low and the expected widths of a node's branches rise, each within its interval.

    Raises:
        TableError: naming the first branch that is out of order.
    """
    for index, node in enumerate(nodes):
        least, below = 0, -1
        for number, (low, expected, high, _, _) in enumerate(node.branches):
            if not (least <= low <= expected <= high and below < expected):
                at = f"node {index}, branch {number}"
                within(f"{at}: low_um", low, least, high)
                within(f"{at}: expected_um", expected, max(low, below + 1), high)
            least, below = low, expected


def _prove_shares(nodes: tuple[Node, ...]) -> None:
    for index, node in enumerate(nodes):
        total = sum([branch[3] for branch in node.branches])
        if abs(total - PPM) > len(node.branches):
            raise TableError(f"node {index}: the branches' probabilities sum to {total} ppm, not {PPM}")


def _prove_readable(nodes: tuple[Node, ...], calibration: Calibration) -> None:
    """Check that every branch is what some reading means."""
    for index, node in enumerate(nodes):
        for number in unreadable(node, calibration):
            branch = node.branches[number]
            interval = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
            raise TableError(f"node {index}, branch {number}: no encoder count means {interval}; widen it")


def unreadable(node: Node, calibration: Calibration) -> list[int]:
    """The branches of a node that no reading means, so that they could never be taken.

    Args:
        node: the node.
        calibration: counts to widths.
    """
    ranges = won(node.branches)
    if ranges is None:
        readable = set(decisions(node, calibration)) - {REJECT}
        return [number for number in range(len(node.branches)) if number not in readable]
    missing = []
    for number, (least, greatest) in enumerate(ranges):
        if least <= 0 and node.branches[number].expected_um >= HELD_UM:
            least = 1  # a grip is never read where the jaws are fully closed
        if not calibration.means(least, greatest):
            missing.append(number)
    return missing


def _prove_resolved(index: int, leaf: Leaf, goal: GoalSpec, limits: Limits) -> None:
    x_min, y_min, x_max, y_max = limits.work_area_um
    for x, y, _ in (leaf[:3], *leaf.alternatives):
        if not (x_min <= x <= x_max and y_min <= y <= y_max):
            within(f"leaf {index}: x_um", x, x_min, x_max)
            within(f"leaf {index}: y_um", y, y_min, y_max)
    poses = 1 + len(leaf.alternatives)
    allowed = goal.modes if goal.kind == "modes" else 1
    if poses > allowed:
        raise TableError(
            f"leaf {index}: {poses} poses where the goal leaves {allowed} open; mark it unresolved"
        )
    if leaf.success_ppm >= goal.confidence_ppm:
        return
    hits = round(leaf.success_ppm / PPM * leaf.trials)
    if refuted(hits, leaf.trials, goal.confidence_ppm / PPM):
        raise TableError(
            f"leaf {index}: {leaf.success_ppm / PPM:.4f} of {leaf.trials} trials met the goal, which refutes "
            f"the confidence of {goal.confidence_ppm / PPM:.4f}; mark it unresolved or plan deeper"
        )
