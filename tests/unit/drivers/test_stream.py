"""Streams to devices: no send, look-up or connection outlasts its deadline, whatever the peer does."""

import os
import socket
import termios
import time
import tty

import pytest
from silent_names import silent_names

from drivers import stream
from drivers.errors import LinkError, PortError, shown
from drivers.robotiq import modbus
from drivers.stream import SerialStream, StalledError, connected, open_tcp


@pytest.fixture
def terminal():
    """Both ends of a pseudo-terminal, and the path of the second."""
    ends = os.openpty()
    tty.setraw(ends[1])
    yield *ends, os.ttyname(ends[1])
    for end in ends:
        os.close(end)


def test_serial_stream_send_on_stopped_line_raises_and_is_dropped(terminal):
    master, slave, path = terminal
    stream = SerialStream(path, 115200)
    stream.send(b"before")
    termios.tcflow(slave, termios.TCOOFF)
    with pytest.raises(StalledError, match=r"has taken no bytes for 0\.5 s"):
        stream.send(b"stopped")
    termios.tcflow(slave, termios.TCOON)
    stream.send(b"after")
    assert os.read(master, 6) + os.read(master, 100) == b"beforeafter"
    stream.close()
    stream.close()


def test_serial_stream_send_to_peer_that_never_reads_raises(terminal):
    stream = SerialStream(terminal[2], 115200)
    with pytest.raises(StalledError):
        stream.send(bytes(1 << 20))
    stream.close()


def test_serial_stream_send_with_bytes_left_in_line_raises(terminal, monkeypatch):
    """A UART driver buffers bytes while the flow is stopped; the device must not obey them later."""
    stream = SerialStream(terminal[2], 115200)
    monkeypatch.setattr(type(stream._port), "out_waiting", property(lambda port: 8))
    with pytest.raises(StalledError):
        stream.send(b"next")


def test_open_tcp_send_to_peer_that_never_reads_raises():
    with socket.create_server(("127.0.0.1", 0)) as server:
        stream = open_tcp("127.0.0.1", server.getsockname()[1], "tcp://x", "hint")
        with pytest.raises(StalledError):
            stream.send(bytes(64 << 20))
        stream.close()


def test_scan_of_stopped_line_raises_link_error(terminal):
    termios.tcflow(terminal[1], termios.TCOOFF)
    with pytest.raises(LinkError, match=r"cannot be searched: .*taken no bytes"):
        list(modbus.scan(terminal[2]))


def test_connected_unanswered_addresses_share_one_deadline(monkeypatch):
    waited = []

    class Unanswered(socket.socket):
        def connect(self, address):
            waited.append(self.gettimeout())
            raise TimeoutError

    row = (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 9))
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [row] * 200)
    monkeypatch.setattr(socket, "socket", Unanswered)
    monkeypatch.setattr(time, "monotonic", lambda: 7.0 + sum(waited))
    with pytest.raises(TimeoutError):
        connected("host", 9, 0.2)
    assert (len(waited), sum(waited)) == (200, pytest.approx(0.2 + 199 * 1e-3))


def test_open_tcp_silent_name_server_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(stream, "CONNECT_S", 0.1)
    said = r"no name server tells .* robot\.local.*; hint"
    with silent_names(), pytest.raises(PortError, match=said):
        open_tcp("robot.local", 1, "tcp://robot.local:1", "hint")


@pytest.mark.parametrize(
    "sent", [b"\x1b[2J\r\n" * 200, "x" * 5000, {"a": "\u202e" * 500}, b"", "mode\nAUTO"]
)
def test_shown_text_is_short_and_printable(sent):
    text = shown(sent)
    assert len(text) <= 60 * 6 + 30
    assert text.isprintable()
