"""plan-studio: a page for a browser on this machine, from a drawing to a table."""

import argparse
import json
import os
import webbrowser
from pathlib import Path

from planner.cli import shell
from planner.studio.folder import Folder
from planner.studio.server import Studio
from runtime.shell.command import Parser, natural, say
from runtime.shell.errors import UsageError
from runtime.shell.files import folder

NAME = "plan-studio"
PORT = 8640  # fixed, so that an open page reconnects when the studio restarts
MOST_PORT = 65535


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Serve a page for a browser on this machine: drop a drawing, see outline, gripper and uncertainty to "
        "scale, plan, and look at the answer. All files are in one folder, and usable from the command line.",
        NAME,
        f"{NAME} parts --port 8000 --no-browser",
    )
    text = "folder of drawings and plans; created if missing (default: this one)"
    built.add_argument("folder", type=Path, nargs="?", default=Path(), metavar="FOLDER", help=text)
    text = f"port on the loopback interface, 0 for a free one (default: {PORT}, if it is free)"
    built.add_argument("--port", type=natural, metavar="P", help=text)
    text = "print the address, and open no browser"
    built.add_argument("--no-browser", action="store_true", help=text)
    return built


def _studio(arguments: argparse.Namespace) -> None:
    project = Folder(folder(arguments.folder))
    with _listening(project, arguments.port) as server:
        figures = {"address": server.address, "folder": str(project.path)}
        line = f"studio of {arguments.folder}: {server.address} (Ctrl-C ends it; plans go on)"
        say(json.dumps(figures) if arguments.json else line)
        if not arguments.no_browser and {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return


def _listening(project: Folder, port: int | None) -> Studio:
    if port is not None and port > MOST_PORT:
        raise UsageError(f"--port {port} is above {MOST_PORT}; take one below, or 0 for a free one")
    try:
        return Studio(project, PORT if port is None else port)
    except OSError as error:
        if port is None:
            return Studio(project, 0)
        reason = (error.strerror or str(error)).lower()
        raise UsageError(f"--port {port}: {reason}; name another, or 0 for a free one") from error


main = shell.main_of(parser, _studio)
