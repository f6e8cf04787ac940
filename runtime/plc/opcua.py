"""An OPC UA server modelled on OPC 40100-1 (machine vision), for one master and any number of readers.

asyncua encodes and encrypts messages, and serves the address space. The values of the variables come from the
panel (`runtime.plc.panel`). The methods write to the same registers as a PLC does over Modbus
(`runtime.plc.station`).
"""

import asyncio
import logging
import os
import signal
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple, get_type_hints

from asyncua import ua

from runtime.plc.address_space import TYPES, AddressSpace, Arguments, argument
from runtime.plc.admission import GuardedServer, ListeningServer, Session, caller
from runtime.plc.certificates import Identity, Trust
from runtime.plc.exchange import Exchange
from runtime.plc.handshake import Error
from runtime.plc.panel import AUTOMATIC, MACHINE, RECIPES, RESULTS, Panel, Value
from runtime.plc.server import PlcServer
from runtime.plc.station import Glance
from runtime.plc.vision import Job, Result, VisionState, waits

CLOSING_S = 5.0  # time for connections to close when the server ends
LONGEST_TEXT = 100  # most characters of an argument
NO_TABLE = 0xFFFF  # in the register `table`: no recipe is prepared
# URI of the product, and application URI of a server without a certificate.
BARE_URI = "urn:squeezetree:grasp-runtime"
DONE = (0, "")  # outputs `error` and `message` of a successful command
REASONS = {
    Error.NOT_ENABLED: "automatic mode is not selected; call SelectModeAutomatic",
    Error.PART_UNDER_WAY: "a part is under way; wait for its result",
    Error.RESULT_WAITS: "a result waits; release it",
    Error.UNKNOWN_TABLE: "no recipe is prepared; call PrepareRecipe",
    Error.RUN_ENDED: "the run has ended; start the command again",
}

Outputs = tuple[Value | list[str], ...]
Act = Callable[..., Outputs | ua.StatusCode | None]  # None stands for `DONE`

logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # any client could fill the log


class Security(NamedTuple):
    """What an encrypted endpoint needs: the server's key and certificate, and which clients are trusted."""

    identity: Identity
    trust: Trust


