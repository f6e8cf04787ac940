"""Many short histories of cells that begin to drift: how often each drift is flagged within fifty parts.

Limits were chosen with other seeds (0 to 99 and 500 to 519); those here are used for nothing else.
"""

from __future__ import annotations

import copy
from collections import Counter
from math import log
from typing import Any

import numpy as np
from drifting import HEALTHY, Drift, parts, squeezed

from planner.arrays import Array
from planner.evaluation.outcome import Evaluation
from planner.expectation import readings
from planner.job import Job
from runtime.quality.expectation import COUNTS, PRIOR, Expectation
from runtime.quality.history import Part
from runtime.quality.monitor import Monitor
from runtime.table import Table

BEFORE, WITHIN = 300, 50
FRESH = 10_000  # seeds of this module begin here
RARE = 1e4  # parts to a false alarm that a drift must be told apart at
POOL = 40_000  # parts that a divergence is estimated from
DRIFTS = {
    "encoder +1 mm": Drift(width_mm=1.0),
    "encoder -1 mm": Drift(width_mm=-1.0),
    "encoder +0.5 mm": Drift(width_mm=0.5),
    "friction 0.05 to 0.15": Drift((0.05, 0.15)),
    "friction 0.2 to 0.3": Drift((0.2, 0.3)),
    "friction 0.28 to 0.42": Drift((0.28, 0.42)),
    "friction 0.34 to 0.51": Drift((0.34, 0.51)),
    "friction 0.46 to 0.69": Drift((0.46, 0.69)),
    "friction 0.5 to 0.75": Drift((0.5, 0.75)),
    "friction 0.6 to 0.8": Drift((0.6, 0.8)),
    "friction 0.7 to 0.9": Drift((0.7, 0.9)),
    "friction 0.8 to 1.0": Drift((0.8, 1.0)),
    "camera 0.45 mm in x": Drift(seen_off=(0.45, 0.0, 0.0)),
    "camera 1 mm in y": Drift(seen_off=(0.0, 1.0, 0.0)),
    "camera turned by 2 deg": Drift(seen_off=(0.0, 0.0, 0.035)),
}


def healthy(table: Table, job: Job, expected: Expectation, blocks: int) -> dict[str, Any]:
    """False alarms in so many blocks of 10 000 healthy parts."""
    alarms: Counter[str] = Counter()
    for block in range(blocks):
        monitor, seed = Monitor.of(table, expected), FRESH + block
        for part in parts(table, squeezed(table, job, 10_000, seed), seed):
            alarms.update(chart for chart, _ in monitor.add(part))
        print(f"healthy block {block}: {alarms.total()} alarms so far", flush=True)
    return {"parts": 10_000 * blocks, "alarms": dict(alarms), "alarms_in_10000": alarms.total() / blocks}


def drifting(table: Table, job: Job, expected: Expectation, runs: int) -> dict[str, Any]:
    """For each drift: shares of runs flagged within 50 parts, the delays, and what could be had at best."""
    seed = FRESH + 1000
    starts = [_started(table, job, expected, seed + run) for run in range(runs)]
    planned = _shares(squeezed(table, job, 5 * POOL, seed - 1), table)
    told = {}
    for number, (name, drift) in enumerate(DRIFTS.items()):
        own = seed + 1000 * (number + 1)
        found = squeezed(table, job, runs * WITHIN, own, drift)
        stretch = list(parts(table, found, own, drift))
        rows = [_first(start, stretch[run * WITHIN : (run + 1) * WITHIN]) for run, start in enumerate(starts)]
        told[name] = _figures(rows)
        if drift.friction is not None:
            told[name] |= bound(planned, squeezed(table, job, POOL, own + 1, drift), table)
        print(f"{name:24}", told[name], flush=True)
    return told


def bound(planned: Array, found: Evaluation, table: Table) -> dict[str, float]:
    """What no chart of readings could better.

    `nats` is the Kullback-Leibler divergence of a part's readings from the planned ones, as far as a reading
    depends on the ones before through the node alone; `parts_at_least` the mean delay of the best chart whose
    false alarms are `RARE` parts apart (Lorden, Annals of Mathematical Statistics 42, 1971, to first order).
    """
    counts = readings(found, len(table.nodes))
    ratio = np.log(_shares(found, table) / planned)
    nats = float((counts * ratio).sum() / len(found.leaf))
    return {"nats_a_part": nats, "nats_in_50": WITHIN * nats, "parts_at_least": log(RARE) / nats}


def _shares(found: Evaluation, table: Table) -> Array:
    counts = readings(found, len(table.nodes))
    return np.asarray((counts + PRIOR / COUNTS) / (counts.sum(axis=1, keepdims=True) + PRIOR))


def _started(table: Table, job: Job, expected: Expectation, seed: int) -> Monitor:
    """Charts that have seen the healthy parts before a drift."""
    monitor = Monitor.of(table, expected)
    for part in parts(table, squeezed(table, job, BEFORE, seed), seed, HEALTHY):
        monitor.add(part)
    return monitor


def _first(start: Monitor, stretch: list[Part]) -> dict[str, int]:
    """The first alarm of each chart, in parts since the drift began."""
    monitor, found = copy.deepcopy(start), {}
    for number, part in enumerate(stretch, start=1):
        for chart, _ in monitor.add(part):
            found.setdefault(chart, number)
    return found


def _figures(rows: list[dict[str, int]]) -> dict[str, Any]:
    delays = [min(row.values()) for row in rows if row]
    charts = Counter(chart for row in rows for chart in row)
    return {
        "flagged": len(delays) / len(rows),
        "delay_median": float(np.median(delays)) if delays else None,
        "delay_max": max(delays, default=None),
        "by": {chart: count / len(rows) for chart, count in charts.most_common()},
    }
