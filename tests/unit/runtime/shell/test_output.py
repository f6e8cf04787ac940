"""Standard streams whose reader does not read: no call blocks, only whole lines are lost."""

import io
import os
import select
import socket
import sys
import time

import pytest

from runtime.shell import command, output
from runtime.shell.output import Outlet

LINE = b"x" * 99 + b"\n"


@pytest.fixture(params=["pipe", "socket", "terminal", "pipe without /proc"])
def ends(request, monkeypatch):
    """File descriptors of a stream's two ends: the first to read from, the second to write to."""
    if request.param == "socket":
        pair = [one.detach() for one in socket.socketpair()]
    else:
        pair = list(os.openpty() if request.param == "terminal" else os.pipe())
    if request.param == "pipe without /proc":

        def refused(*_):
            raise PermissionError

        monkeypatch.setattr(output.os, "open", refused)
    yield pair
    for end in pair:
        os.close(end)


def taken(reader):
    """Reads all bytes that arrive until the stream is idle."""
    data = b""
    while select.select([reader], [], [], 0.02)[0]:
        data += os.read(reader, 1 << 16)
    return data.replace(b"\r\n", b"\n")


def sent(outlet, reader):
    """Reads all bytes until the stream is idle and the outlet has nothing left to send."""
    data = taken(reader)
    while more := (outlet.put(b""), taken(reader))[1]:
        data += more
    return data


def test_outlet_of_unread_stream_keeps_lines_and_sends_them_later(ends, monkeypatch):
    monkeypatch.setattr(output, "END_S", 0.05)
    reader, writer = ends
    outlet = Outlet(writer, time.monotonic)
    lines = [f"{number:098d}\n".encode() for number in range(2000)]
    for line in lines:
        outlet.put(line)
    assert sent(outlet, reader).splitlines(keepends=True) == lines
    assert outlet.end() == outlet.lost == 0
    assert os.get_blocking(writer)  # other processes may share the descriptor
    outlet.close()


def test_outlet_with_full_buffer_drops_whole_lines(ends, monkeypatch):
    monkeypatch.setattr(output, "KEPT_BYTES", 10_000)
    monkeypatch.setattr(output, "END_S", 0.05)
    reader, writer = ends
    outlet = Outlet(writer, time.monotonic)
    for _ in range(3000):
        outlet.put(LINE)
    dropped = outlet.lost
    assert dropped > 0
    assert sent(outlet, reader) == LINE * (3000 - dropped)
    outlet.close()


def test_outlet_end_of_unread_stream_returns_lost_lines(ends, monkeypatch):
    monkeypatch.setattr(output, "END_S", 0.05)
    outlet = Outlet(ends[1], time.monotonic)
    for _ in range(5000):
        outlet.put(LINE)
    assert outlet.end() > 0
    outlet.close()


def test_say_to_closed_pipe_is_no_error_and_memory_stream_written():
    reader, writer = os.pipe()
    os.close(reader)
    file = os.fdopen(writer, "w")
    output._outlets[writer] = Outlet(writer, time.monotonic)
    command.say("one", file)
    command.say("two", file)
    output._outlets.pop(writer).close()
    file.close()
    memory = io.StringIO()
    command.say("three", memory)
    assert memory.getvalue() == "three\n"
    assert output.outlet_of(sys.stdout) is None
