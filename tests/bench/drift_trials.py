"""Simulates short histories of cells that begin to drift; counts drifts flagged within 50 parts.

The limits of the charts were chosen with other seeds (0 to 99, 500 to 519, from 700 000 on). The seeds of
this module are used for nothing else.
"""

import copy
from collections import Counter
from typing import Any

import numpy as np
from drifting import HEALTHY, Drift, parts, squeezed

from planner.arrays import Array
from planner.evaluation.expectation import bins_of, readings
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from runtime.spc.expectation import PRIOR, Expectation
from runtime.spc.history import Part
from runtime.spc.monitor import Monitor
from runtime.table import Table

BEFORE, WITHIN = 300, 50
FRESH = 10_000  # seeds of this module begin here
RARE = 1e4  # healthy parts to one false alarm, for the bound
POOL = 40_000  # parts of a drift whose readings are counted; of the healthy cell five times as many
FRICTIONS = ((0.05, 0.15), (0.2, 0.3), (0.28, 0.42), (0.34, 0.51), (0.46, 0.69), (0.5, 0.75))
FRICTIONS += ((0.6, 0.8), (0.7, 0.9), (0.8, 1.0))
DRIFTS = {
    **{f"encoder {mm:+g} mm": Drift(width_mm=mm) for mm in (1.0, -1.0, 0.5)},
    **{f"friction {low} to {high}": Drift((low, high)) for low, high in FRICTIONS},
    "camera 0.45 mm in x": Drift(seen_off=(0.45, 0.0, 0.0)),
    "camera 1 mm in y": Drift(seen_off=(0.0, 1.0, 0.0)),
    "camera turned by 2 deg": Drift(seen_off=(0.0, 0.0, 0.035)),
}


def healthy(table: Table, job: Job, expected: Expectation, blocks: int) -> dict[str, Any]:
    """Runs `blocks` blocks of 10 000 healthy parts; returns the number and the rate of false alarms."""
    alarms: Counter[str] = Counter()
    for block in range(blocks):
        monitor, seed = Monitor(table, expected), FRESH + block
        for part in parts(table, squeezed(table, job, 10_000, seed), seed):
            alarms.update(alarm.chart for alarm in monitor.add(part))
        print(f"healthy block {block}: {alarms.total()} alarms so far", flush=True)
    rate = alarms.total() / blocks
    return {"parts": 10_000 * blocks, "alarms": dict(alarms), "alarms_in_10000": rate}


def drifting(table: Table, job: Job, expected: Expectation, runs: int) -> dict[str, Any]:
    """Runs `runs` histories of each drift.

    Returns:
        For each drift: the shares of histories that are flagged within 50 parts, and the delays. For a drift
        of friction also what `bound` returns.
    """
    seed = FRESH + 1000
    starts = [_started(table, job, expected, seed + run) for run in range(runs)]
    planned = _shares(squeezed(table, job, 5 * POOL, seed - 1), table)
    unchanged = squeezed(table, job, 5 * POOL, seed - 2)
    record = {}
    for number, (name, drift) in enumerate(DRIFTS.items()):
        ours = seed + 1000 * (number + 1)
        result = squeezed(table, job, runs * WITHIN, ours, drift)
        stretch = list(parts(table, result, ours, drift))
        stretches = (stretch[k : k + WITHIN] for k in range(0, len(stretch), WITHIN))
        rows = [_first(start, mine) for start, mine in zip(starts, stretches, strict=True)]
        record[name] = _figures(rows)
        if drift.friction is not None:
            shares = _shares(squeezed(table, job, POOL, ours + 1, drift), table)
            record[name] |= bound(np.log(shares / planned), unchanged, result)
        print(f"{name:24}", record[name], flush=True)
    return record


def bound(gain: Array, unchanged: Evaluation, result: Evaluation) -> dict[str, float]:
    """Bounds how often any chart of readings could flag a drift.

    The bound assumes that a reading depends on earlier readings by its node alone. If a chart raises one
    false alarm in `RARE` healthy parts, the probability of a false alarm in `WITHIN` healthy parts is at most
    `WITHIN / RARE`. Of all tests with this probability of a false alarm, the likelihood ratio detects a
    change most often (Neyman and Pearson 1933). Unlike a chart, it knows when the friction changed, and to
    what.

    Args:
        gain: (nodes, bins) logarithm of how much likelier each reading is after the change.
        unchanged: healthy parts, none of them used for `gain`.
        result: parts after the change, none of them used for `gain`.

    Returns:
        `at_best`: share of histories that the likelihood ratio flags; `nats_in_50`: mean logarithm of the
            likelihood ratio of 50 parts after the change.
    """
    healthy, changed = (_windows(gain, parts) for parts in (unchanged, result))
    limit = np.quantile(healthy, 1.0 - WITHIN / RARE)
    return {"at_best": float((changed > limit).mean()), "nats_in_50": float(changed.mean())}


def _windows(gain: Array, result: Evaluation) -> Array:
    """Log-likelihood ratios of successive groups of `WITHIN` parts, one value a group."""
    bins = bins_of(result.table, np.maximum(result.steps, 0))
    record = np.where(result.path >= 0, gain[result.path, bins], 0.0).sum(axis=1)
    return np.asarray(record.reshape(-1, WITHIN).sum(axis=1))


def _shares(result: Evaluation, table: Table) -> Array:
    counts = readings(result, table)
    bins = table.gripper.bins
    return np.asarray((counts + PRIOR / bins) / (counts.sum(axis=1, keepdims=True) + PRIOR))


def _started(table: Table, job: Job, expected: Expectation, seed: int) -> Monitor:
    """A monitor whose charts have seen `BEFORE` healthy parts."""
    monitor = Monitor(table, expected)
    for part in parts(table, squeezed(table, job, BEFORE, seed), seed, HEALTHY):
        monitor.add(part)
    return monitor


def _first(start: Monitor, stretch: list[Part]) -> dict[str, int]:
    """Returns, by chart, the number of the part at which the chart raises its first alarm.

    Parts are counted from 1 at the beginning of the drift. Charts without an alarm are left out.
    """
    monitor, result = copy.deepcopy(start), {}
    for number, part in enumerate(stretch, start=1):
        for alarm in monitor.add(part):
            result.setdefault(alarm.chart, number)
    return result


def _figures(rows: list[dict[str, int]]) -> dict[str, Any]:
    delays = [min(row.values()) for row in rows if row]
    charts = Counter(chart for row in rows for chart in row)
    return {
        "flagged": len(delays) / len(rows),
        "delay_median": float(np.median(delays)) if delays else None,
        "delay_max": max(delays, default=None),
        "by": {chart: count / len(rows) for chart, count in charts.most_common()},
    }
