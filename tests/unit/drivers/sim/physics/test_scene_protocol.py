"""The line protocol of a scene: one answer to each line; an error while answering stops the cell."""

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
    """A function that opens a connection to a scene.

    The scene answers a request with the name of the request.
    """
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


def test_open_port_each_line_of_each_client_is_answered(client):
    first, second = client(), client()
    for connection in (first, second, first):
        assert ask(connection, b'{"do": "truth"}') == {"truth": True}
    assert "not understood" in ask(second, b"{}")["error"]
    assert ask(second, b'{"do": "truth"}') == {"truth": True}


def test_open_port_quit_is_answered_and_stops_cell(client, site):
    assert ask(client(), b'{"do": "quit"}') == {"quit": True}
    assert site.stopped.wait(5.0)


def test_open_port_endless_line_closes_connection(client):
    connection = client()
    connection.sendall(b"x" * MAX_LINE)
    assert connection.recv(16) == b""


def test_open_port_failing_answer_stops_cell(client, site):
    client().sendall(b'{"do": "fail"}\n')
    assert site.stopped.wait(5.0)
    assert [str(error) for error in site.failures] == ["no such squeeze"]
