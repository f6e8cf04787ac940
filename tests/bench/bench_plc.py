"""A million handshakes with a PLC over exchanges that are dropped, doubled, late and reordered.

    python tests/bench/bench_plc.py [--parts 1000000] [--seeds 20] [--workers 2]
        [--output tests/bench/results/plc.json]

In virtual time, on the station that the server serves. Ends with 1 where a result is lost, taken twice or
another's.
"""

import argparse
import json
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from plc_study import Study

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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parent / "results" / "plc.json"
    )
    given = parser.parse_args()
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
