"""Measures the speed of the Gymnasium environment beside MuJoCo's, and the success of simple policies in it.

    python tests/bench/bench_gym.py [--parts 300] [--only speed policies]

speed: squeezes a second on one core. That of MuJoCo is measured if it is installed (`pip install mujoco`).

policies: each locates the rectangle in the generative model. Two policies are compiled tables. Two others
track the belief by a particle filter, and declare its main mode once this mode reaches the goal's confidence.
Before that, the greedy one squeezes where the main mode of the next belief is largest on average, and the
random one anywhere.

Prints figures and writes `results/gym.json` beside this file. Not part of `tools/check`.
"""

import json
import platform
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import harness
import numpy as np
from programs import TABLE

import planner.gym
from planner.belief.partition import partition
from planner.compile import compile_job
from planner.evaluation.trials import Program
from planner.pomdp import DECLARE, SQUEEZE, Pomdp
from planner.problem import Problem
from runtime import table as tables

RESULTS = harness.Kept("gym")
BATCH = 4096
STEPS = 40
PARTICLES, JUDGES = 1000, 300
Row = dict[str, Any]
Choice = Callable[[Pomdp, np.ndarray, np.random.Generator], int]


def speed() -> list[Row]:
    """Measures squeezes a second of processor time; each part is squeezed three times, then declared."""
    rng = np.random.default_rng(0)
    many = gymnasium.make_vec(planner.gym.NAME, num_envs=BATCH)
    one = gymnasium.make(planner.gym.NAME)
    rows = [_stepped("vector, 4096 parts", many, rng, STEPS), _stepped("one part", one, rng, 4000)]
    try:
        from planner.evaluation.mujoco import RigidWorld
    except ImportError:
        print("MuJoCo is not installed: its speed is not measured (pip install mujoco)")
        return rows
    model = planner.gym.problem_of(None)
    poses = model.initial(20, rng)[:, :3]
    world, clock = RigidWorld(model.job, 0), time.process_time()
    for pose in poses.tolist():
        world.close(tuple(pose), 0.5)
    return [*rows, {"what": "MuJoCo", "per_second": len(poses) / (time.process_time() - clock)}]


def _stepped(what: str, env: Any, rng: np.random.Generator, steps: int) -> Row:
    placements, size = env.unwrapped.model.placements, getattr(env, "num_envs", None)
    env.reset(seed=1)
    env.step(np.zeros(size, np.int64) if size else 0)  # compiled before the clock starts
    env.reset()
    squeezes, clock = 0, time.process_time()
    for step in range(steps):
        declares = step % 4 == 3
        first, last = (placements, placements + 1) if declares else (0, placements)
        action = rng.integers(first, last, size)
        _, reward, ended, _, _ = env.step(action)
        squeezes += int(np.sum(np.less(reward, 0.0)))
        if not size and ended:
            env.reset()
        elif declares:
            env.step(action)  # the step that lays new parts down
    row = {"what": what, "per_second": squeezes / (time.process_time() - clock)}
    harness.show(row)
    return row


def policies(parts: int) -> list[Row]:
    """Runs all policies; returns a row with success, squeezes and reward of each."""
    model = planner.gym.problem_of(None)
    kept = tables.load(TABLE).table
    trusting = model.job.replaced(doubt={"chance": 0.0}, friction={"doubt": 0.0})
    alone = compile_job(trusting).table
    rows = [
        _figures("the plan in trees/rectangle", *planned(model, kept, 20_000), model),
        _figures("a plan for this world alone", *planned(model, alone, 20_000), model),
    ]
    for name, choice in (("greedy, one squeeze ahead", greedy), ("random", at_random)):
        rng = np.random.default_rng(1)
        ends = np.array([filtered(model, choice, rng) for _ in range(parts)])
        rows.append(_figures(name, ends[:, 0] > 0.0, ends[:, 1], model))
    return rows


