"""How often the verdict of `grasp-audit study` is wrong, looked at after each part; not part of the gate.

    python tests/bench/bench_acceptance.py [--cells 1000] [--parts 4000]

Prints figures and writes `results/acceptance.json` beside this file. Each cell has a true share of failures
and runs until its first verdict: shares spread evenly, on a logarithmic scale, from a quarter of the limit to
four times it; and shares at the limit itself, where either verdict counts as wrong, which is the worst case.
Some parts are stopped by the operator, and of some the audit tells nothing. The last cells squeeze parts by
the contact simulation, each with a friction and an error of the encoder that all its parts meet.
"""

from collections import Counter
from typing import Any

import harness
import numpy as np
from acceptance_cells import FAILED, GOOD, judged, tried
from programs import JOB, TABLE

from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate
from planner.job.model import load as load_job
from planner.world import ContactWorlds
from runtime.spc.study.acceptance import ERROR, planned
from runtime.table import load, wilson_interval

RESULTS = harness.Kept("acceptance")
SEED = 0x41434345
SPREAD, AT_LIMIT = "a quarter to four times the limit", "at the limit"
CONTACT, CONTACT_PARTS, OFFSET_MM = "rectangles squeezed by cells that are off", 20_000, 0.6


def measure(kind: str, limit: float, unseen: float, cells: int, parts: int) -> dict[str, Any]:
    """Verdicts on so many cells of a kind."""
    counted: Counter[str] = Counter()
    for cell in range(cells):
        seeds = [round(1e6 * limit), round(1e6 * unseen), cell, kind == AT_LIMIT]
        rng = np.random.default_rng([SEED, *seeds])
        rate = limit if kind == AT_LIMIT else float(limit * 4.0 ** rng.uniform(-1.0, 1.0))
        counted[tried(rng, rate, limit, parts, unseen).value] += 1
    return summary(kind, limit, unseen, cells, parts, counted)


def summary(
    kind: str, limit: float, unseen: float, cells: int, parts: int, counted: Counter[str]
) -> dict[str, Any]:
    """A row of the results."""
    wrong = counted["wrong"]
    return {
        "shares": kind,
        "limit": limit,
        "not_known": unseen,
        "cells": cells,
        "parts_at_most": parts,
        **{word: counted[word] for word in ("right", "wrong", "open")},
        "coverage": 1.0 - wrong / cells,
        "wrong_ci95": list(wilson_interval(wrong, cells)),
    }


def measure_contact(limits: tuple[float, ...], cells: int) -> list[dict[str, Any]]:
    """Verdicts on simulated cells whose encoder and friction are off, each by as much for all its parts.

    A cell's true share is that of 20 000 parts; parts are looked at in their order.
    """
    table = load(TABLE).table
    job = load_job(JOB)
    counted: dict[float, Counter[str]] = {limit: Counter() for limit in limits}
    for cell in range(cells):
        rng = np.random.default_rng([SEED, cell])
        mu = float(rng.uniform(job.friction.finger_part_min, job.friction.finger_part_max))
        real = job.replaced(friction={"finger_part_min": mu, "finger_part_max": mu})
        off = Disturbance(encoder_offset_mm=float(rng.normal(0.0, OFFSET_MM)))
        worlds = ContactWorlds.of_job(real, cell)
        evaluation = evaluate(table, real, worlds, CONTACT_PARTS, cell, disturbance=off)
        good = evaluation.resolved & evaluation.within
        parts = [GOOD if located else FAILED[0] for located in good]
        for limit, count in counted.items():
            count[judged(parts, 1.0 - float(good.mean()), limit).value] += 1
    parts = CONTACT_PARTS
    return [summary(CONTACT, limit, 0.0, cells, parts, count) for limit, count in counted.items()]


def main() -> None:
    """Measure all kinds, print them and keep them."""
    parser = harness.parser(__doc__)
    parser.add_argument("--cells", type=int, default=1000)
    parser.add_argument("--parts", type=int, default=4000)
    arguments = parser.parse_args()
    rows = []
    for limit in (0.05, 0.01):
        for kind in (SPREAD, AT_LIMIT):
            for unseen in (0.0, 0.02):
                row = measure(kind, limit, unseen, arguments.cells, arguments.parts)
                rows.append(row)
                harness.show(row)
    rows += measure_contact((0.05, 0.01), arguments.cells)
    harness.show(rows[-2:])
    counts = {str(limit): planned(limit, limit / 5.0)._asdict() for limit in (0.05, 0.01, 0.001)}
    kept = {"error_allowed": ERROR, "rows": rows, "parts_where_a_fifth_of_the_limit_fails": counts}
    RESULTS.write(kept)


if __name__ == "__main__":
    main()
