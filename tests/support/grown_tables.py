"""Decision tables as a planner grows them, of any size: the statistics of compiled ones, without compiling.

What is drawn here follows what plan-compile wrote for a rectangle (13 nodes), the same with a goal of 1 mm
(100 nodes) and their reports: few stable widths with intervals of half counts about them, placements at the
job's angles or where a belief proposes them, poses near the hand, moments of degenerate beliefs, trials by
the product of the shares on the way.
"""

from heapq import heappop, heappush
from math import pi
from random import Random

from sample_tables import GOAL, GRIPPER, NO_JOB, breadth_first

from runtime.table import Area, Branch, Covariance, Leaf, Limits, Node, Prediction, Squeeze, Table

COUNT_UM = GRIPPER.opening_um / GRIPPER.steps
LIMITS = Limits(
    64, 235_000, 150_000, Area(-150_000, -150_000, 150_000, 150_000), 60_000, 8_000, 250_000
)
STABLE_UM = (21_000, 30_000, 33_500, 36_200)
MARGIN_COUNTS = 2.5
TRIALS = 20_000
Draft = tuple[Squeeze, list[tuple[int, int, int, float]], list[int]]


def grown_table(seed: int, nodes: int, *, proposals: float = 0.5) -> Table:
    """A table of so many nodes and about as many leaves.

    Args:
        seed: for the generator.
        nodes: how many.
        proposals: share of the nodes whose placement is proposed by the belief, not stated in the job.
    """
    random = Random(seed)
    drafts: list[Draft] = []
    waiting: list[tuple[float, int, int]] = [
        (-1.0, -1, 0)
    ]  # the likeliest open end is squeezed next
    while len(drafts) < nodes:
        share, parent, slot = heappop(waiting)
        if parent >= 0:
            drafts[parent][2][slot] = len(drafts)
        branches = _branches(random)
        drafts.append((_squeeze(random, proposals), branches, [-1] * len(branches)))
        for number, branch in enumerate(branches):
            heappush(waiting, (share * branch[3], len(drafts) - 1, number))
    ends = {(parent, slot): -share for share, parent, slot in waiting}
    return _numbered(random, drafts, ends)


def _numbered(random: Random, drafts: list[Draft], ends: dict[tuple[int, int], float]) -> Table:
    leaves: list[Leaf] = []
    records = []
    for index, (squeeze, branches, children) in enumerate(drafts):
        total = sum(branch[3] for branch in branches)
        left, links = 1_000_000, []
        for number, (low, expected, high, share) in enumerate(branches):
            part = left if number == len(branches) - 1 else round(1e6 * share / total)
            left -= part
            target = children[number]
            if target < 0:
                target = ~len(leaves)
                leaves.append(_leaf(random, squeeze, ends[index, number]))
            links.append(Branch(low, expected, high, part, target))
        records.append(Node(squeeze, tuple(links)))
    trials = sum(leaf.trials for leaf in leaves)
    met = sum(round(leaf.success_ppm * leaf.trials / 1e6) for leaf in leaves)
    predicted = Prediction(round(1e6 * met / trials), trials, 5_284_450, 400)
    table = Table(
        "squeezetree 0.1.0",
        NO_JOB,
        GRIPPER,
        GOAL,
        LIMITS,
        tuple(records),
        tuple(leaves),
        predicted,
        None,
    )
    return breadth_first(table)


def _squeeze(random: Random, proposals: float) -> Squeeze:
    clearance = random.randint(5, 240) * 100
    opening = random.choice((85_000, 85_000, 60_000, 50_000))
    force = random.choice((40_000, 40_000, 25_000))
    if random.random() >= proposals:
        angle = random.choice((0, pi / 4, pi / 2, 3 * pi / 4))
        return Squeeze(0, 0, round(1e6 * angle), opening, 60_000, force, clearance)
    x, y = (round(random.gauss(0, 30)) * 100 for _ in range(2))
    return Squeeze(
        x, y, round(pi / 720 * random.randint(-720, 719) * 1e6), opening, 60_000, force, clearance
    )


def _branches(random: Random) -> list[tuple[int, int, int, float]]:
    """Low, expected and high um, and the share, of the outcomes of a squeeze."""
    count = random.choices((1, 2, 3, 4), (30, 45, 18, 7))[0]
    stable = sorted(random.sample(STABLE_UM, count))
    branches, low, expected = [], 0, 0.0
    for width in stable:
        spread = random.choice((1, 1, 1, 2, 3, 5, 9))  # counts
        start = round(width / COUNT_UM) - random.randint(0, spread - 1)
        low = max(low, round((start - MARGIN_COUNTS) * COUNT_UM))
        high = round((start + spread - 1 + MARGIN_COUNTS) * COUNT_UM)
        offset = random.gauss(0, 0.2 * spread * COUNT_UM)
        expected = max((low + high) / 2 + offset, expected + 1_000, low)
        high = max(high, round(expected) + 900)
        branches.append((low, round(expected), high, random.random() ** 2 + 0.01))
    total = sum(branch[3] for branch in branches)
    return [(low, expected, high, share / total) for low, expected, high, share in branches]


def _leaf(random: Random, squeeze: Squeeze, share: float) -> Leaf:
    trials = round(TRIALS * share * random.uniform(0.8, 1.2))
    missed = (
        0
        if random.random() < 0.8
        else min(trials, round(random.expovariate(1 / (1 + 0.01 * trials))))
    )
    along, across, turn = (
        random.choice((0.0, 0.4, 1.5, 4.0, 9.0)) * random.random() for _ in range(3)
    )
    both = random.choice((0.0, 0.0, 0.0, -1.0, 1.0, random.uniform(-1, 1)))
    covariance = Covariance(
        xx=round(along**2),
        xy=round(both * along * across),
        yy=round(across**2),
        xt=round(0.5 * both * along * turn),
        yt=0,
        tt=round(turn**2),
    )
    x, y = squeeze.x_um + round(random.gauss(0, 600)), squeeze.y_um + round(random.gauss(0, 150))
    turned = random.choice((0.0, pi / 2, -pi / 2, random.gauss(0, 0.2), random.uniform(-pi, pi)))
    theta = (squeeze.angle_urad / 1e6 + turned + pi) % (2 * pi) - pi
    success = round(1e6 * (trials - missed) / trials) if trials else 990_000
    resolved = success >= GOAL.confidence_ppm
    return Leaf(x, y, round(1e6 * theta), covariance, success, trials, resolved)
