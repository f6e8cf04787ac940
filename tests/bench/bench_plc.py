"""A million handshakes with a PLC over exchanges that are dropped, doubled, late and reordered.

    python tests/bench/bench_plc.py [--parts 1000000] [--seeds 10] [--output tests/bench/results/plc.json]

In virtual time, on the station that the server serves. Ends with 1 where a result is lost, taken twice or
another's.
"""

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from plc_study import Study

from runtime.plc.handshake import Error

EXCHANGES = ("dropped", "doubled", "late", "discarded", "broken", "stands_still", "power", "double_trigger")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results" / "plc.json")
    given = parser.parse_args()
    counts: Counter[str] = Counter()
    results, wrong = 0, []
    for seed in range(given.seeds):
        study = Study(seed)
        study.run(given.parts // given.seeds)
        try:
            study.check()
        except AssertionError as error:
            wrong.append(f"seed {seed}: {error}")
        results += len(study.program.taken)
        counts += study.counts
        print(
            f"seed {seed}: {len(study.program.taken)} results taken, {process_time():.0f} s of CPU",
            flush=True,
        )
    report = {
        "results_taken": results,
        "lost_doubled_or_mixed_up": len(wrong),
        **{name: counts[name] for name in (*EXCHANGES, "lazy")},
        "cycles_with_error": {error.name: counts[f"error {error.value}"] for error in Error if error},
        "seeds": given.seeds,
    }
    given.output.write_text(json.dumps(report, indent=1) + "\n")
    print("\n".join(wrong) or f"{results} results, none lost, none twice")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
