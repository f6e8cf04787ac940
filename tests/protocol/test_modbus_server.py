"""The Modbus TCP server, frame by frame: with the client of pymodbus, and with raw bytes."""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator

import pytest
from plc_programs import NAMED, TcpPlc
from programs import until

from runtime.devices.clock import SystemClock
from runtime.monitoring.live.server import Address, listening
from runtime.plc import modbus
from runtime.plc.exchange import Exchange
from runtime.plc.modbus import ModbusServer
from runtime.plc.station import Answer, Station

WAIT_S = 30
ENABLE, TRIGGER, TRIGGER_ID, TABLE = (
    NAMED[name].address for name in ("enable", "trigger", "trigger_id", "table")
)
STATUS, DIGEST = NAMED["acknowledge"].address, NAMED["table_digest"].address


class Served:
    """A server, and the station behind it."""

    def __init__(self) -> None:
        listener = listening(Address("127.0.0.1", 0), "--plc")
        self.address = listener.getsockname()
        self.station = Station([0xDEADBEEF])
        self.exchange = Exchange(self.station, SystemClock())
        self._server = ModbusServer(listener, self.exchange)
        self._server.__enter__()

    def plc(self, unit: int = 1) -> TcpPlc:
        return TcpPlc(self.address[1], unit)

    def raw(self) -> "Raw":
        return Raw(self.address)

    def close(self) -> None:
        self._server.__exit__()


