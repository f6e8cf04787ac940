"""The open_abb motion server on a TCP port: one client, no framing, silence after a motion fault."""

import asyncio
import datetime
import math
import socket
import struct
from collections.abc import Callable

from drivers.sim.devices import rapid
from drivers.sim.devices.arm import ACCEPT_S, MAX_STRING, Answer, ArmModel
from drivers.sim.wire.serving import HOST, Site

LOGGER_WAIT_S = 0.1  # loggerWaitTime as shipped
SEND_S = 0.5  # wall; a client of the logger that reads nothing is disconnected


class ArmServer:
    """TCP server that lets clients command an arm model, as SERVER.mod does for a real arm.

    Args:
        model: the arm.
        site: simulated time and event loop.
        executed: called after each finished instruction.
    """

    def __init__(
        self, model: ArmModel, site: Site, executed: Callable[[], None] = lambda: None
    ) -> None:
        self._model = model
        self._site = site
        self._executed = executed
        self._stale: str | None = None
        self._turn = asyncio.Lock()
        self.port = site.listen(self._client)
        self.url = f"tcp://{HOST}:{self.port}"

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        queued = self._turn.locked()
        async with self._turn:
            # SERVER.mod recreates its sockets after each client: waiting ones are reset, unserved.
            if queued:
                linger = struct.pack("ii", 1, 0)
                connection = writer.get_extra_info("socket")
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                writer.transport.abort()
            else:
                await self._serve(reader, writer)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._site.sleep(ACCEPT_S)
        if self._stale is not None:
            # The failed instruction was the send of an acknowledgement: RAPID retries it first.
            writer.write(self._stale.encode("latin-1"))
            self._stale = None
        while data := await reader.read(MAX_STRING):
            try:
                answer = self._model.execute(data.decode("latin-1"), self._site.now())
            except rapid.RapidError:
                return
            if not await self._deliver(reader, writer, answer):
                return

    async def _deliver(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, answer: Answer
    ) -> bool:
        """Waits until the instruction is over, and sends its acknowledgement.

        The function never returns if the instruction stopped RAPID execution.

        Returns:
            Whether the client stays connected.
        """
        if math.isinf(answer.ready_s):
            # RAPID execution stopped: the connection stays open without answers.
            await asyncio.Event().wait()
        if answer.broken:
            writer.close()
        else:
            writer.write(answer.before.encode("latin-1"))
        while (left := answer.ready_s - self._site.now()) > 0.0:
            await self._site.sleep(left)
        self._executed()
        if answer.text is None:
            return False
        if answer.broken or reader.at_eof() or reader.exception() is not None:
            self._stale = answer.text
            return False
        writer.write(answer.text.encode("latin-1"))
        return True


def open_logger(model: ArmModel, site: Site) -> str:
    """Opens a TCP port that sends poses and joints in turn, without terminators (`RAPID/LOGGER.mod`).

    Args:
        model: the arm.
        site: simulated time and event loop.

    Returns:
        The address of the port.
    """
    # CDate and CTime are read once, when the program starts; nothing else here depends on the machine.
    stamp = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S")

    def record(kind: int) -> str:
        now_s = site.now()
        angles = " ".join(rapid.to_string(angle, 2) for angle in model.joints_at(now_s))
        numbers = rapid.pose_string(model.pose_at(now_s), 1) if kind == 0 else angles
        return f"# {kind} {stamp} {rapid.to_string(now_s, 2)} {numbers}"

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await site.sleep(ACCEPT_S)
        while True:
            for kind in (0, 1):
                writer.write(record(kind).encode("ascii"))
                async with asyncio.timeout(SEND_S):
                    await writer.drain()
                await site.sleep(LOGGER_WAIT_S)

    return f"tcp://{HOST}:{site.listen(serve)}"
