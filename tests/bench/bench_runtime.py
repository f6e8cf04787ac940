"""Measures what a run costs the cell controller: memory, seconds to the first frame, time of a decision.

    python tests/bench/bench_runtime.py [--tree TREE.msgpack] [--starts 10] [--minutes 30] [--realtime]

Prints the figures beside their limits and writes `results/runtime.json`. The gripper is on a pseudo-terminal
behind the serial driver, the arm on a socket; both are separate processes. With `--minutes` one run lasts
that long, at ten times real speed; its memory and the number of its descriptors must not grow.

A decision takes two microseconds. A clock around a decision therefore also measures interrupts, other
programs and, on a virtual machine, the host. Three figures separate them. The time of a decision contains
everything. The time of arithmetic of the same length (`control_`) shows what the machine adds to any code.
The least of many times of each node and width (`least_`) is what the code costs. Garbage collection adds
nothing, since a decision leaves no garbage. With `--realtime` (as root) no other program interrupts, as on a
controller that has nothing else to do.

Not part of `tools/check`.
"""

import compileall
import gc
import os
import platform
import statistics
import subprocess
import tempfile
import time
from array import array
from pathlib import Path
from typing import Any

import harness
from programs import ROOT, RUNTIME, TABLE, started
from running_cells import RunningCell, runtime_command
from tapped_devices import TappedArm, TappedGripper

from drivers.ports import ObjectState
from runtime.table import REJECT, decision_map, load
from runtime.traversal.decision import Policy, TraversalState, advance, decide

RESULTS = harness.Kept("runtime")
LIMITS = {"rss_mib": 30.0, "first_frame_s": 0.5, "decision_p9999_us": 50.0}
WIDTHS = 256  # of each node
DECISIONS = 1_000_000
ARITHMETIC = 100  # additions that take about as long as a decision
CELL_SPEED = 10.0
STOPPED, PARTS_ENDS = 40, (10,)


class TimedGripper(TappedGripper):
    """A gripper on a pseudo-terminal that notes when the first frame arrives."""

    first_s = 0.0

    def hear(self, data: bytes) -> None:
        self.first_s = self.first_s or time.perf_counter()
        super().hear(data)


