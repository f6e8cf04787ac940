"""`grasp-runtime --plc`: a PLC is the master of the cell, and asks for part after part (`tools/docs/plc.md`).

Parts are run as without it; only what begins the next one is the PLC's trigger.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from math import inf
from urllib.parse import urlsplit

from drivers.ports import Scene
from runtime.commands.arguments import parser
from runtime.commands.recipe import Recipe
from runtime.devices.clock import SystemClock
from runtime.execution import crash, session
from runtime.execution.events import Sighting
from runtime.execution.executor import Cell
from runtime.journal.chain import Journal
from runtime.monitoring.live import server
from runtime.monitoring.live.server import Address
from runtime.monitoring.monitor import Monitor, Views, notify
from runtime.plc.exchange import Exchange, answer_of
from runtime.plc.handshake import OPEN, State
from runtime.plc.modbus import ModbusServer
from runtime.plc.station import FAULT, Answer, Station
from runtime.shell import interrupts
from runtime.shell.errors import UsageError, exit_code_of
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.results import Outcome, PartResult

SCHEME = "modbus-tcp"
WAKE_S = 2.0  # between two words to the service manager
ENDING_S = 5.0  # for a PLC to end the handshake of the last part
FAREWELL_S = 3.0  # the same where a stop request or an error ends the run
GLANCE_S = 1.0  # for a PLC to read once more
EXCLUDED = {
    "serve": "answers a robot that moves itself",
    "check": "moves nothing",
    "dry_run": "moves nothing",
    "put_down": "runs no parts",
    "after_crash": "goes on with a part that no trigger began",
}
OF_ONE_TABLE = ("watch", "http", "audit")


def check(arguments: argparse.Namespace) -> Address:
    """Check what `--plc` goes with; returns where to listen.

    Raises:
        UsageError: it names no address, one of another machine's reach that was not allowed, or comes
            with an option that needs the only table, or with which no trigger begins the parts.
    """
    defaults = parser()
    several = OF_ONE_TABLE if len(arguments.trees) > 1 else ()
    for name, reason in (EXCLUDED | dict.fromkeys(several, "needs the only table")).items():
        if getattr(arguments, name) != defaults.get_default(name):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} {reason}; leave it out, or leave out --plc")
    scheme, _, place = arguments.plc.partition("://")
    if scheme != SCHEME or not place or urlsplit(f"//{place}").path:
        raise UsageError(f"--plc {arguments.plc}: write {SCHEME}://127.0.0.1:PORT")
    address = server.parse(place, "--plc")
    if not (arguments.network or server.is_loopback(address.host)):
        raise UsageError(
            f"--plc {arguments.plc}: there is no password, and whoever reaches that address may trigger "
            "motions; add --network if nothing but the cell's own network does"
        )
    return address


class ForPlc(Monitor):
    """A monitor that also gives each part's result to the PLC, once it is in the journal."""

    def __init__(self, recipe: Recipe, views: Views, exchange: Exchange) -> None:
        super().__init__(recipe.console, recipe.loaded, recipe.path, views)
        self._recipe, self._exchange = recipe, exchange

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """One part's end."""
        super().part(result, seen)
        if self._recipe.options.policy.ends_run(result.outcome):
            self._exchange.end()
        self._exchange.finish(answer_of(self._recipe.loaded.table, result), result.seconds)


