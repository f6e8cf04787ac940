"""Compares a robot that asks a server with a run that drives the robot, and times the server's answers.

    python tests/bench/bench_serve.py [--parts 1000] [--seed 5]

The same simulated parts are located twice, in the planner's contact world. First the executor moves the
robot. Then the client of tools/docs/clients/robot.py moves it, and asks a server in another process. Ends
with 1 if an answer differs.

An executor, unlike a server, may squeeze with the hand turned by 180 degrees if the table's job says that
both fingers close equally far. It also closes fast until just before the width of first contact. So that the
two can be compared, the table here has neither a job nor widths of first contact.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median, quantiles
from time import perf_counter, process_time

import harness
from asking_robots import Served, SimulatedRobot, client, driven
from programs import TABLE

from drivers.sim.physics import scene
from runtime.journal.chain import Journal, records
from runtime.journal.replay import Replay
from runtime.table import dump, load


class Timed:
    """A connection that records the time of each answer."""

    def __init__(self, connection: object) -> None:
        self._connection, self.spent_ms = connection, []

    def ask(self, line: str) -> list[str]:
        began = perf_counter()
        words = self._connection.ask(line)
        self.spent_ms.append(1e3 * (perf_counter() - began))
        return words


def main() -> int:
    parser = harness.parser(__doc__)
    parser.add_argument("--parts", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    table, setting = load(TABLE).table, scene.load(TABLE, None, "planner.world:make")
    table = replace(table, job=None, nodes=tuple(n._replace(contact_um=None) for n in table.nodes))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        dump(table, folder / "t.msgpack")
        with Journal(folder / "driven.jsonl", lambda: "") as journal:
            expected = driven(setting, given.seed, table, given.parts, journal)
        module, robot = client(), SimulatedRobot(setting, given.seed, table)
        with Served(folder / "t.msgpack", "--count", str(given.parts)) as served:
            connection = module.Connection("127.0.0.1", served.port)
            timed = Timed(connection)
            with connection.lines:
                for _ in range(given.parts):
                    robot.cell.scene.next_part()
                    module.locate(timed, robot)
            _, parts, _ = served.ended()
        findings = list(Replay().follow(records(folder / "journal.jsonl")))
    pairs = zip(parts, expected, strict=True)
    same = sum({name: part[name] for name in wanted} == wanted for part, wanted in pairs)
    late = quantiles(timed.spent_ms, n=100)[98]
    print(f"{same} of {given.parts} parts as driven, {len(findings)} findings of the replay")
    print(
        f"{len(timed.spent_ms)} answers: {median(timed.spent_ms):.2f} ms, 99 of 100 within {late:.2f} ms"
    )
    print(f"{process_time():.0f} s of CPU in this process")
    return int(same != given.parts or bool(findings))


if __name__ == "__main__":
    sys.exit(main())
