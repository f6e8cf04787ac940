"""Statistics of a table's figures: intervals and tests of shares, and consistency of the figures.

Only another evaluation can show whether a figure is right; but the figures of one evaluation must agree.
"""

from math import erfc, exp, log, sqrt

from runtime.errors import TableError
from runtime.table.model import PPM, GoalSpec, Leaf, Table

Z95 = 1.959963984540054  # two-sided 95 %
LEVEL = 0.025
MOST_TERMS = 1000
LEAST_LOG = -700.0  # exp of less is zero
# Most trials for which a share in ppm identifies the number of successes.
MOST_EXACT_TRIALS = PPM // 2


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % confidence interval of a share of successes (Wilson 1927); [0, 1] without trials."""
    if trials == 0:
        return 0.0, 1.0
    share, z2 = successes / trials, Z95**2
    middle = share + z2 / (2 * trials)
    spread = Z95 * sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    low = (middle - spread) / (1 + z2 / trials) if successes else 0.0
    return low, (middle + spread) / (1 + z2 / trials) if successes < trials else 1.0


def refuted(successes: int, trials: int, confidence: float, leaves: int = 1) -> bool:
    """Whether trials refute a success probability of at least `confidence`, at the 2.5 % level.

    The test is the exact binomial test (Clopper and Pearson 1934) for few misses, and the score test (Wilson
    1927) for many.

    Args:
        successes: number of trials that succeeded.
        trials: number of trials.
        confidence: the probability to refute.
        leaves: number of leaves that are tested; the 2.5 % hold for all of them together (Bonferroni).
    """
    level, misses, log_none = LEVEL / leaves, trials - successes, trials * log(confidence)
    if misses > MOST_TERMS or log_none < LEAST_LOG:
        more = misses - trials * (1.0 - confidence)
        spread = sqrt(2.0 * trials * confidence * (1.0 - confidence))
        return misses > 0 and (spread == 0.0 or 0.5 * erfc(more / spread) < level)
    term, fewer = exp(log_none), 0.0  # probability of k misses, and of fewer than `misses`
    for k in range(misses):
        fewer += term
        term *= (trials - k) / (k + 1) * (1.0 - confidence) / confidence
    return 1.0 - fewer < level


def successes_of(leaf: Leaf) -> int:
    """Number of a leaf's trials that met the goal."""
    return round(leaf.success_ppm * leaf.trials / PPM)


def validate_figures(table: Table) -> None:
    """Checks that the figures of a table can come from one evaluation.

    A leaf's success must be a whole number of trials. If more than half of a leaf's trials met the goal, the
    median of the leaf's errors must not exceed the goal's distance; likewise for the 95th percentile. The
    whole table must not have more successes than its leaves have together, and its shares of success and
    REJECT must not exceed 1 together.

    Raises:
        TableError: a figure contradicts the others; the message names the figure or its leaf.
    """
    for index, leaf in enumerate(table.leaves):
        if 0 < leaf.trials <= MOST_EXACT_TRIALS:
            share = round(PPM * successes_of(leaf) / leaf.trials)
            if abs(share - leaf.success_ppm) > 1:  # halves are rounded either way
                raise TableError(
                    f"leaf {index}: success_ppm is {leaf.success_ppm}, no share of {leaf.trials} trials"
                )
        _validate_errors(index, leaf, table.goal)
    predicted = table.predicted
    if predicted.trials == 0:
        return
    _validate_predicted(table)
    if not any(leaf.trials for leaf in table.leaves):
        return
    # Shares are rounded to a ppm. Leaves that no part of this evaluation reached keep the trials of an
    # earlier one, so that the leaves may have more successes than the whole table, but not fewer.
    slack = 1 + predicted.trials / PPM
    successes = predicted.success_ppm * predicted.trials / PPM
    least, at_leaves = successes - slack, sum(map(successes_of, table.leaves))
    if at_leaves < least:
        raise TableError(
            f"predicted.success_ppm is {predicted.success_ppm}, {round(successes)} of {predicted.trials} "
            f"trials, but only {at_leaves} met the goal at the leaves"
        )


def _validate_predicted(table: Table) -> None:
    """Checks the shares of success and REJECT, and the mean number of squeezes, of the whole table.

    Both shares together must be at most 1. The mean must be at least the share of located parts, each of
    which was squeezed, and at most the greatest number of squeezes (`limits.max_depth`).
    """
    predicted = table.predicted
    most_ppm = PPM - predicted.reject_ppm + 1  # both are rounded
    if predicted.success_ppm > most_ppm:
        raise TableError(
            f"predicted.success_ppm is {predicted.success_ppm}, but {predicted.reject_ppm} ppm were rejected"
        )
    # A located part was squeezed; one that an open finger came down on may not have been.
    least, most = predicted.success_ppm, PPM * table.limits.max_depth
    if not least <= predicted.mean_squeezes_ppm <= most:
        raise TableError(
            f"predicted.mean_squeezes_ppm is {predicted.mean_squeezes_ppm}, allowed is {least}..{most}: "
            f"{least} ppm were located, and the tree is {table.limits.max_depth} squeezes deep"
        )


def _validate_errors(index: int, leaf: Leaf, goal: GoalSpec) -> None:
    """Checks that the median and the 95th percentile of a leaf's errors agree with its successes."""
    if goal.kind not in ("pose", "modes") or not leaf.trials:
        return
    successes = successes_of(leaf)
    for name, share in (("error_median_um", 0.5), ("error_p95_um", 0.95)):
        error_um = getattr(leaf, name)
        # The quantile lies between two adjacent errors, both of trials that met the goal.
        if successes >= share * (leaf.trials - 1) + 2 and error_um > goal.distance_um:
            raise TableError(
                f"leaf {index}: {name} is {error_um}, but {successes} of {leaf.trials} trials lay within "
                f"{goal.distance_um}"
            )