class PlcRun:
    """Runs the parts that a PLC triggers; each change of the table ends a run in the journal.

    Args:
        recipes: the tables, by their numbers.
        monitors: of each table.
        server: of the registers.
        address: where it listens.
        count: of parts in all, None for no end.
    """

    def __init__(
        self,
        recipes: Sequence[Recipe],
        monitors: Sequence[Monitor],
        server: ModbusServer,
        address: Address,
        count: int | None,
    ) -> None:
        self.recipes = recipes
        self.monitor = monitors[0]  # the one that has views
        self._monitors, self._server, self._exchange = monitors, server, server.exchange
        self._clock, self._address, self._count = server.clock, address, count
        self._parts = 0
        self._stopped = False  # whether a stop request ended a part

    def run(self, cell: Cell, scene: Scene | None, *, activate: bool) -> int:
        """Serve until the parts are over, one ends the run or a stop request comes; returns the exit code.

        The journal has the header of the first table. A simulated scene brings parts for that table.

        Raises:
            Exception: any error but those that a part ends with; a part under way ends with its code.
        """
        self.monitor.note(f"a PLC may connect at {SCHEME}://{self._address}")
        with self._server:
            return self._run(cell, scene, activate=activate)

    def _run(self, cell: Cell, scene: Scene | None, *, activate: bool) -> int:
        journal, number = cell.journal, 0
        try:
            with session.ending(journal) as tally:
                while not self._exchange.enabled:  # the fingers may sweep before the first part
                    if not self._ended_withdrawn():
                        self._wait()
                while True:
                    recipe = self.recipes[number]
                    table, monitor = recipe.loaded.table, self._monitors[number]
                    batch = session.Batch(self._numbers(number, journal), activate)
                    session.run_batch(table, cell, scene, monitor, tally, batch, recipe.options)
                    order = self._exchange.order
                    if order is None:
                        break
                    number = order.table
                    session.end_run(journal, tally)
                    after = self.recipes[number]
                    crash.begin(journal, None, after.loaded.data, after.header, crash.ABORT)
                self._stopped = tally.outcomes[Outcome.STOPPED] > 0
                self._await_taken()
        except BaseException as error:
            self._exchange.end()
            self._exchange.finish(Answer(FAULT, exit_code_of(error)))
            if self._exchange.state is not State.READY:
                self._part_with(FAREWELL_S)
            raise
        self._monitors[number].summary(tally, journal.path)
        return tally.exit_code

    def _numbers(self, table: int, journal: Journal) -> Iterator[int]:
        """Numbers of parts while the PLC asks for this table."""
        while self._parts != self._count:
            order = self._exchange.order
            if order is None:
                self._wait()
                continue
            if self._ended_withdrawn():
                continue
            if order.table != table:
                return
            self._parts += 1
            if self._parts == self._count:
                self._exchange.end()
            fields = {"part": self._parts, "trigger_id": order.trigger_id, "table_number": table}
            journal.record("trigger", fields)
            yield self._parts

    def _ended_withdrawn(self) -> bool:
        """End a part whose enabling was withdrawn before anything moved; whether there was one."""
        withdrawn = self._exchange.order is not None and not self._exchange.enabled
        if withdrawn:
            self._exchange.finish(Answer(FAULT, ExitCode.STOPPED))
        return withdrawn

    def _await_taken(self) -> None:
        """The run is over: no trigger counts, and the last result stays until it is taken."""
        self._exchange.end()
        with suppress(KeyboardInterrupt):  # what ended the run came first
            while self._exchange.state in OPEN and not self._stopped:
                self._wait()
            self._part_with(FAREWELL_S if self._stopped else ENDING_S)

    def _part_with(self, seconds: float) -> None:
        """Leave a PLC that is connected time to end the handshake, and to see that it has ended."""
        until = self._clock.now() + seconds
        while self._exchange.state is not State.READY and self._left(until) > 0.0:
            self._wait(self._left(until))
        until = self._clock.now() + GLANCE_S
        while self._left(until) > 0.0:
            self._wait(self._left(until))

    def _left(self, until: float) -> float:
        """Seconds that are left for a PLC; none once it is gone."""
        return until - self._clock.now() if self._exchange.connected else 0.0

    def _wait(self, seconds: float = inf) -> None:
        with interrupts.stoppable():
            self._exchange.wait(min(seconds, WAKE_S))
        notify("WATCHDOG=1")


def opened(
    arguments: argparse.Namespace, recipes: Sequence[Recipe], views: Views, stack: ExitStack
) -> PlcRun:
    """Listen where `--plc` says, which `stack` ends; registers are served once the run begins.

    Raises:
        UsageError: nothing can listen there, or the tables are for different grippers.
    """
    first = recipes[0]
    for recipe in recipes:
        if recipe.loaded.table.gripper != first.loaded.table.gripper:
            raise UsageError(
                f"--tree {recipe.path} is for another gripper than {first.path}; recompile one of them"
            )
    address, clock = check(arguments), SystemClock()
    listener = stack.enter_context(server.listening(address, "--plc"))
    digests = [int(recipe.loaded.digest[:8], 16) for recipe in recipes]
    exchange = Exchange(Station(digests, first.options.takt_s), clock)
    monitors = [
        ForPlc(recipe, views if recipe is first else Views(), exchange) for recipe in recipes
    ]
    place = Address(address.host, listener.getsockname()[1])
    return PlcRun(
        recipes, monitors, ModbusServer(listener, exchange, clock), place, arguments.count
    )
