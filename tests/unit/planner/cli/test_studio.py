"""The command of the studio: where it listens."""

import socket

from programs import called

from planner.cli import studio
from planner.studio.folder import Folder


def test_a_port_that_is_taken_is_an_error_if_it_was_asked_for(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = called(studio.main, tmp_path, "--no-browser", "--port", port)
    assert (ended.code, ended.one_line) == (2, True)
    assert f"--port {port}" in ended.err


def test_the_usual_port_that_is_taken_is_replaced_by_a_free_one(tmp_path, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        monkeypatch.setattr(studio, "PORT", taken.getsockname()[1])
        with studio._listening(Folder(tmp_path), None) as server:
            assert server.server_port != studio.PORT
            assert server.server_address[0] == "127.0.0.1"
