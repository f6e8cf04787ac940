"""How far push-forwards of the learned model are from the simulator's; not part of the gate.

    python tests/bench/bench_push_forward.py [--count 100000] [--only rectangle L] [--runs 6]

The belief of a job is pushed through one, two and three squeezes, by the model and by the simulator, and
compared by energy distance in units of that between two runs of the simulator. `same` runs all start from the
same particles, `fresh` ones each from their own sample of the belief. Prints figures and writes
`results/push_forward.json` beside this file. Roll-outs are kept in the cache folder.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from energy import compare  # noqa: E402
from kcde_twin import Unaided  # noqa: E402
from problems import OUTLINES, random_poses, simulator  # noqa: E402

from planner.belief.observation import Encoder  # noqa: E402
from planner.belief.particles import Belief  # noqa: E402
from planner.belief.transition import Simulation  # noqa: E402
from planner.frames import to_hand  # noqa: E402
from planner.kernel import cache_folder  # noqa: E402
from planner.learned.kcde import Kcde  # noqa: E402
from planner.learned.model import LearnedModel  # noqa: E402
from planner.learned.rollouts import PAPER_COUNT, roll_outs  # noqa: E402
from planner.learned.store import Store  # noqa: E402
from planner.mechanics.simulator import Simulator  # noqa: E402
from planner.part import symmetry  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "push_forward.json"
RADII_MM = {"rectangle": 12.75, "butterfly": 10.0, "right triangle": 10.0, "L": 10.0}
ENCODER = Encoder(opening_mm=85.0, steps=227, noise_mm=0.15)
ANGLES_DEG = ([0, 45, 90], [0, 90, 45])
PARTICLES = 2500
Row = dict[str, Any]


def learned(name: str, count: int) -> tuple[dict[str, LearnedModel | Unaided], Row]:
    """The model as the planner has it and the paper's estimate; and what there is to say."""
    part, radius = simulator(OUTLINES[name](), workers=2), 3 * RADII_MM[name]
    store, order = Store(cache_folder() / "rollouts"), symmetry.order(part.outline)
    rolled = roll_outs(part, radius, count, store)
    start = time.perf_counter()
    model = LearnedModel.fit(part, ENCODER, order, rolled)
    fit_s = round(time.perf_counter() - start, 2)
    few = roll_outs(part, radius, PAPER_COUNT, store)
    printed = Kcde.fit(few, part.outline, part.jaws, part.surface.rho_mm, order, paper=True)
    models = {"model": model, "paper": Unaided(printed)}
    spacing_mm = model.motion.grid.spacing_mm
    return models, {"roll_outs": len(rolled.initial), "spacing_mm": spacing_mm, "fit_s": fit_s}


def simulated(model: LearnedModel, belief: np.ndarray, placements: np.ndarray) -> list[float]:
    """Share of the particles that each of the squeezes simulates."""
    rng, shares = np.random.default_rng(5), []
    for placement in placements:
        drawn = model.motion.sample(to_hand(belief, placement), rng)
        covered = model.covered(drawn.source, drawn.nearest_mm, np.zeros(len(belief), np.int64))
        shares.append(float(np.mean((drawn.source >= 0) & ~covered)))
        belief = Belief.joined(
            model.squeeze([(Belief.of(belief), placement)], rng)[0].beliefs
        ).poses
    return shares


def ratios(
    model: LearnedModel | Unaided,
    simulator: Simulator,
    name: str,
    placements: np.ndarray,
    runs: int,
) -> Row:
    """The model's push-forwards in units of the simulator's own distance, with same and fresh particles."""
    rng = np.random.default_rng(3)
    beliefs = [random_poses(rng, PARTICLES, RADII_MM[name]) for _ in range(2 * runs)]
    reference = Simulation(simulator, ENCODER)
    rho, order = model.motion.rho_mm, model.motion.order
    row: Row = {}
    for kind, starts in (("same", beliefs[:1] * 2 * runs), ("fresh", beliefs)):
        result = compare(model, reference, starts, placements, rho, order, np.random.default_rng(7))
        row[kind] = [round(c.ratio, 3) for c in result]
        row[f"{kind}_simulator_mm"] = [c.simulator_mm for c in result]
        row[f"{kind}_model_mm"] = [c.model_mm for c in result]
    return row


def bench(name: str, count: int, runs: int) -> Row:
    """All figures of one part."""
    models, row = learned(name, count)
    print(f"{name}: {row}", flush=True)
    for kind, model in models.items():
        for angles in ANGLES_DEG:
            placements = np.array([[0.0, 0.0, a] for a in np.radians(angles)])
            result = ratios(model, models["model"].simulator, name, placements, runs)
            belief = random_poses(np.random.default_rng(3), PARTICLES, RADII_MM[name])
            result["simulated"] = simulated(model, belief, placements) if kind == "model" else []
            row[f"{kind} {angles}"] = result
            line = f"{kind:15} {angles}: same {result['same']} fresh {result['fresh']} "
            print(line + f"simulated {np.round(result['simulated'], 2)}", flush=True)
    return row


def main() -> None:
    """Run the chosen parts and record them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100_000, help="of roll-outs")
    parser.add_argument("--runs", type=int, default=6, help="of model and simulator")
    parser.add_argument("--only", nargs="+", choices=list(RADII_MM), default=list(RADII_MM))
    options = parser.parse_args()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in options.only:
        results[name] = {"count": options.count, **bench(name, options.count, options.runs)}
    results["setting"] = {"python": platform.python_version(), "machine": platform.machine()}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
