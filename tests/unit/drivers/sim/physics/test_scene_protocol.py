"""The scene's line protocol: an answer a line, and whatever fails while it is asked ends the cell."""

import contextlib
import json
import socket

import pytest

from drivers.sim.physics.scene_protocol import MAX_LINE, open_port
from drivers.sim.wire.serving import Site


@pytest.fixture
def site():
    with Site() as result:
        yield result


@pytest.fixture
def client(site):
    """A function that connects to a scene, which repeats what it is asked."""
    port = open_port(answer, site)
    with contextlib.ExitStack() as connections:
        place = ("127.0.0.1", port)
        yield lambda: connections.enter_context(socket.create_connection(place, timeout=5.0))


def answer(what):
    if what == "fail":
        raise ArithmeticError("no such squeeze")
    return {what: True}


def ask(connection, line):
    connection.sendall(line + b"\n")
    return json.loads(connection.makefile("rb").readline())


def test_each_client_gets_an_answer_a_line(client):
    first, second = client(), client()
    for connection in (first, second, first):
        assert ask(connection, b'{"do": "truth"}') == {"truth": True}
    assert "not understood" in ask(second, b"{}")["error"]
    assert ask(second, b'{"do": "truth"}') == {"truth": True}


def test_quit_is_answered_before_the_cell_stops(client, site):
    assert ask(client(), b'{"do": "quit"}') == {"quit": True}
    assert site.stopped.wait(5.0)


def test_a_line_without_end_hangs_up(client):
    connection = client()
    connection.sendall(b"x" * MAX_LINE)
    assert connection.recv(16) == b""


def test_what_fails_while_it_is_asked_stops_the_cell(client, site):
    client().sendall(b'{"do": "fail"}\n')
    assert site.stopped.wait(5.0)
    assert [str(error) for error in site.failures] == ["no such squeeze"]
