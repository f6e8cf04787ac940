"""Runs handshakes with a PLC: a million over a faulty line in virtual time, or some with real clients.

    python tests/bench/bench_plc.py [--parts 1000000] [--seeds 20] [--workers 2]
        [--output tests/bench/results/plc.json]
    python tests/bench/bench_plc.py --modbus 100
    python tests/bench/bench_plc.py --opc-ua 100 [--node-modules FOLDER/node_modules]

The first form simulates a PLC in virtual time, with the station that the server uses. Exchanges are dropped,
doubled, late or reordered. The second runs parts over Modbus TCP through the command, by pymodbus' client, by
libmodbus and by the structured text of tools/docs/plc.md. The third runs parts over OPC UA: by asyncua's
client on an encrypted channel, or by node-opcua's, if its folder of modules is stated (`npm install
node-opcua-client` makes it).

Ends with 1 if a result is lost, taken twice or taken for another part, or if OPC UA does not show all states.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import harness
from plc_programs import PlcServed, by_libmodbus, by_pymodbus, in_structured_text
from plc_study import Study
from programs import REHEARSAL, TABLE, until
from supervisor import Supervisor, passport

from runtime.plc.handshake import Error
from runtime.plc.panel import AUTOMATIC, MACHINE
from runtime.plc.registers import OUTCOMES
from runtime.plc.station import Answer
from runtime.plc.vision import VisionState
from runtime.traversal.results import Outcome

MODBUS, OPC_UA = "modbus-tcp://127.0.0.1:0", "opc.tcp://127.0.0.1:0"
EXCHANGES = ("dropped", "doubled", "late", "discarded", "broken", "stands_still", "power")
EXCHANGES += ("double_trigger", "lazy")


def studied(seed: int, parts: int) -> tuple[int, Counter[str], str]:
    """Simulates handshakes of one seed.

    Returns:
        Number of results taken, counts of faults, and the error of the handshake as text, empty if there is
        none.
    """
    study = Study(seed)
    study.run(parts)
    try:
        study.check()
    except AssertionError as error:
        return len(study.program.taken), study.counts, f"seed {seed}: {error}"
    return len(study.program.taken), study.counts, ""


def by_asyncua(port: int, folder: Path, parts: int) -> tuple[list[dict[str, Any]], set[str]]:
    """Runs parts by asyncua's client; returns their results and the states seen.

    If `parts` is 0, a part is started and aborted.
    """
    with Supervisor(port, passport(folder, f"identity-{parts}")) as line:
        line.follow()
        seen = {line[f"{MACHINE}/CurrentState"]}
        line.begin("rectangle")
        results = [line.part(str(number)) for number in range(parts)]
        if parts == 0:
            line.start("aborted")
            line.call(f"{AUTOMATIC}/Abort")
        line.until(f"{MACHINE}/CurrentState", "Halted" if parts else "Error")
        seen.add(line[f"{MACHINE}/CurrentState"])
        until(lambda: line.events[-1].endswith("Halted" if parts else "Error"), "the last event")
        return results, seen.union(*(event.split("To") for event in line.events))


def by_node(
    modules: Path, port: int, folder: Path, parts: int
) -> tuple[list[dict[str, Any]], set[str]]:
    """Runs parts by node-opcua's client; returns their results and the states seen.

    If `parts` is 0, a part is started and aborted.
    """
    words = ["node", Path(__file__).parent / "opcua_supervisor.cjs", port, "rectangle", parts]
    certificates = folder / f"certificates-{parts}"
    environment = {**os.environ, "NODE_PATH": str(modules.resolve())}
    subprocess.run([str(word) for word in (*words, certificates)], env=environment, check=True)
    document = json.loads((certificates / "document.json").read_text())
    return document["results"], set(document["states"])


def over_opc_ua(parts: int, modules: Path | None) -> bool:
    """Runs parts over OPC UA; returns whether all results arrive in order and all states are seen."""
    client = by_asyncua if modules is None else partial(by_node, modules)
    with tempfile.TemporaryDirectory() as folder:
        with served(Path(folder) / "parts", "max", parts, OPC_UA) as run:
            began_s = time.monotonic()
            results, seen = client(run.port, run.journal.parent, parts)
            took_s = time.monotonic() - began_s
            printed = run.ended()[1]
        with served(Path(folder) / "aborted", "12", 1, OPC_UA) as run:
            seen |= client(run.port, run.journal.parent, 0)[1]
    outcomes = Counter(result["Outcome"] for result in results)
    print(f"{parts} parts over OPC UA in {took_s:.1f} s: {dict(outcomes)}; states {sorted(seen)}")
    return (
        [result["MeasId"] for result in results] == [str(number) for number in range(parts)]
        and [result["ResultHandle"] for result in results] == list(range(1, parts + 1))
        and len(printed) == parts
        and outcomes["located"] == sum(part["outcome"] == "leaf" for part in printed)
        and seen >= {state.value for state in VisionState}
    )


def over_modbus(parts: int, client: Callable[[int, int], list[dict[str, int]]]) -> bool:
    """Runs parts over Modbus TCP by a client; returns whether all results arrive in order."""
    folder = tempfile.TemporaryDirectory()
    with folder, served(Path(folder.name) / "parts", "max", parts, MODBUS) as run:
        began_s = time.monotonic()
        results = client(run.port, parts)
        took_s = time.monotonic() - began_s
        printed = run.ended()[1]
    outcomes = Counter(OUTCOMES[result["outcome"]] for result in results)
    print(f"{client.__name__}: {parts} parts over Modbus in {took_s:.1f} s: {dict(outcomes)}")
    expected = [(answer.outcome, answer.x) for answer in map(registers_of, printed)]
    return [(result["outcome"], result["x"]) for result in results] == expected


def registers_of(part: dict[str, Any]) -> Answer:
    """Outcome and x coordinate that a PLC should read; `part` is what `grasp-runtime --json` prints."""
    outcome = Outcome(part["outcome"])
    x_mm = part["predicted_pose"]["x_mm"] if outcome is Outcome.LEAF else 0.0
    code = [Outcome.LEAF, Outcome.REJECT, Outcome.UNRESOLVED, Outcome.FAULT].index(outcome) + 1
    return Answer(outcome=code, x=round(1e3 * x_mm))


def served(folder: Path, time_scale: str, count: int, plc: str) -> PlcServed:
    """Starts a run of the simulated cell that waits for a PLC or a supervisor at the address `plc`."""
    folder.mkdir()
    tree = folder / "rectangle.msgpack"
    tree.write_bytes(TABLE.read_bytes())
    return PlcServed(tree, more=("--time-scale", time_scale, *REHEARSAL), count=count, plc=plc)


def main() -> int:
    parser = harness.parser(__doc__)
    parser.add_argument("--parts", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--output", type=Path, default=harness.Kept("plc").path)
    parser.add_argument("--modbus", type=int, metavar="PARTS")
    parser.add_argument("--opc-ua", type=int, metavar="PARTS")
    parser.add_argument("--node-modules", type=Path, metavar="FOLDER")
    given = parser.parse_args()
    if given.modbus is not None:
        clients = (by_pymodbus, by_libmodbus, in_structured_text)
        return int(not all(over_modbus(given.modbus, client) for client in clients))
    if given.opc_ua is not None:
        return int(not over_opc_ua(given.opc_ua, given.node_modules))
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
        **{name: counts[name] for name in EXCHANGES},
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
