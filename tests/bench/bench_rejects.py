"""Measures how often a table answers what it should reject: random widths, and parts that are not the job's.

    python tests/bench/bench_rejects.py [TABLES] [--parts 2000]

For each table it prints the share of parts that end in a resolved leaf, for three kinds of input: all widths
are drawn evenly between open and closed; the first width is one that the plan expects, and the others are
drawn; the part is larger, smaller, longer or thinner than the job's, or a disc, or a square. For such parts
it also prints the share that ends in a resolved leaf with a wrong pose.
"""

from pathlib import Path

import harness
import numpy as np

from planner.evaluation.evaluate import evaluate
from planner.evaluation.trials import DISMISSED, Program
from planner.job import model as job_file
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.shell.errors import InputError
from runtime.table import load

RECTANGLE = Path("trees/rectangle/rectangle.msgpack")
RUNS = 20_000
SCALES = {"larger by 10 %": (1.1, 1.1), "smaller by 10 %": (0.9, 0.9), "longer by 20 %": (1.2, 1.0)}
SCALES |= {"larger by 5 %": (1.05, 1.05), "thinner by 20 %": (1.0, 0.8)}


def random_widths(program, rng, first_by_plan):
    """Share of runs that end in a resolved leaf if their widths are drawn at random.

    The object flag of each reading is set. With `first_by_plan`, the first branch of each run is drawn by its
    planned probability; a run that ends at this branch does not count as one that ends in a resolved leaf.
    """
    table, gripper = program.table, program.table.gripper
    node, answered = np.zeros(RUNS, np.int64), 0
    for depth in range(table.limits.max_depth):
        steps = rng.integers(0, gripper.steps, len(node))
        target = program.target[program.segment(node, 2 * steps + 1)]
        if depth == 0 and first_by_plan:
            shares = np.array([branch.probability_ppm for branch in table.nodes[0].branches], float)
            taken = rng.choice(len(shares), len(node), p=shares / shares.sum())
            target = np.array([branch.target for branch in table.nodes[0].branches])[taken]
            target = target[target >= 0]
        leaves = ~target[(target < 0) & (target != DISMISSED)]
        answered += sum(table.leaves[leaf].resolved for leaf in leaves)
        node = target[target >= 0]
    return answered / RUNS


def others(job):
    """Yields names and outlines (n, 2) of parts that differ from the job's part."""
    outline = np.asarray(job.part.outline_mm)
    for name, scale in SCALES.items():
        yield name, outline * scale
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    least = min(np.ptp(outline @ np.array([np.cos(a), np.sin(a)])) for a in turns)
    yield "a disc as wide as it", 0.5 * least * np.column_stack([np.cos(turns), np.sin(turns)])
    yield "a square as wide as it", 0.5 * least * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def main():
    parser = harness.parser(__doc__)
    parser.add_argument("trees", type=Path, nargs="*", default=[RECTANGLE])
    parser.add_argument("--parts", type=int, default=2000)
    options = parser.parse_args()
    for tree in options.trees:
        table = load(tree).table
        job, program = job_file.from_canonical(str(table.job)), Program.of(table)
        rng = np.random.default_rng(1)
        record = {
            "random": random_widths(program, rng, False),
            "random but the first": random_widths(program, rng, True),
        }
        for name, outline in others(job):
            try:
                part = {"outline_mm": outline.tolist(), "symmetry": 1, "picks": None}
                other = job.replaced(part=part)
            except InputError as error:
                record[name] = str(error)
                continue
            worlds = ContactWorlds.of_job(other, 2)
            run = evaluate(table, other, worlds, options.parts, 2, Threads(1))
            answered = (run.leaf >= 0) & run.resolved
            record[name] = [float(np.mean(each)) for each in (answered, answered & ~run.within)]
        harness.show({"tree": tree.stem, **record})


if __name__ == "__main__":
    main()
