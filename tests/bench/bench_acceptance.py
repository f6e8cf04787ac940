"""Measures how often the verdict of `grasp-audit study` is wrong if it is evaluated after each part.

    python tests/bench/bench_acceptance.py [--cells 1000] [--parts 4000]

Each simulated cell has a true share of failed parts, and runs until the study's first verdict on it. There
are three kinds of cells. In the first, the true share lies between a quarter of the study's limit and four
times the limit, evenly on a logarithmic scale. In the second, it equals the limit, and either verdict counts
as wrong: the worst case. In both, the operator stops some parts, and some audits have no result. Cells of the
third kind squeeze parts by the contact simulation, each with one friction and one error of the encoder for
all its parts.

Prints the figures and writes `results/acceptance.json` beside this file. Not part of `tools/check`.
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
    """Counts the right, wrong and missing verdicts on many simulated cells; returns a row of the results.

    Args:
        kind: how the true shares of failures are drawn: `SPREAD` or `AT_LIMIT`.
        limit: the study's limit on the share of failures.
        unseen: share of parts whose audit has no result.
        cells: number of cells.
        parts: greatest number of parts in a cell.
    """
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
    """A row of the results: the settings, the counts of verdicts, and the share of wrong ones."""
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
    """Counts verdicts on cells of the contact simulation; returns a row of the results for each limit.

    Each cell has one friction and one error of the encoder for all its parts. Its true share of failures is
    that of 20 000 parts; the study then sees these parts in order.
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
    """Measures all kinds of cells, prints the rows and writes them to the file of results."""
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