class OpcUaServer(PlcServer):
    """The OPC UA server: shows clients the values of a panel, and lets one client, the master, request parts.

    Args:
        listener: the socket on which the server listens.
        exchange: connects the server with the run. Its station expects no heartbeat in registers, since the
            session of a silent client ends.
        panel: the values that the server shows.
        security: the server's key and certificate, and the trusted clients; None: nothing is encrypted.
    """

    def __init__(
        self, listener: socket.socket, exchange: Exchange, panel: Panel, security: Security | None
    ) -> None:
        super().__init__(exchange)
        self._listener, self._panel, self._security = listener, panel, security
        self._master: Session | None = None
        self._jobs = 0
        self._begun = self.clock.stamp()
        self._glances: deque[Glance] = deque()

    async def serve(self, stop: asyncio.Event) -> None:
        """Serves clients until `stop` is set, see `PlcServer.serve`."""
        self._news, self._showing = asyncio.Event(), asyncio.Lock()
        server = await self._configured()
        self._space = AddressSpace(server)
        await self._space.build(self._panel.values())
        for method in self._methods():
            await self._space.add_method(*method)
        self.exchange.watch = self._watch
        self.exchange.put({"table": NO_TABLE})
        await server.listen(self._listener)
        self.started.set()
        try:
            async with asyncio.TaskGroup() as group:
                following = group.create_task(self._follow())
                await stop.wait()
                following.cancel()
        finally:
            self.exchange.watch = lambda _: None
            with suppress(TimeoutError):
                await asyncio.wait_for(server.stop(), CLOSING_S)

    async def _configured(self) -> ListeningServer:
        security = self._security
        internal = GuardedServer(None if security is None else security.trust, self._leave)
        server = ListeningServer(iserver=internal)
        server.name, server.manufacturer_name = "squeezetree grasp-runtime", "squeezetree"
        server.product_uri = BARE_URI
        server.application_type = ua.ApplicationType.Server
        await server.init()
        host, port = self._listener.getsockname()[:2]
        server.set_endpoint(f"opc.tcp://{f'[{host}]' if ':' in host else host}:{port}/")
        await server.set_application_uri(BARE_URI if security is None else security.identity.uri)
        # Clients need no user name: the certificate of the secure channel identifies them.
        server.set_identity_tokens([ua.AnonymousIdentityToken])
        policy = ua.SecurityPolicyType.NoSecurity
        if security is not None:
            policy = ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt
            internal.certificate = security.identity.certificate
            internal.private_key = security.identity.key
        server.set_security_policy([policy])
        return server

    # -- the master -----------------------------------------------------------------------------------

    def _may_command(self, session: Session) -> bool:
        """Whether a session may give commands: only one session, the master, may.

        If there is no master, the asking session becomes the master until it ends.
        """
        if self._master is None:
            self._master = session
            self.exchange.connected = True
        return self._master is session

    def _leave(self, session: Session) -> None:
        if self._master is session:
            self._master = None
            self.exchange.disconnect()

    # -- what is shown --------------------------------------------------------------------------------

    def _watch(self, seen: Glance) -> None:
        """Queues a new state of the station, which `_show` will write; any thread may call this."""
        self._glances.append(seen)
        self._loop.call_soon_threadsafe(self._news.set)

    async def _follow(self) -> None:
        while True:
            await self._news.wait()
            self._news.clear()
            await self._show()

    async def _show(self) -> None:
        """Writes the queued states of the station to the address space in order, so that clients see each."""
        async with self._showing:
            while self._glances:
                change = self._panel.see(self._glances.popleft())
                await self._space.show(self._panel.values(), change)

    # -- methods --------------------------------------------------------------------------------------

    def _methods(self) -> list[tuple[str, Callable[..., Any], Arguments, Arguments]]:
        """Returns for each OPC UA method its path, its function, its input and its output arguments."""
        text, handle = TYPES[str], argument("resultHandle", TYPES[int])
        refusal = (argument("error", ua.VariantType.Int32), argument("message", text))
        job, recipe = argument("jobId", text), argument("recipeId", text)
        meas, result = argument("measId", text), argument("resultId", text)
        listed = (argument("ids", text, many=True), argument("digests", text, many=True))
        whole = [argument(name, TYPES[kind]) for name, kind in get_type_hints(Result).items()]
        commands: dict[str, tuple[Arguments, Arguments, Act]] = {
            f"{MACHINE}/SelectModeAutomatic": ((), refusal, self._select_automatic),
            f"{MACHINE}/Reset": ((), refusal, self._reset),
            f"{MACHINE}/ConfirmAll": ((), refusal, self._confirm_all),
            f"{AUTOMATIC}/StartSingleJob": ((meas,), (job, *refusal), self._start),
            f"{AUTOMATIC}/Stop": ((), refusal, self._withdraw),
            f"{AUTOMATIC}/Abort": ((), refusal, self._abort),
            f"{RECIPES}/PrepareRecipe": ((recipe,), refusal, self._prepare),
            f"{RECIPES}/UnprepareRecipe": ((), refusal, self._unprepare),
            f"{RESULTS}/ReleaseResultHandle": ((handle,), refusal, self._release),
        }
        questions: dict[str, tuple[Arguments, Arguments, Act]] = {
            f"{RECIPES}/GetRecipeList": ((), listed, self._list),
            f"{RESULTS}/GetResultById": ((result,), tuple(whole), self._get),
        }
        return [
            (path, self._method(*row, commands=path in commands), *row[:2])
            for path, row in (commands | questions).items()
        ]

    def _method(
        self, inputs: Arguments, outputs: Arguments, act: Act, *, commands: bool
    ) -> Callable[..., Any]:
        """Wraps a function as an OPC UA method that checks its arguments, since asyncua does not check them.

        The method returns after the displayed values have been updated.

        Args:
            inputs: descriptions of the input arguments.
            outputs: descriptions of the output arguments.
            act: the function.
            commands: whether only the session that may give commands can call the method.
        """

        async def call(parent: ua.NodeId, *given: ua.Variant) -> list[ua.Variant] | ua.StatusCode:
            del parent
            if problem := _problem(inputs, given):
                return ua.StatusCode(problem)
            if commands and not self._may_command(caller.get()):
                return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
            values = act(*(argument.Value for argument in given))
            await self._show()
            if isinstance(values, ua.StatusCode):
                return values
            pairs = zip(DONE if values is None else values, outputs, strict=True)
            return [ua.Variant(value, _kind(output)) for value, output in pairs]

        return call

    def _select_automatic(self) -> None:
        seen = self._panel.seen
        if not seen.enabled:
            table = NO_TABLE if seen.table is None else seen.table
            # First without a table: the specification's chart enters the state Ready from Initialized.
            self.exchange.put({"table": NO_TABLE, "enable": 1}, {"table": table})

    def _withdraw(self) -> None:
        self.exchange.put({"enable": 0})

    def _reset(self) -> None:
        self.exchange.put({"enable": 0, "table": NO_TABLE})
        self.exchange.confirm()

    def _confirm_all(self) -> None:
        if self._panel.state is VisionState.ERROR:
            self._take()
        self.exchange.confirm()

    def _abort(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)  # only a signal can request a stop from another thread

    def _start(self, meas_id: str) -> Outputs:
        number = self._jobs + 1
        trigger_id = number & 0xFFFF
        seen = self.exchange.put({"trigger_id": trigger_id, "trigger": 1}, {"trigger": 0})
        if seen.order is None or seen.order.trigger_id != trigger_id:
            return ("", int(seen.error_id), REASONS[Error(seen.error_id)])
        self._jobs = number
        offer = self._panel.offers[seen.order.table]
        job_id, configuration = f"{self._begun}/{number}", self._panel.configuration.digest
        self._panel.job = Job(number, job_id, meas_id, offer.id, offer.digest, configuration)
        return (job_id, *DONE)

    def _prepare(self, recipe: str) -> Outputs | None:
        names = [offer.id for offer in self._panel.offers]
        if recipe not in names:
            there = ", ".join(names)
            return (Error.UNKNOWN_TABLE.value, f"there is no recipe {recipe!r}; there are {there}")
        self.exchange.put({"table": names.index(recipe)})
        return None

    def _unprepare(self) -> None:
        self.exchange.put({"table": NO_TABLE})

    def _list(self) -> Outputs:
        offers = self._panel.offers
        return ([offer.id for offer in offers], [offer.digest for offer in offers])

    def _get(self, result_id: str) -> Outputs | ua.StatusCode:
        result = self._panel.results.get(result_id)
        return ua.StatusCode(ua.StatusCodes.BadNotFound) if result is None else tuple(result)

    def _release(self, handle: int) -> ua.StatusCode | None:
        if not waits(self._panel.seen) or handle != self._panel.job.number:
            return ua.StatusCode(ua.StatusCodes.BadNotFound)
        self._take()
        return None

    def _take(self) -> None:
        self.exchange.put({"result_acknowledge": 1}, {"result_acknowledge": 0})


def _problem(inputs: Arguments, given: tuple[ua.Variant, ...]) -> int:
    """Checks the arguments of a method call; returns an OPC UA status code, 0 if they are valid.

    Args:
        inputs: descriptions of the method's arguments.
        given: the arguments.
    """
    if len(given) != len(inputs):
        missing = len(given) < len(inputs)
        codes = ua.StatusCodes
        return int(codes.BadArgumentsMissing if missing else codes.BadTooManyArguments)
    for value, wanted in zip(given, inputs, strict=True):
        if value.VariantType is not _kind(wanted) or not isinstance(value.Value, str | int):
            return int(ua.StatusCodes.BadInvalidArgument)
        if isinstance(value.Value, str) and len(value.Value) > LONGEST_TEXT:
            return int(ua.StatusCodes.BadOutOfRange)
    return 0


def _kind(argument: ua.Argument) -> ua.VariantType:
    return ua.VariantType(argument.DataType.Identifier)
