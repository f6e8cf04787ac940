"""Standard streams whose reader does not read: nothing waits, whole lines are lost, later ones arrive."""

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
    """Descriptors to read from and to write to."""
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
    """What comes until nothing comes."""
    data = b""
    while select.select([reader], [], [], 0.02)[0]:
        data += os.read(reader, 1 << 16)
    return data.replace(b"\r\n", b"\n")


def sent(outlet, reader):
    """What comes of a stream's lines, kept ones too, until nothing comes."""
    data = taken(reader)
    while more := (outlet.put(b""), taken(reader))[1]:
        data += more
    return data


def test_outlet_of_a_stream_nobody_reads_keeps_lines_and_sends_them_later(ends, monkeypatch):
    monkeypatch.setattr(output, "END_S", 0.05)
    reader, writer = ends
    outlet = Outlet(writer, time.monotonic)
    lines = [f"{number:098d}\n".encode() for number in range(2000)]
    for line in lines:
        outlet.put(line)
    assert sent(outlet, reader).splitlines(keepends=True) == lines
    assert outlet.end() == outlet.lost == 0
    assert os.get_blocking(writer)  # others, who share it, are not surprised
    outlet.close()


def test_outlet_drops_whole_lines_beyond_what_it_keeps(ends, monkeypatch):
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


def test_end_of_a_stream_that_nobody_reads_tells_how_many_lines_are_lost(ends, monkeypatch):
    monkeypatch.setattr(output, "END_S", 0.05)
    outlet = Outlet(ends[1], time.monotonic)
    for _ in range(5000):
        outlet.put(LINE)
    assert outlet.end() > 0
    outlet.close()


def test_say_to_a_reader_who_left_is_no_error_and_one_in_memory_is_written():
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