class Raw:
    """A client that sends any bytes."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address, timeout=WAIT_S)
        self._answers = self.socket.makefile("rb")

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def read(self) -> tuple[int, int, bytes]:
        """The next answer: transaction, unit and PDU; an empty PDU where the connection ended."""
        head = self._exactly(7)
        if not head:
            return 0, 0, b""
        number, protocol, length, unit = struct.unpack(">HHHB", head)
        assert protocol == 0
        return number, unit, self._exactly(length - 1)

    def ask(self, pdu: bytes, number: int = 1, unit: int = 1) -> bytes:
        """The PDU that answers a request."""
        self.send(frame(pdu, number, unit))
        result, back, answer = self.read()
        assert (result, back) == (number, unit)
        return answer

    def _exactly(self, count: int) -> bytes:
        try:
            data = self._answers.read(count)
        except ConnectionResetError:
            return b""
        assert len(data) in (0, count)
        return data

    def is_closed(self) -> bool:
        """Whether the server ends the connection; closes this side, too."""
        ended = self.read()[2] == b""
        self.close()
        return ended

    def close(self) -> None:
        self._answers.close()
        self.socket.close()


def frame(pdu: bytes, number: int = 1, unit: int = 1) -> bytes:
    return struct.pack(">HHHB", number, 0, len(pdu) + 1, unit) + pdu


def read(address: int, count: int, function: int = 3) -> bytes:
    return struct.pack(">BHH", function, address, count)


def write(address: int, value: int) -> bytes:
    return struct.pack(">BHH", 6, address, value)


def write_many(address: int, *values: int) -> bytes:
    return struct.pack(f">BHHB{len(values)}H", 16, address, len(values), 2 * len(values), *values)


@pytest.fixture
def served() -> Iterator[Served]:
    server = Served()
    yield server
    server.close()


@pytest.fixture
def raw(served: Served) -> Iterator[Raw]:
    client = served.raw()
    yield client
    client.close()


@pytest.mark.parametrize("unit", [0, 247])
def test_modbus_server_any_unit_is_answered_as_itself(raw: Raw, unit: int) -> None:
    assert raw.ask(read(DIGEST, 2), 0x1234, unit) == bytes.fromhex("0304deadbeef")
    assert raw.ask(read(DIGEST, 2, function=4), 7, unit) == bytes.fromhex("0404deadbeef")
    assert raw.ask(write(TRIGGER_ID, 0xABCD), 8, unit) == write(TRIGGER_ID, 0xABCD)
    assert raw.ask(read(TRIGGER_ID, 1), 9, unit) == bytes.fromhex("0302abcd")


@pytest.mark.parametrize(
    ("request_pdu", "code"),
    [
        (write(STATUS, 1), 2),
        (write(DIGEST, 1), 2),
        (write(6, 1), 2),
        (write(0xFFFF, 1), 2),
        (write_many(TABLE, 0, 0), 2),
        (write_many(STATUS, 0, 0, 0), 2),
        (struct.pack(">BHHHHBH", 23, 0, 1, STATUS, 1, 2, 5), 2),
        (struct.pack(">BHHH", 22, STATUS, 0xFFFF, 1), 2),
        (struct.pack(">BHH", 5, 0, 0xFF00), 1),
        (struct.pack(">BHHBB", 15, 0, 1, 1, 1), 1),
        (read(0, 1, function=1), 1),
        (read(0, 1, function=2), 1),
        (read(6, 1), 2),
        (read(STATUS, 125), 2),
        (read(0, 0), 3),
        (read(0, 126), 3),
        (write(ENABLE, 2), 3),
        (write(TRIGGER, 0xFF00), 3),
        (struct.pack(">BHHB", 16, 0, 1, 2), 3),
        (struct.pack(">BHHBHH", 16, 0, 1, 4, 1, 1), 3),
        (struct.pack(">BHHB", 16, 0, 0, 0), 3),
        (b"\x06\x00\x00", 3),
        (b"\x06\x00\x00\x00\x01\x00", 3),
        (b"\x03", 3),
        (b"\x10\x00", 3),
        (b"\x08\x00\x01\x00\x00", 1),
        (b"\x2b\x0e\x01\x00", 1),
        (b"\x11", 1),
        (b"\x64\x01\x02", 1),
    ],
    ids=lambda value: value.hex() if isinstance(value, bytes) else str(value),
)
def test_modbus_server_bad_request_gets_exception_and_changes_nothing(
    served: Served, raw: Raw, request_pdu: bytes, code: int
) -> None:
    assert raw.ask(request_pdu) == bytes((request_pdu[0] | 0x80, code))
    assert raw.ask(read(0, 6)) == b"\x03\x0c" + bytes(12)
    assert served.station.order is None


def test_modbus_server_frames_cut_anywhere_are_answered_in_order(served: Served, raw: Raw) -> None:
    asked = [frame(write(TRIGGER_ID, number), number, number % 256) for number in range(200)]
    stream = b"".join(asked)
    raw.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for start in range(0, len(stream), 29):  # cuts anywhere in the frames of 12 bytes
        raw.send(stream[start : start + 29])
    for number, each in enumerate(asked):
        assert raw.read() == (number, number % 256, each[7:])
    assert served.exchange.read(TRIGGER_ID, 1) == [199]


def test_modbus_server_half_frame_changes_nothing_and_blocks_nobody(served, raw, monkeypatch):
    monkeypatch.setattr(modbus, "PATIENCE_S", 0.2)
    whole = frame(write_many(ENABLE, 1, 1, 5))
    for cut in (1, 6, 7, 8, len(whole) - 1):
        with_half = served.raw()
        with_half.send(whole[:cut])
        assert raw.ask(read(0, 3)) == b"\x03\x06" + bytes(6)
        assert with_half.is_closed(), cut
    assert served.station.order is None
    monkeypatch.setattr(modbus, "PATIENCE_S", 1.0)
    first = served.raw()  # its second half comes in time
    first.send(whole[:9])
    time.sleep(0.05)
    first.send(whole[9:])
    assert first.read()[2] == bytes.fromhex("9006")  # busy: `raw` is the client that may write
    time.sleep(1.1)
    assert first.ask(read(0, 1)) == bytes.fromhex("03020000")
    first.close()


def test_modbus_server_connection_beyond_most_is_ended(served, raw):
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(contextlib.closing(raw))]
        while len(clients) < modbus.MOST_CONNECTIONS:
            clients.append(stack.enter_context(contextlib.closing(served.raw())))
        assert all(client.ask(read(0, 1)) == bytes.fromhex("03020000") for client in clients)
        assert served.raw().is_closed()


@pytest.mark.parametrize(
    "noise",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack(">HHHB", 1, 1, 6, 1) + write(0, 1),  # another protocol
        struct.pack(">HHHB", 1, 0, 255, 1) + bytes(254),  # longer than any frame
        struct.pack(">HHH", 1, 0, 1) + b"\x01",  # no function
        bytes(range(256)),
    ],
    ids=["http", "protocol", "long", "short", "noise"],
)
def test_modbus_server_malformed_bytes_disconnect_their_sender_only(served, raw, noise):
    other = served.raw()
    other.send(noise)
    assert other.is_closed()
    assert raw.ask(read(0, 6)) == b"\x03\x0c" + bytes(12)


def test_modbus_server_second_client_reads_and_may_not_write(served):
    with served.plc() as first, served.plc() as second:
        assert (second["trigger_id"], second["table_digest"]) == (0, 0xDEADBEEF)
        assert second.code("enable", 1) == 6
        first.write(trigger_id=5)
        assert second["trigger_id"] == 5
        assert second.code("trigger_id", 6) == 6
        answer = second.client.readwrite_registers(
            read_address=0, read_count=1, write_address=TRIGGER_ID, values=[9]
        )
        assert answer.exception_code == 6
        assert first["trigger_id"] == 5
        first.close()
        until(lambda: second.code("trigger_id", 7) == 0)
        assert second["trigger_id"] == 7
        with served.plc() as third:
            assert third.code("trigger_id", 8) == 6


def test_modbus_server_idle_reader_gives_way_to_plc(served, monkeypatch):
    monkeypatch.setattr(modbus, "PANEL_S", 0.2)
    with served.plc() as panel, served.plc() as plc:
        assert panel["trigger_id"] == 0
        until(lambda: plc.code("trigger_id", 1) == 0)
        assert panel.code("trigger_id", 2) == 6
    with served.plc() as plc, served.plc() as panel:
        plc.write(trigger_id=3)
        time.sleep(0.3)
        assert panel.code("trigger_id", 4) == 6


def test_modbus_server_connection_reset_disables_and_keeps_part(served: Served) -> None:
    first = served.raw()
    assert first.ask(write_many(ENABLE, 1, 1, 5)) == bytes.fromhex("1000000003")
    assert served.exchange.glance.order is not None
    first.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    first.close()
    until(lambda: served.exchange.read(ENABLE, 1) == [0])
    served.exchange.finish(Answer(1, x=-5))
    with served.plc() as plc:
        assert (plc["result_valid"], plc["result_id"], plc["x"]) == (1, 5, -5)
        assert plc["error_id"] == 106
        plc.write(result_acknowledge=1, trigger=0)
        plc.write(result_acknowledge=0)
        assert (plc["result_id"], plc["x"]) == (0, 0)


def test_modbus_server_flood_by_one_client_does_not_block_others(served: Served, raw: Raw) -> None:
    flood = served.raw()
    flood.socket.settimeout(0.1)
    asked = frame(read(STATUS, 21)) * 1000
    with contextlib.suppress(TimeoutError):  # the buffers are full
        for _ in range(300):
            flood.send(asked)
    assert raw.ask(read(0, 1)) == bytes.fromhex("03020000")
    flood.close()


def test_modbus_server_client_that_reads_no_answers_is_disconnected(served, monkeypatch):
    monkeypatch.setattr(modbus, "MOST_UNREAD_BYTES", -1)
    deaf = served.raw()
    deaf.send(frame(read(STATUS, 21)))
    assert deaf.read()[2][0] == 3  # sent before the server noticed
    assert deaf.is_closed()


def test_modbus_server_exit_ends_connections_and_thread(served: Served, raw: Raw) -> None:
    assert raw.ask(read(0, 1)) == bytes.fromhex("03020000")
    served.close()
    assert raw.is_closed()
    assert "modbus" not in [thread.name for thread in threading.enumerate()]
    served.__init__()
