"""The studio's HTTP server: pages and files of one folder, for the browser on this machine.

It listens on loopback, refuses other host names (DNS rebinding) and other origins. Its pages load nothing
from elsewhere.
"""

import sys
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import SplitResult, parse_qs, quote, unquote, urlsplit

from planner.part.importers.pieces import MAX_BYTES
from planner.studio.answers import Answer, Answers, refused
from planner.studio.folder import Folder
from runtime.shell.command import sentence_of
from runtime.shell.errors import ExpectedError

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
PATIENCE_S = 30.0  # longest silence of a client
MOST_SETTINGS_BYTES = 16 << 10
MOST_DIGITS = 12  # of the length of a request
STATIC = ("/studio.css", "/elements.js", "/studio.js", "/drawing.js", "/film.js")


class Studio(ThreadingTCPServer):
    """Serves a folder on a port of this machine (loopback); port 0 stands for any free port."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, folder: Folder, port: int) -> None:
        """Listens; raises `OSError` if the port is taken."""
        self.answers = Answers(folder)
        super().__init__((LOOPBACK, port), Handler)
        self.server_port = int(self.server_address[1])
        self.address = f"http://{LOOPBACK}:{self.server_port}/"

    def server_close(self) -> None:
        """Stops listening and reading drawings; plans continue."""
        super().server_close()
        self.answers.reader.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores broken connections, as a closed tab leaves them; prints other errors on the terminal."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """Answers one HTTP request."""

    server: Studio
    timeout = PATIENCE_S
    server_version, sys_version = "squeezetree", ""

    def do_GET(self) -> None:
        """Answers with a page, the folder's state or a file."""
        url, studio = self._url(), self.server.answers
        pages: dict[str, Callable[[], Answer]] = {"/": studio.page, "/folder.json": studio.state}
        if url.path in pages:
            self._answer(pages[url.path])
        elif url.path in STATIC:
            self._answer(lambda: studio.static(url.path[1:]))
        elif url.path == "/film.json":
            self._answer(lambda: studio.film(_first(url.query)))
        elif url.path.startswith("/files/"):
            self._answer(lambda: studio.file(unquote(url.path.removeprefix("/files/"))))
        else:
            self._answer(lambda: refused(404, "there is no such page"))

    def do_POST(self) -> None:
        """Performs an action for the page."""
        url, studio = self._url(), self.server.answers
        actions = {
            "/drawings": (studio.add, MAX_BYTES),
            "/preview": (studio.preview, MOST_SETTINGS_BYTES),
            "/plan": (studio.plan, MOST_SETTINGS_BYTES),
            "/stop": (studio.stop, MOST_SETTINGS_BYTES),
        }
        if self.headers.get("Origin") != f"http://{self.headers.get('Host')}":
            return self._answer(lambda: refused(403, "only the studio's page may ask for this"))
        if url.path not in actions:
            return self._answer(lambda: refused(404, "there is no such action"))
        action, most = actions[url.path]
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > MOST_DIGITS or int(length) > most:
            return self._answer(lambda: refused(413, f"is larger than {most >> 10} KB"))
        body = self.rfile.read(int(length))
        if len(body) < int(length):
            return self._answer(lambda: refused(400, "the request was cut off; try again"))
        return self._answer(lambda: action(_first(url.query), body))

    def _url(self) -> SplitResult:
        """The address that the browser asks for; an empty one if it is none."""
        try:
            return urlsplit(self.path)
        except ValueError:
            return urlsplit("")

    def _answer(self, work: Callable[[], Answer]) -> None:
        if self.headers.get("Host") not in [f"{name}:{self.server.server_port}" for name in NAMES]:
            work = lambda: refused(403, "ask for localhost or 127.0.0.1")  # noqa: E731
        try:
            answer = work()
        except (ExpectedError, OSError) as error:
            answer = refused(400, sentence_of(error))
        except Exception as error:
            what = f"{type(error).__name__}: {sentence_of(error)}"
            answer = refused(500, f"internal error, please report it: {what}")
        self.send_response(answer.code)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.body)))
        self.send_header("Content-Security-Policy", answer.policy)
        if answer.name:
            saved = f"attachment; filename*=UTF-8''{quote(answer.name, safe='')}"
            self.send_header("Content-Disposition", saved)
        for name, value in (
            ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"),
            ("X-Frame-Options", "DENY"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)

    def log_message(self, *_: object) -> None:
        """Logs nothing: the terminal shows only the address, and the page shows errors."""


def _first(query: str) -> dict[str, str]:
    """The fields of a query by name; of several fields with the same name, the first counts."""
    return {key: values[0] for key, values in parse_qs(query).items()}
