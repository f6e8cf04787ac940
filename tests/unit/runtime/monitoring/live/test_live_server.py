"""The live page's server over real sockets: no client keeps it from answering the next or from closing."""

import contextlib
import json
import socket
import threading
import urllib.error
import urllib.request

import pytest
from programs import until
from sample_tables import small_table
from statuses import status_of

from runtime.monitoring.live import page, server
from runtime.monitoring.live.server import MOST_CLIENTS, Address, PageServer

FREE = Address("127.0.0.1", 0)
LARGE = b"x" * 16_000_000
WAIT_S = 20


@pytest.fixture
def serving():
    table = small_table()
    result = page.pages(table, "small.msgpack", status_of(table, "small.msgpack"))
    with PageServer(FREE, {**result, "/large": ("text/plain", lambda: LARGE)}) as running:
        yield running


def connected(running: PageServer) -> socket.socket:
    return socket.create_connection(running.address, timeout=WAIT_S)


def fetched(running: PageServer, path: str) -> bytes:
    with urllib.request.urlopen(f"http://{running.address}{path}", timeout=WAIT_S) as answer:
        return bytes(answer.read())


def test_page_server_serves_every_page(serving):
    assert json.loads(fetched(serving, "/status.json"))["table"] == "small.msgpack"
    assert fetched(serving, "/metrics").startswith(b"# HELP squeezetree_")
    assert b"<title>" in fetched(serving, "/")
    assert fetched(serving, "/large") == LARGE
    with pytest.raises(urllib.error.HTTPError, match="404"):
        fetched(serving, "/etc/passwd")


@pytest.mark.parametrize(
    "words", [b"\xff" * 9000, b"A" * 100_000, b"GET / HTTP/1.1\r\n", b"\r\n\r\n", b""]
)
def test_page_server_misbehaving_client_does_not_stop_it(serving, words):
    with connected(serving) as client, contextlib.suppress(OSError):
        client.sendall(words)
        client.shutdown(socket.SHUT_WR)
        while client.recv(1 << 16):
            pass
    assert fetched(serving, "/status.json")


def test_page_server_silent_or_deaf_client_is_disconnected(monkeypatch, serving):
    monkeypatch.setattr(server, "PATIENCE_S", 0.2)
    with connected(serving) as silent, connected(serving) as deaf:
        deaf.sendall(b"GET /large HTTP/1.0\r\n\r\n")  # more than the kernel keeps
        assert silent.recv(1) == b""
        assert until(lambda: not serving._clients)
    assert fetched(serving, "/status.json")


@pytest.fixture
def patient(monkeypatch):
    """The server waits longer for a client than the tests wait for the server."""
    monkeypatch.setattr(server, "PATIENCE_S", 10.0 * WAIT_S)


def test_page_server_endless_request_is_cut_off(patient, serving):
    with connected(serving) as client, contextlib.suppress(ConnectionError):
        client.sendall(b"A" * 100_000)
        assert client.recv(1) == b""


def test_page_server_too_many_clients_disconnects_oldest(patient, serving):
    with contextlib.ExitStack() as stack:
        idle = [stack.enter_context(connected(serving)) for _ in range(MOST_CLIENTS)]
        assert fetched(serving, "/status.json")
        assert idle[0].recv(1) == b""
        idle[-1].sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert idle[-1].recv(20).startswith(b"HTTP/1.0 200")


def test_page_server_close_ends_connections_and_frees_port():
    running = PageServer(FREE, {})
    with connected(running) as client:
        assert until(lambda: running._clients)
        running.close()
        assert client.recv(1) == b""
    with PageServer(running.address, {}) as again:
        assert again.address == running.address
    assert not [thread for thread in threading.enumerate() if thread.name == "http"]
