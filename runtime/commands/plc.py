"""`grasp-runtime --plc`: runs a part at each trigger of a PLC, which is the master (`tools/docs/plc.md`)."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
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
from runtime.shell.errors import ExpectedError, UsageError, exit_code_of
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.results import Outcome, PartResult

if TYPE_CHECKING:
    from runtime.plc.opcua import Security

MODBUS, OPC_UA = "modbus-tcp", "opc.tcp"
WAKE_S = 2.0  # longest time between two notifications of the service manager's watchdog
ENDING_S = 5.0  # time for a PLC to end the handshake of the last part
FAREWELL_S = 3.0  # the same time if a stop request or an error ends the run
GLANCE_S = 1.0  # time for a PLC to read the registers after the last handshake
EXCLUDED = {
    "serve": "answers a robot that moves itself",
    "check": "moves nothing",
    "dry_run": "moves nothing",
    "put_down": "runs no parts",
    "after_crash": "goes on with a part that no trigger began",
}
OF_ONE_TABLE = ("http", "audit")


def check(arguments: argparse.Namespace) -> server.Address:
    """Checks that the other options are allowed with `--plc`; returns the address to listen at.

    Raises:
        UsageError: the address is invalid, or other machines reach it although `--network` is missing; or an
            option is not allowed with `--plc` or with several tables.
    """
    for name, option in given(arguments).items():
        if name in EXCLUDED:
            raise UsageError(f"{option} {EXCLUDED[name]}; leave it out, or leave out --plc")
        if name in OF_ONE_TABLE and len(arguments.trees) > 1:
            raise UsageError(f"{option} is for a single table; leave it out, or name one --tree")
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
    """A monitor that also reports each part's result to the PLC, after the result is in the journal."""

    def __init__(self, recipe: Recipe, views: Views, exchange: Exchange) -> None:
        super().__init__(recipe.console, recipe.loaded, recipe.path, views)
        self.recipe, self._exchange = recipe, exchange

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Passes the result of a part to the monitor's observers, then to the PLC."""
        super().part(result, seen)
        if self.recipe.options.policy.ends_run(result.outcome):
            self._exchange.end()
        self._exchange.finish(answer_of(self.recipe.loaded.table, result))


