"""A million handshakes with a PLC over exchanges that are dropped, doubled, late and reordered.

    python tests/bench/bench_plc.py [--parts 1000000] [--seeds 20] [--workers 2]
        [--output tests/bench/results/plc.json]
    python tests/bench/bench_plc.py --opc-ua 100

In virtual time, on the station that the server serves; or so many parts over OPC UA by asyncua's client, with
an encrypted channel to the command. Ends with 1 where a result is lost, taken twice or another's.
"""

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from plc_programs import PlcServed
from plc_study import Study
from served import ROOT
from supervisor import Supervisor, passport

from runtime.plc.handshake import Error

EXCHANGES = (
    "dropped",
    "doubled",
    "late",
    "discarded",
    "broken",
    "stands_still",
    "power",
    "double_trigger",
)


def studied(seed: int, parts: int) -> tuple[int, Counter[str], str]:
    """Results taken, what went wrong with the exchanges, and why the handshake is wrong where it is."""
    study = Study(seed)
    study.run(parts)
    try:
        study.check()
    except AssertionError as error:
        return len(study.program.taken), study.counts, f"seed {seed}: {error}"
    return len(study.program.taken), study.counts, ""


def over_opc_ua(parts: int) -> bool:
    """Run parts over OPC UA; whether each result is that of its part, once and in order."""
    words = ("--time-scale", "max", "--world", "runtime.devices.rehearsal:make")
    with tempfile.TemporaryDirectory() as folder:
        identity, tree = passport(Path(folder), "identity"), Path(folder) / "rectangle.msgpack"
        tree.write_bytes((ROOT / "trees" / "rectangle" / "rectangle.msgpack").read_bytes())
        with PlcServed(tree, more=words, count=parts, plc="opc.tcp://127.0.0.1:0") as served:
            with Supervisor(served.port, identity) as line:
                line.begin("rectangle")
                began_s = time.monotonic()
                results = [line.part(str(number)) for number in range(parts)]
                took_s = time.monotonic() - began_s
            printed = served.ended()[1]
    outcomes = Counter(result["Outcome"] for result in results)
    print(f"{parts} parts over OPC UA in {took_s:.1f} s: {dict(outcomes)}")
    numbers = [int(result["MeasId"]) for result in results]
    handles = [result["ResultHandle"] for result in results]
    return (
        numbers == list(range(parts))
        and handles == list(range(1, parts + 1))
        and len(printed) == parts
        and outcomes["located"] == sum(part["outcome"] == "leaf" for part in printed)
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parent / "results" / "plc.json"
    )
    parser.add_argument("--opc-ua", type=int, metavar="PARTS")
    given = parser.parse_args()
    if given.opc_ua is not None:
        return int(not over_opc_ua(given.opc_ua))
    counts: Counter[str] = Counter()
    results, wrong = 0, []
    parts = given.parts // given.seeds
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        for taken, more, problem in pool.map(studied, range(given.seeds), [parts] * given.seeds):
            results += taken
            counts += more
            wrong += [problem] if problem else []
            print(f"{results} results taken so far", flush=True)
    report = {
        "results_taken": results,
        "lost_doubled_or_mixed_up": len(wrong),
        **{name: counts[name] for name in (*EXCHANGES, "lazy")},
        "cycles_with_error": {
            error.name: counts[f"error {error.value}"] for error in Error if error
        },
        "seeds": given.seeds,
    }
    given.output.write_text(json.dumps(report, indent=1) + "\n")
    print("\n".join(wrong) or f"{results} results, none lost, none twice")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
