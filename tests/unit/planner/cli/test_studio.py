"""The command of the studio: the port that it listens on."""

import socket

from programs import called

from planner.cli import studio
from planner.studio.folder import Folder


def test_studio_stated_port_in_use_is_refused(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = called(studio.main, tmp_path, "--no-browser", "--port", port)
    assert (ended.code, ended.one_line) == (2, True)
    assert f"--port {port}" in ended.err


def test_listening_default_port_in_use_takes_a_free_one(tmp_path, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        monkeypatch.setattr(studio, "PORT", taken.getsockname()[1])
        with studio._listening(Folder(tmp_path), None) as server:
            assert server.server_port != studio.PORT
            assert server.server_address[0] == "127.0.0.1"