def first_frame_s(tree: Path, folder: Path) -> float:
    """Seconds from the start of a grasp-runtime process to its first frame at the gripper."""
    with TimedGripper() as gripper, TappedArm() as arm:
        words = [*RUNTIME, "--tree", str(tree), "--port", gripper.path, "--arm", arm.url]
        words += ["--dry-run", "--journal", str(folder / "none.jsonl")]
        start = time.perf_counter()
        subprocess.run(words, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        return gripper.first_s - start


def watched_run(tree: Path, folder: Path, minutes: float) -> list[dict[str, float]]:
    """Runs grasp-runtime with the serial driver; returns its memory and open descriptors at regular times."""
    with RunningCell(tree, time_scale=CELL_SPEED) as cell:
        more = ("--count", "1000000" if minutes else "6", "--http", "127.0.0.1:0")
        words = runtime_command(tree, cell, folder / "bench.jsonl", *more)
        run = started(words, stdout=subprocess.DEVNULL, stderr=None)
        until = time.monotonic() + 60.0 * minutes
        seen: list[dict[str, float]] = []
        while run.poll() is None:
            if result := memory_of(run.pid):
                seen.append(result)
            if minutes and time.monotonic() > until:
                run.terminate()
                run.wait()
            time.sleep(1.0 if minutes else 0.02)
        if run.returncode not in (0, STOPPED, *PARTS_ENDS):
            raise SystemExit(f"the run ended with exit code {run.returncode}")
    return seen


def rise(seen: list[dict[str, float]], name: str) -> float:
    """The highest value of `name` in the last quarter of a run, less the highest in the second quarter."""
    quarter = max(len(seen) // 4, 1)
    second = seen[quarter : 2 * quarter] or seen
    return max(s[name] for s in seen[-quarter:]) - max(s[name] for s in second)


def memory_of(pid: int) -> dict[str, float]:
    """Peak and present resident memory [MiB] and open descriptors of a process; empty if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return {}
    record = {line.split(":")[0]: line.split() for line in lines}
    if "VmHWM" not in record:
        return {}
    try:
        descriptors = len(list(Path(f"/proc/{pid}/fd").iterdir()))
    except OSError:
        return {}
    sizes = {"peak_mib": "VmHWM", "rss_mib": "VmRSS"}
    mib = {name: int(record[key][1]) / 1024 for name, key in sizes.items()}
    return {**mib, "descriptors": descriptors}


def decision_us(tree: Path) -> dict[str, float]:
    """Times decisions, from a width to the child, for all nodes and widths; returns percentiles [us].

    A decision finds the branch of the width, its target, and what follows. The percentiles of the control and
    of the least times have the prefixes `control_` and `least_`.
    """
    table = load(tree).table
    maps = [decision_map(node, table.gripper) for node in table.nodes]
    widths_um = range(0, table.gripper.opening_um, table.gripper.opening_um // WIDTHS)[:WIDTHS]
    policy, inputs = Policy(), WIDTHS * len(maps)
    clock = time.perf_counter_ns
    # An array: the garbage collector would walk through a list of a million numbers, which no run has.
    spent, control = (array("q", bytes(8 * DECISIONS)) for _ in range(2))
    least = array("q", [1 << 62]) * inputs
    gc.collect()
    for number in range(DECISIONS):
        index, width = divmod(number % inputs, WIDTHS)
        traversal = TraversalState(index)
        start = clock()
        node = table.nodes[index]
        decision = decide(node, maps[index], widths_um[width], ObjectState.CLOSING)
        target = None if decision.branch == REJECT else node.branches[decision.branch].target
        advance(traversal, target, table, policy)
        spent[number] = took = clock() - start
        least[number % inputs] = min(least[number % inputs], took)
    for number in range(DECISIONS):
        start = clock()
        for summand in range(ARITHMETIC):
            index += summand
        control[number] = clock() - start
    figures = percentiles(spent, "") | percentiles(control, "control_")
    return figures | percentiles(least, "least_")


def percentiles(durations: "array[int]", prefix: str) -> dict[str, float]:
    """Percentiles and maximum [us] of durations [ns]; each key begins with `prefix`."""
    spent = sorted(durations)
    places = {name: int(share * len(spent)) for name, share in PERCENTILES.items()}
    at = {prefix + name: spent[place] / 1e3 for name, place in places.items()}
    return {**at, f"{prefix}max_us": spent[-1] / 1e3}


PERCENTILES = {"p50_us": 0.5, "p99_us": 0.99, "p9999_us": 0.9999}


def main() -> None:
    """Measures all figures, prints them and writes them."""
    parser = harness.parser(__doc__)
    parser.add_argument("--tree", type=Path, default=TABLE)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--realtime", action="store_true")
    arguments = parser.parse_args()
    for package in ("runtime", "drivers"):  # an installed package has its bytecode
        compileall.compile_dir(ROOT / package, quiet=1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["XDG_RUNTIME_DIR"] = name
        starts = [first_frame_s(arguments.tree, folder) for _ in range(arguments.starts)]
        seen = watched_run(arguments.tree, folder, arguments.minutes)
        parts = sum(b'"kind":"outcome"' in line for line in (folder / "bench.jsonl").open("rb"))
    memory = {"peak_mib": seen[-1]["peak_mib"], "rise_mib": rise(seen, "rss_mib")}
    memory["descriptors"] = seen[-1]["descriptors"]
    memory["descriptors_rise"] = rise(seen, "descriptors")
    memory |= {"minutes": arguments.minutes, "parts": parts}
    if arguments.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    decision = decision_us(arguments.tree)
    record: dict[str, Any] = {
        "first_frame_s": {"median": statistics.median(starts), "max": max(starts)},
        "memory": memory,
        "decision": {**decision, "decisions": DECISIONS, "realtime": arguments.realtime},
        "limits": LIMITS,
        "python": platform.python_version(),
        "cores": os.cpu_count(),
    }
    harness.show(record)
    RESULTS.write(record)


if __name__ == "__main__":
    main()
