"""Plans jobs with one layer of the search switched off at a time; not part of `tools/check`.

    python tests/bench/bench_ablation.py                                 all layers, six parts, four seeds
    python tests/bench/bench_ablation.py --layer splits --only rectangle
    python tests/bench/bench_ablation.py --layer memory+variants         without both
    python tests/bench/bench_ablation.py --report                        only print what is kept

A layer is a step of the search that could be left out. The table shows what each layer buys. Without the
layer, the squeezes and the total (mean squeezes + 100 x the share of parts that are not located) rise by the
stated mean over all plans; its standard error is in brackets. The table is kept in `results/ablation.txt`.

Each plan is judged by 20 000 parts that were not used in planning. It is kept in `results/ablation.json` as
soon as it is made; plans that are kept are not made again. The seeds are not those by which
`bench_planner.py` judges the planner.
"""

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import product
from statistics import fmean, stdev
from typing import NamedTuple
from unittest.mock import patch

import harness
import numpy as np
from programs import TREES

from planner import planning, problem
from planner.belief.doubts import believed
from planner.belief.particles import evenly, initial
from planner.compile import compile_job
from planner.job.model import load
from planner.search import proposals, search
from planner.search.effort import PASSES
from planner.search.ranking import Ranking
from planner.search.search import Search

RESULTS = harness.Kept("ablation")
PARTS = ("rectangle", "butterfly-10", "hex-nut", "rectangle-25", "gusset", "kite")
SEEDS = (11, 12, 13, 14)
NONE = "none"  # the name of the complete search


class Layer(NamedTuple):
    """A layer of the search. To switch it off, `replacement` takes the place of an attribute of `owner`."""

    buys: str  # what the search does with the layer
    owner: object
    attribute: str
    replacement: object


LAYERS = {
    "second-partition": Layer(
        "probable nodes also try a partition without the price of strays",
        Search,
        "_partitions",
        lambda self, _, squeezed: [self._cut(squeezed, self.problem.rule)],
    ),
    "splits": Layer(
        "a branch is split where its best squeeze shows that it mixes poses",
        Search,
        "_split",
        lambda self, node: None,
    ),
    "variants": Layer(
        "random variants of the best grasp poses are ranked, too",
        Ranking,
        "varied",
        lambda self, belief, thin, options, rng: options,
    ),
    "scattered": Layer(
        "grasp poses scattered about the part are ranked, too",
        proposals,
        "hands_about",
        lambda reach_mm, half_mm, n: np.zeros((0, 3)),
    ),
    "memory": Layer(
        "grasp poses that were best at other nodes are ranked, too",
        search,
        "to_hand",
        lambda poses, mode: np.zeros((0, 3)),
    ),
    "exploration": Layer(
        "one pass expands all first squeezes that may be the best",
        planning,
        "PASSES",
        tuple(each for each in PASSES if not each.explores),
    ),
    "retries": Layer(
        "a pass retries actions that were almost the best in the pass before",
        search,
        "MARGIN",
        1e-9,
    ),
    "lattice": Layer(
        "the first poses of a belief lie on a lattice, and are not drawn one by one",
        problem,
        "evenly",
        initial,
    ),
    "new-particles": Layer(
        "each pass draws new particles, so that no action is valued by those that selected it",
        problem.Problem,
        "belief",
        lambda self, n, _: believed(self.job, n, np.random.default_rng(self.job.seed), evenly),
    ),
    "repeats": Layer(
        "beliefs of few particles are repeated before they are squeezed",
        search,
        "LEAST_PARTICLES",
        1,
    ),
    "trials": Layer(
        "leaves that fresh trials refute are searched again",
        planning,
        "ATTEMPTS",
        0,
    ),
}


@dataclass(frozen=True)
class Plan:
    """The figures of one plan; `without` is the layer that was switched off."""

    without: str
    part: str
    seed: int
    squeezes: float
    success: float

    @property
    def total(self) -> float:
        """Mean squeezes, plus 100 times the share of parts that are not located."""
        return self.squeezes + 100.0 * (1.0 - self.success)


def planned(without: str, part: str, seed: int) -> Plan:
    """Plans one job on one thread without the named layers, joined by "+"."""
    job = load(TREES / part / "job.toml").replaced(seed=seed)
    with ExitStack() as switched_off:
        for name in without.split("+") if without != NONE else ():
            switched_off.enter_context(patch.object(*LAYERS[name][1:]))
        run = compile_job(job, workers=1).evaluation
    return Plan(without, part, seed, float(run.squeezes.mean()), float(run.success.mean()))


def report(plans: list[Plan]) -> str:
    """The table of results: by how much total and squeezes rise without each layer."""
    whole = {(plan.part, plan.seed): plan for plan in plans if plan.without == NONE}
    lines = [f"{'without':16} {'plans':>5}  {'total':>14}  {'squeezes':>14}  the layer"]
    cases = {name: layer.buys for name, layer in LAYERS.items()}
    for name in [*cases, *sorted({plan.without for plan in plans} - {NONE, *cases})]:
        rows = [plan for plan in plans if plan.without == name]
        pairs = [(row, whole[row.part, row.seed]) for row in rows if (row.part, row.seed) in whole]
        lines += _row(name, pairs, cases.get(name, "both"))
    twins = [(whole[key], whole.get((key[0], key[1] + 1))) for key in whole if key[1] % 2]
    better = [(one, min(one, two, key=lambda plan: plan.total)) for one, two in twins if two]
    lines += _row("second plan", better, "no layer: the better of two plans, for twice the time")
    return "\n".join(lines) + "\n"


def _row(name: str, pairs: list[tuple[Plan, Plan]], buys: str) -> list[str]:
    """The row of pairs of plans: without a layer, and with it; no row if there are fewer than two pairs."""
    if len(pairs) < 2:
        return []
    totals = [without.total - whole.total for without, whole in pairs]
    squeezes = [without.squeezes - whole.squeezes for without, whole in pairs]
    rises = f"{_with_error(totals):>14}  {_with_error(squeezes):>14}"
    return [f"{name:16} {len(pairs):5}  {rises}  {buys}"]


def _with_error(rises: list[float]) -> str:
    """Formats the mean of differences with the standard error of the mean."""
    return f"{fmean(rises):+.3f} ({stdev(rises) / len(rises) ** 0.5:.3f})"


def main() -> None:
    parser = harness.parser(__doc__)
    said = f"these layers: {', '.join(LAYERS)}"
    parser.add_argument("--layer", nargs="+", default=list(LAYERS), help=said)
    parser.add_argument("--only", nargs="+", default=list(PARTS), help="these parts")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--report", action="store_true", help="plan nothing, print what is kept")
    arguments = parser.parse_args()
    if unknown := set("+".join(arguments.layer).split("+")) - set(LAYERS):
        parser.error(f"unknown layer {unknown.pop()}; choose from {', '.join(LAYERS)}")
    plans = {(row["without"], row["part"], row["seed"]): Plan(**row) for row in RESULTS.read([])}
    if not arguments.report:
        for case in product([NONE, *arguments.layer], arguments.only, arguments.seeds):
            if case not in plans:
                plans[case] = planned(*case)
                rows = sorted(plans.values(), key=lambda plan: (plan.without, plan.part, plan.seed))
                RESULTS.write_rows([asdict(row) for row in rows])
                print(plans[case], flush=True)
    table = report(list(plans.values()))
    RESULTS.path.with_suffix(".txt").write_text(table)
    print(table, end="")


if __name__ == "__main__":
    main()