class PlcRun:
    """Runs the parts that a PLC triggers; when the PLC selects another table, the journal gets a new run.

    Args:
        monitors: one for each table, in the order of `--tree`; only the first serves the live page.
        server: communicates with the PLC.
        url: address of the server.
    """

    def __init__(self, monitors: Sequence[ForPlc], server: PlcServer, url: str) -> None:
        self.recipes = [monitor.recipe for monitor in monitors]
        self.monitor = monitors[0]  # the monitor that serves the live page
        self._monitors, self._server, self._exchange = monitors, server, server.exchange
        self._clock, self._url, self._count = server.clock, url, self.recipes[0].options.count
        self._parts = 0
        self._noted: Order | None = None  # the order whose trigger was recorded last
        self._stopped = False  # whether a stop request ended a part

    def run(self, cell: Cell) -> int:
        """Runs triggered parts until all are done, an outcome ends the run, or a stop is requested.

        Args:
            cell: the devices and the journal. The journal must already have the header of the first table's
                run. The scene of a simulated cell has parts of the first table only.

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
            with session.ending(journal) as tally, self._noting(journal):
                with interrupts.stoppable():
                    stack.enter_context(self._server)
                self.monitor.note(f"a PLC may connect at {self._url}")
                # Not before the PLC enables triggers: the fingers may move when a run of parts begins.
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
        """Yields a part's number at each trigger, until all parts are done or a trigger names another table.

        Args:
            table: number of the table of these parts.
            journal: records the triggers.
        """
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
            self._note(journal, order, self._parts)
            yield self._parts

    def _ended_withdrawn(self, journal: Journal) -> bool:
        """If enabling has ended since the PLC's trigger, ends the triggered part with a fault.

        It does so even if the PLC has enabled triggers again: what moves needs a new trigger.

        Returns:
            Whether a part was ended in this way.
        """
        seen = self._exchange.glance
        if seen.order is None or not seen.withdrawn:
            return False
        self._note_unbegun(journal)
        self._exchange.finish(Answer(FAULT, int(ExitCode.STOPPED)))
        return True

    @contextmanager
    def _noting(self, journal: Journal) -> Iterator[None]:
        """Context of a run: if it ends by an error, a trigger whose part has not begun is recorded, too."""
        try:
            yield
        except BaseException:
            with suppress(ExpectedError):  # the error that ends the run counts
                self._note_unbegun(journal)
            raise

    def _note_unbegun(self, journal: Journal) -> None:
        """Records the accepted trigger of a part that ends before it has begun, if there is one."""
        order = self._exchange.glance.order
        if order is not None and order is not self._noted:
            self._note(journal, order, None)

    def _note(self, journal: Journal, order: Order, part: int | None) -> None:
        """Records an accepted trigger of the PLC.

        Args:
            journal: the journal.
            order: what the trigger requests.
            part: number of the part; None if no part runs, since enabling or the run has ended.
        """
        self._noted = order
        fields = {"part": part, "trigger_id": order.trigger_id, "table_number": order.table}
        journal.record("trigger", fields)

    def _await_taken(self) -> None:
        """Refuses further triggers, and waits until the PLC has taken the last result.

        After a stop request the wait is limited to `FAREWELL_S`.
        """
        self._exchange.end()
        with suppress(KeyboardInterrupt):  # the run is over: a stop request only ends the wait
            while self._exchange.glance.state in OPEN and not self._stopped:
                self._wait()
            self._part_with(FAREWELL_S if self._stopped else ENDING_S)

    def _part_with(self, seconds: float) -> None:
        """Waits at most `seconds` until a connected PLC has ended the handshake.

        Then waits `GLANCE_S` more, so that the PLC can read that the run has ended.
        """
        until = self._clock.now() + seconds
        while self._exchange.glance.state is not State.READY and self._left(until) > 0.0:
            self._wait(self._left(until))
        until = self._clock.now() + GLANCE_S
        while self._left(until) > 0.0:
            self._wait(self._left(until))

    def _left(self, until: float) -> float:
        """Seconds that are left until the clock shows `until`; 0 if no PLC is connected."""
        return until - self._clock.now() if self._exchange.connected else 0.0

    def _wait(self, seconds: float = inf) -> None:
        with interrupts.stoppable():
            self._exchange.wait(min(seconds, WAKE_S))
        self._server.check()
        notify("WATCHDOG=1")


def opened(
    arguments: argparse.Namespace, recipes: Sequence[Recipe], views: Views, stack: ExitStack
) -> PlcRun:
    """Prepares a run for a PLC: reserves the address of `--plc`, and builds the server.

    Until the run begins, connections to the address are refused.

    Args:
        arguments: the parsed command line.
        recipes: the tables, in the order of `--tree`.
        views: options of the status and the live page, for the first table's monitor.
        stack: when it closes, the address is released.

    Raises:
        UsageError: the address is not available, or the tables are for different grippers.
        InputError: a key or a certificate for OPC UA is refused.
    """
    first = recipes[0]
    for recipe in recipes:
        if recipe.loaded.table.gripper != first.loaded.table.gripper:
            raise UsageError(
                f"--tree {recipe.path} is for another gripper than {first.path}; recompile one of them"
            )
    address = check(arguments)
    # Not listening yet: a trigger that a PLC sent now would move the gripper only when the run begins.
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
    """Yields the recipes that OPC UA clients can select, named by the files of their tables.

    If two tables have the same file name, the number of the table precedes the name.
    """
    names = [recipe.path.stem for recipe in recipes]
    for number, (name, recipe) in enumerate(zip(names, recipes, strict=True)):
        unique = name if names.count(name) == 1 else f"{number}-{name}"
        yield Offer(unique, recipe.loaded.digest, parts_of(recipe.loaded.table))


def _configuration(arguments: argparse.Namespace, recipe: Recipe) -> Configuration:
    if arguments.calibration is None:
        return Configuration("linear map", "")
    return Configuration(arguments.calibration.name, str(recipe.software["calibration_sha256"]))
