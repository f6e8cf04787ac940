"""A Modbus TCP server, in a separate thread: one client, the PLC, may write, and any number may read.

pymodbus decodes the requests, checks them and encodes the answers. The server of pymodbus is not used: it
does not distinguish connections, and it drops a request that arrives before the last request is answered. So
this module serves the connections, and splits the received bytes into frames.
"""

import asyncio
import logging
import socket
import struct
from collections.abc import Coroutine
from typing import Any, cast

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU

from runtime.plc.exchange import Exchange
from runtime.plc.server import PlcServer
from runtime.plc.station import Refusal

# transaction, protocol, number of bytes that follow (Modbus TCP guide 3.1.3)
HEADER = struct.Struct(">HHH")
LONGEST = 254  # greatest length that a header may state: a unit and a PDU of 253 bytes
PATIENCE_S = 5.0  # time for the rest of a frame
# if the writer has written nothing for this time since it connected, another client may become the writer
PANEL_S = 10.0
MOST_CONNECTIONS = 16
PIECE_BYTES = 1024
MOST_UNREAD_BYTES = 1 << 16  # most bytes of answers that a client does not read
# A connection to a PLC without power is closed after 3 + 3 x 1 s; then another client may write.
KEEPALIVE = {socket.TCP_KEEPIDLE: 3, socket.TCP_KEEPINTVL: 1, socket.TCP_KEEPCNT: 3}
# Lengths of the requests (PDU) of the supported functions; None: variable.
LENGTHS = {3: 5, 4: 5, 6: 5, 16: None, 22: 7, 23: None}

logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)  # any client could fill the log


class ModbusServer(PlcServer):
    """The Modbus TCP server: lets clients read and write the registers of an exchange's station."""

    def __init__(self, listener: socket.socket, exchange: Exchange) -> None:
        super().__init__(exchange)
        self._listener = listener
        self._connections: list[Connection] = []
        self._writer: Connection | None = None

    def enter(self, connection: "Connection") -> bool:
        """Registers a new connection; if no connection may write, this one may from now on.

        Returns:
            Whether the connection was registered; False if there are too many.
        """
        if len(self._connections) >= MOST_CONNECTIONS:
            return False
        self._connections.append(connection)
        if self._writer is None:
            self._appoint(connection)
        return True

    def leave(self, connection: "Connection") -> None:
        """Removes a connection; if it is the one that may write, notes that the PLC has disconnected."""
        if connection in self._connections:
            self._connections.remove(connection)
        if self._writer is connection:
            self._writer = None
            self.exchange.disconnect()

    def may_write(self, connection: "Connection") -> bool:
        """Whether a connection may write: only one connection, the writer, may.

        The asking connection becomes the writer if there is none, or if the present writer has been connected
        for more than `PANEL_S` and never wrote.
        """
        writer, panel_since_s = self._writer, self.clock.now() - PANEL_S
        if writer is None or (not writer.has_written and writer.began_s < panel_since_s):
            self._appoint(connection)
        return self._writer is connection

    def _appoint(self, connection: "Connection") -> None:
        self._writer = connection
        self.exchange.connected = True

    async def serve(self, stop: asyncio.Event) -> None:
        """Serves clients until `stop` is set, see `PlcServer.serve`."""
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: Connection(self), sock=self._listener)
        self.started.set()
        await stop.wait()
        server.close()
        for connection in tuple(self._connections):
            connection.close()


class Connection(asyncio.BufferedProtocol):
    """The connection of one client; decoded requests of pymodbus read and write registers through it."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._framer = FramerSocket(DecodePDU(True))
        self._piece, self._buffer = bytearray(PIECE_BYTES), b""
        self._late: asyncio.TimerHandle | None = None
        self._last: list[int] = []
        self.has_written = False
        self.began_s = server.clock.now()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Registers the new connection and sets its keepalive; aborts it if there are too many already."""
        self._transport = cast(asyncio.Transport, transport)
        if not self._server.enter(self):
            self._transport.abort()
            return
        client: socket.socket = transport.get_extra_info("socket")
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            client.setsockopt(socket.IPPROTO_TCP, option, value)

    def connection_lost(self, _: Exception | None) -> None:
        """Removes the connection from the server."""
        self._forget_late()
        self._server.leave(self)

    def close(self) -> None:
        """Closes the connection after all answers have been sent."""
        self._transport.close()

    def get_buffer(self, _: int) -> bytearray:
        """Returns the buffer for the next bytes; it is small, so that no client keeps the others waiting."""
        return self._piece

    def buffer_updated(self, nbytes: int) -> None:
        """Answers each complete frame in the received bytes, in order.

        Disconnects a client that sends an invalid frame, leaves a frame incomplete for `PATIENCE_S`, or does
        not read its answers.
        """
        self._buffer += self._piece[:nbytes]
        while len(self._buffer) >= HEADER.size:
            number, protocol, length = HEADER.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= LONGEST:
                self._transport.abort()
                return
            end = HEADER.size + length
            if len(self._buffer) < end:
                break
            frame, self._buffer = self._buffer[HEADER.size : end], self._buffer[end:]
            answer = self._answer(frame[1:], frame[0])
            answer.transaction_id, answer.dev_id = number, frame[0]
            self._transport.write(self._framer.buildFrame(answer))
            self._forget_late()
            if self._transport.get_write_buffer_size() > MOST_UNREAD_BYTES:
                self._transport.abort()
                return
        if self._buffer and self._late is None:
            self._late = asyncio.get_running_loop().call_later(PATIENCE_S, self._transport.abort)

    async def async_getValues(  # noqa: N802 - pymodbus' name
        self, _device_id: int, func_code: int, address: int, count: int = 1
    ) -> list[int] | ExcCodes:
        """Reads registers for a request of pymodbus; returns the values, or the exception code of a refusal.

        For the answer to function 6, which writes one register, returns the value just written.
        """
        if func_code == 6:
            return self._last
        values = self._server.exchange.read(address, count)
        return ExcCodes(values) if isinstance(values, Refusal) else values

    async def async_setValues(  # noqa: N802 - pymodbus' name
        self, _device_id: int, _func_code: int, address: int, values: list[int]
    ) -> ExcCodes | None:
        """Writes registers for a request of pymodbus; returns the exception code of a refusal, else None."""
        if not self._server.may_write(self):
            return ExcCodes.DEVICE_BUSY
        self.has_written = True
        self._last = values
        refusal = self._server.exchange.write(address, values)
        return None if refusal is None else ExcCodes(refusal)

    def _answer(self, pdu: bytes, unit: int) -> ModbusPDU:
        function = pdu[0]
        if function not in LENGTHS:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_FUNCTION)
        whole = LENGTHS[function] in (None, len(pdu))
        request = self._framer.decoder.decode(pdu) if whole else None
        if request is None:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_VALUE)
        return _completed(request.datastore_update(cast(Any, self), unit))

    def _forget_late(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def _completed(request: Coroutine[Any, Any, ModbusPDU]) -> ModbusPDU:
    """Runs a request's coroutine to its end, and returns the answer; the coroutine must not wait."""
    try:
        request.send(None)
    except StopIteration as end:
        return cast(ModbusPDU, end.value)
    raise RuntimeError("a request waited")
