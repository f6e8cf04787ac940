"""`grasp-runtime --plc`: a PLC is the master of the cell, and requests each part (`tools/docs/plc.md`).

Parts run as without a PLC, except that a trigger of the PLC starts each part.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from math import inf
from typing import TYPE_CHECKING

from runtime.commands.arguments import given
from runtime.commands.options import plc_options
from runtime.commands.recipe import Recipe
from runtime.devices.clock import SystemClock
from runtime.execution import crash, session
from runtime.execution.events import Sighting
from runtime.execution.executor import Cell
from runtime.journal.chain import Journal
from runtime.monitoring.live import server
from runtime.monitoring.monitor import Monitor, Views, notify
from runtime.plc.exchange import Exchange, answer_of, parts_of
from runtime.plc.handshake import OPEN, State
from runtime.plc.modbus import ModbusServer
from runtime.plc.panel import Configuration, Offer, Panel
from runtime.plc.server import PlcServer
from runtime.plc.station import FAULT, Answer, Order, Station
from runtime.shell import interrupts
from runtime.shell.errors import UsageError, exit_code_of
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.results import Outcome, PartResult

if TYPE_CHECKING:
    from runtime.plc.opcua import Security

MODBUS, OPC_UA = "modbus-tcp", "opc.tcp"
WAKE_S = 2.0  # time between two notifications of the service manager
ENDING_S = 5.0  # time for a PLC to end the handshake of the last part
FAREWELL_S = 3.0  # this time where a stop request or an error ends the run
GLANCE_S = 1.0  # time for a PLC to read the last state
EXCLUDED = {
    "serve": "answers a robot that moves itself",
    "check": "moves nothing",
    "dry_run": "moves nothing",
    "put_down": "runs no parts",
    "after_crash": "goes on with a part that no trigger began",
}
OF_ONE_TABLE = ("http", "audit")


def check(arguments: argparse.Namespace) -> server.Address:
    """Checks the options that `--plc` requires or excludes; returns the address to listen at.

    Raises:
        UsageError: the address is invalid, or reachable from other machines without permission; or an
            option conflicts with several tables or with triggers.
    """
    several = OF_ONE_TABLE if len(arguments.trees) > 1 else ()
    excluded = EXCLUDED | dict.fromkeys(several, "needs the only table")
    for name, option in given(arguments).items():
        if name in excluded:
            raise UsageError(f"{option} {excluded[name]}; leave it out, or leave out --plc")
    address = server.served(
        arguments.plc, "--plc", (MODBUS, OPC_UA), network=arguments.network, risk="trigger motions"
    )
    _check_security(arguments, arguments.plc.partition("://")[0])
    return address


def _check_security(arguments: argparse.Namespace, scheme: str) -> None:
    stated = plc_options(arguments)
    if scheme == MODBUS and stated:
        raise UsageError(f"{stated[0]} is for {OPC_UA}; leave it out with {MODBUS}")
    if arguments.plc_insecure and len(stated) > 1:
        raise UsageError(f"--plc-insecure uses no certificates; leave it out, or {stated[0]}")
    if scheme == OPC_UA and find_spec("asyncua") is None:
        raise UsageError(
            f"--plc {OPC_UA} needs asyncua; install squeezetree[opcua]; in a clone: pip install '.[opcua]'"
        )


class ForPlc(Monitor):
    """A monitor that also reports each part's result to the PLC, once it is in the journal."""

    def __init__(self, recipe: Recipe, views: Views, exchange: Exchange) -> None:
        super().__init__(recipe.console, recipe.loaded, recipe.path, views)
        self.recipe, self._exchange = recipe, exchange

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Receives the result of a part, and reports it to the PLC."""
        super().part(result, seen)
        if self.recipe.options.policy.ends_run(result.outcome):
            self._exchange.end()
        self._exchange.finish(answer_of(self.recipe.loaded.table, result))


class PlcRun:
    """Runs the parts that a PLC triggers; each change of the table starts a new run in the journal.

    Args:
        monitors: one for each table, by the tables' numbers; the first has the views.
        server: communicates with the PLC.
        url: address of the server.
    """

    def __init__(self, monitors: Sequence[ForPlc], server: PlcServer, url: str) -> None:
        self.recipes = [monitor.recipe for monitor in monitors]
        self.monitor = monitors[0]  # the one with views
        self._monitors, self._server, self._exchange = monitors, server, server.exchange
        self._clock, self._url, self._count = server.clock, url, self.recipes[0].options.count
        self._parts = 0
        self._stopped = False  # whether a stop request ended a part

    def run(self, cell: Cell) -> int:
        """Serves the PLC until all parts are done, an outcome ends the run or a stop request comes.

        Args:
            cell: devices and records; the journal must already have the header of the first table. The scene
                of a simulated cell has parts of the first table only.

        Returns:
            The exit code.

        Raises:
            Exception: any error that is not the outcome of a part; the PLC receives its exit code first.
        """
        with ExitStack() as stack:
            return self._run(cell, stack)

    def _run(self, cell: Cell, stack: ExitStack) -> int:
        journal, number = cell.journal, 0
        try:
            with session.ending(journal) as tally:
                with interrupts.stoppable():
                    stack.enter_context(self._server)
                self.monitor.note(f"a PLC may connect at {self._url}")
                # the fingers may sweep before the first part
                while not self._exchange.glance.enabled:
                    if not self._ended_withdrawn(journal):
                        self._wait()
                while True:
                    recipe, monitor = self.recipes[number], self._monitors[number]
                    table, numbers = recipe.loaded.table, self._numbers(number, journal)
                    session.run_parts(numbers, table, cell, monitor, tally, recipe.options)
                    order = self._exchange.glance.order
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
            self._exchange.finish(Answer(FAULT, int(exit_code_of(error))))
            if self._exchange.glance.state is not State.READY:
                self._part_with(FAREWELL_S)
            raise
        self._monitors[number].summary(tally, journal.path)
        return tally.exit_code

    def _numbers(self, table: int, journal: Journal) -> Iterator[int]:
        """Yields the number of each triggered part, until the PLC selects another table or the run ends."""
        while self._parts != self._count:
            order = self._exchange.glance.order
            if order is None:
                self._wait()
                continue
            if self._ended_withdrawn(journal):
                continue
            if order.table != table:
                return
            self._parts += 1
            if self._parts == self._count:
                self._exchange.end()
            _note_trigger(journal, order, self._parts)
            yield self._parts

    def _ended_withdrawn(self, journal: Journal) -> bool:
        """Answers a trigger with a fault if the PLC has withdrawn the enable; returns whether it did so."""
        seen = self._exchange.glance
        if seen.order is None or seen.enabled:
            return False
        _note_trigger(journal, seen.order, None)
        self._exchange.finish(Answer(FAULT, int(ExitCode.STOPPED)))
        return True

    def _await_taken(self) -> None:
        """Ignores further triggers; waits, after a stop only briefly, until the last result is taken."""
        self._exchange.end()
        with suppress(KeyboardInterrupt):  # the error that ended the run has priority
            while self._exchange.glance.state in OPEN and not self._stopped:
                self._wait()
            self._part_with(FAREWELL_S if self._stopped else ENDING_S)

    def _part_with(self, seconds: float) -> None:
        """Waits at most `seconds` until a connected PLC has ended the handshake, then `GLANCE_S` more.

        In that time the PLC reads the end of the run.
        """
        until = self._clock.now() + seconds
        while self._exchange.glance.state is not State.READY and self._left(until) > 0.0:
            self._wait(self._left(until))
        until = self._clock.now() + GLANCE_S
        while self._left(until) > 0.0:
            self._wait(self._left(until))

    def _left(self, until: float) -> float:
        """Seconds until the time `until` if a PLC is connected, else 0."""
        return until - self._clock.now() if self._exchange.connected else 0.0

    def _wait(self, seconds: float = inf) -> None:
        with interrupts.stoppable():
            self._exchange.wait(min(seconds, WAKE_S))
        self._server.check()
        notify("WATCHDOG=1")


def _note_trigger(journal: Journal, order: Order, part: int | None) -> None:
    """Journals an accepted trigger with the number of its part; None: the enable was withdrawn before."""
    fields = {"part": part, "trigger_id": order.trigger_id, "table_number": order.table}
    journal.record("trigger", fields)


def opened(
    arguments: argparse.Namespace, recipes: Sequence[Recipe], views: Views, stack: ExitStack
) -> PlcRun:
    """Prepares the run for a PLC; connections to the address of `--plc` are refused until it begins.

    The address is held until `stack` closes.

    Raises:
        UsageError: the address is not available, or the tables are for different grippers.
        InputError: a key or certificate of an OPC UA server is refused.
    """
    first = recipes[0]
    for recipe in recipes:
        if recipe.loaded.table.gripper != first.loaded.table.gripper:
            raise UsageError(
                f"--tree {recipe.path} is for another gripper than {first.path}; recompile one of them"
            )
    address = check(arguments)
    # What a PLC sent before the run begins would move the gripper late.
    listener = stack.enter_context(server.listening(address, "--plc", at_once=False))
    scheme = arguments.plc.partition("://")[0]
    digests = [int(recipe.loaded.digest[:8], 16) for recipe in recipes]
    station = Station(digests, first.options.takt_s, beats=scheme == MODBUS)
    exchange = Exchange(station, SystemClock())
    monitors = [
        ForPlc(recipe, views if recipe is first else Views(), exchange) for recipe in recipes
    ]
    served: PlcServer = ModbusServer(listener, exchange)
    if scheme == OPC_UA:
        from runtime.plc.opcua import OpcUaServer  # with a library that no other run has to load

        panel = Panel([*_offers(recipes)], _configuration(arguments, first), exchange.glance)
        served = OpcUaServer(listener, exchange, panel, _security(arguments))
    place = server.Address(address.host, listener.getsockname()[1])
    return PlcRun(monitors, served, f"{scheme}://{place}")


def _security(arguments: argparse.Namespace) -> "Security | None":
    from runtime.plc import certificates, opcua

    if arguments.plc_insecure:
        return None
    journal = arguments.journal
    folder = arguments.plc_certificates or journal.with_name(f"{journal.name}.opcua")
    trust = certificates.Trust(folder / certificates.PINNED, arguments.plc_trusted)
    return opcua.Security(certificates.identity_in(folder), trust)


def _offers(recipes: Sequence[Recipe]) -> Iterator[Offer]:
    """Yields the tables for OPC UA, by file name; a number precedes a name that two tables have."""
    names = [recipe.path.stem for recipe in recipes]
    for number, (name, recipe) in enumerate(zip(names, recipes, strict=True)):
        unique = name if names.count(name) == 1 else f"{number}-{name}"
        yield Offer(unique, recipe.loaded.digest, parts_of(recipe.loaded.table))


def _configuration(arguments: argparse.Namespace, recipe: Recipe) -> Configuration:
    if arguments.calibration is None:
        return Configuration("linear map", "")
    return Configuration(arguments.calibration.name, str(recipe.software["calibration_sha256"]))