def _figures(policy: str, success: np.ndarray, squeezes: np.ndarray, model: Pomdp) -> Row:
    row = {
        "policy": policy,
        "parts": len(success),
        "success": float(success.mean()),
        "success_ci95": list(tables.wilson_interval(int(success.sum()), len(success))),
        "squeezes": float(squeezes.mean()),
        "reward": float((model.success * success - squeezes).mean()),
    }
    print(json.dumps(row), flush=True)
    return row


def planned(model: Pomdp, table: tables.Table, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Runs a table on new parts; returns which of them it declares rightly (n,), and their squeezes (n,)."""
    program, rng = Program.of(table), np.random.default_rng(1)
    states, node = model.initial(parts, rng), np.zeros(parts, np.int64)
    success, squeezes = np.zeros(parts, np.bool_), np.zeros(parts)
    said = np.array([tables.predicted_pose(leaf) for leaf in table.leaves])
    while (rows := np.flatnonzero(node >= 0)).size:
        placed = np.column_stack([program.placement[node[rows]], np.full(len(rows), SQUEEZE)])
        sampled = model.sample(states[rows], placed, rng)
        squeezes[rows] += 1
        states[rows] = sampled.states
        reading = 2 * sampled.observations + (sampled.states[:, 3] > 0.0)
        node[rows] = program.target[program.segment(node[rows], reading)]
        known = rows[(node[rows] < 0) & (~node[rows] < len(said)) & (~node[rows] >= 0)]
        declared = np.column_stack([said[~node[known]], np.full(len(known), DECLARE)])
        success[known] = model.sample(states[known], declared, rng).rewards > 0.0
    return success, squeezes


def filtered(model: Pomdp, choice: Choice, rng: np.random.Generator) -> tuple[bool, int]:
    """Locates one part by a particle filter; returns whether the declared pose is right, and the squeezes."""
    state, belief = model.initial(1, rng), model.initial(PARTICLES, rng)
    squeezes = 0
    while True:
        mode = model.metric.mode(belief[:, :3])
        if mode.ratio >= model.job.goal.confidence or squeezes == model.job.search.max_depth:
            declared = np.array([*mode.pose, DECLARE])
            return bool(model.sample(state, declared, rng).rewards[0] > 0.0), squeezes
        action = model.actions[choice(model, belief, rng)]
        sampled = model.sample(state, action, rng)
        state, squeezes = sampled.states, squeezes + 1
        if sampled.ended[0]:
            return False, squeezes
        try:
            belief = model.updated(belief, action, int(sampled.observations[0]), rng)
        except ValueError:
            return False, squeezes  # no particle is like this part


def greedy(model: Pomdp, belief: np.ndarray, rng: np.random.Generator) -> int:
    """The number of the placement after which the main mode has the largest mean share of the belief."""
    few, rule = belief[:: max(1, len(belief) // JUDGES)], Problem.of(model.job, 1).rule
    values = []
    for placement in model.actions[: model.placements]:
        sampled = model.sample(few, placement, rng)
        label = partition(sampled.states[:, :3], sampled.observations, rule)
        after = [sampled.states[label == k, :3] for k in np.unique(label)]
        values.append(sum(len(poses) * model.metric.mode(poses).ratio for poses in after))
    return int(np.argmax(values))


def at_random(model: Pomdp, _belief: np.ndarray, rng: np.random.Generator) -> int:
    """The number of a random placement."""
    return int(rng.integers(model.placements))


def main() -> None:
    """Runs the chosen studies and adds their figures to the file of results."""
    parser = harness.parser(__doc__)
    benches = ["speed", "policies"]
    parser.add_argument("--parts", type=int, default=300, help="of each policy with a filter")
    parser.add_argument("--only", nargs="+", choices=benches, default=benches)
    options = parser.parse_args()
    results = RESULTS.read({})
    if "speed" in options.only:
        results["speed"] = speed()
    if "policies" in options.only:
        results["policies"] = policies(options.parts)
    results["setting"] = {"python": platform.python_version(), "machine": platform.machine()}
    RESULTS.write(results)


if __name__ == "__main__":
    main()
