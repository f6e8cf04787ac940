"""The scene's line protocol: an answer a line, and whatever fails while it is asked ends the cell."""

import json
import socket
import threading

import pytest

from drivers.sim.physics.scene_protocol import MAX_LINE, SceneServer


@pytest.fixture
def served():
    """A scene that repeats what it is asked, and the event that ends its cell."""
    stopped = threading.Event()
    server = SceneServer(answer, stopped)
    server.start()
    yield server, stopped
    server.close()


def answer(what):
    if what == "fail":
        raise ArithmeticError("no such squeeze")
    return {what: True}


def client(server):
    return socket.create_connection(("127.0.0.1", int(server.url.rpartition(":")[2])), timeout=5.0)


def ask(connection, line):
    connection.sendall(line + b"\n")
    return json.loads(connection.makefile("rb").readline())


def test_each_client_gets_an_answer_a_line(served):
    with client(served[0]) as first, client(served[0]) as second:
        for connection in (first, second, first):
            assert ask(connection, b'{"do": "truth"}') == {"truth": True}
        assert "not understood" in ask(second, b"{}")["error"]
        assert ask(second, b'{"do": "truth"}') == {"truth": True}


def test_quit_is_answered_before_the_cell_stops(served):
    with client(served[0]) as connection:
        assert ask(connection, b'{"do": "quit"}') == {"quit": True}
    assert served[1].wait(5.0)


def test_a_line_without_end_hangs_up(served):
    with client(served[0]) as connection:
        connection.sendall(b"x" * MAX_LINE)
        assert connection.recv(16) == b""


def test_what_fails_while_it_is_asked_reaches_the_threads_end(served, monkeypatch):
    failed, seen = threading.Event(), []
    monkeypatch.setattr(
        threading, "excepthook", lambda message: (seen.append(message.exc_value), failed.set())
    )
    with client(served[0]) as connection:
        connection.sendall(b'{"do": "fail"}\n')
        assert failed.wait(5.0)
    assert [str(error) for error in seen] == ["no such squeeze"]
