"""The studio's HTTP server: pages and files of one folder, for this machine's own browser.

It listens on loopback, answers no other name (DNS rebinding) and obeys no other page (same origin). Nothing
on its pages comes from elsewhere. Others may write in the folder: a browser opens its files in a sandbox.
"""

import json
from collections.abc import Callable
from functools import cached_property
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingTCPServer
from typing import Any, NamedTuple
from urllib.parse import parse_qs, quote, unquote, urlsplit

from jinja2 import Environment, PackageLoader, StrictUndefined

from planner.job.drafts import FINGERS, GRIPPERS
from planner.part.importers.file import SUFFIXES
from planner.part.importers.pieces import MAX_BYTES, UNITS_MM
from planner.studio.folder import PICTURE, Folder, Plan
from planner.studio.reader import Reader
from planner.studio.steps import beginning, typed
from runtime.pages.frame import asset
from runtime.shell.command import sentence_of
from runtime.shell.errors import ExpectedError, UsageError

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
PATIENCE_S = 30.0  # that a client may stay silent
MOST_FILE_BYTES = 256 << 20
MOST_SETTINGS_BYTES = 16 << 10
PAGE = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
SANDBOX = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:"
)
KINDS = {
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".js": "text/javascript",
    ".css": "text/css",
}
JSON = "application/json"
TEXT = ("text/plain; charset=utf-8", (".toml", ".jsonl", ".csv", ".txt"))


class Answer(NamedTuple):
    """A response."""

    body: bytes
    kind: str = JSON
    policy: str = SANDBOX
    code: int = 200
    name: str = ""  # of a file that a browser saves


class Studio(ThreadingTCPServer):
    """Serves a folder on a port of loopback, 0 for a free one."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, folder: Folder, port: int) -> None:
        """Listens; an `OSError` tells that the port is taken."""
        self.folder, self.reader = folder, Reader(folder.path)
        super().__init__((LOOPBACK, port), Handler)
        self.server_port = int(self.server_address[1])
        self.address = f"http://{LOOPBACK}:{self.server_port}/"

    def server_close(self) -> None:
        """Stop listening, and reading drawings; plans go on."""
        super().server_close()
        self.reader.close()

    def page(self) -> Answer:
        """The page; what is in the folder it asks for."""
        text = self._templates.get_template("studio.html").render(
            folder=self.folder.path.name or "/",
            suffixes=SUFFIXES,
            unit_options=[(unit, unit) for unit in UNITS_MM],
            gripper_options=[
                (name, f"{name}, {preset.opening_mm:g} mm") for name, preset in GRIPPERS.items()
            ],
            finger_options=[
                (name, f"{pads.material}, {pads.low:g} to {pads.high:g}")
                for name, pads in FINGERS.items()
            ],
        )
        return Answer(text.encode(), "text/html; charset=utf-8", PAGE)

    @cached_property
    def _templates(self) -> Environment:
        loader = PackageLoader("planner.studio", "templates")
        return Environment(loader=loader, autoescape=True, undefined=StrictUndefined)

    def static(self, name: str) -> Answer:
        """A stylesheet or script of ours."""
        path = Path(__file__).parent / "templates" / name
        shared = asset("style.css") if name == "studio.css" else ""
        text = shared + path.read_text("utf-8")
        return Answer(text.encode(), f"{KINDS[path.suffix]}; charset=utf-8", PAGE)

    def state(self) -> Answer:
        """What is in the folder."""
        files = self.folder.files()
        drawings = [
            file.name
            for file in files
            if file.name.lower().endswith(SUFFIXES) and not file.name.endswith(PICTURE)
        ]
        listed = [file._asdict() for file in files]
        plans = [_shown(plan) for plan in self.folder.plans()]
        return _object({"drawings": drawings, "plans": plans, "files": listed})

    def file(self, name: str) -> Answer:
        """A file of the folder: shown by the browser where it can, else saved."""
        data, suffix = self.folder.read(name, MOST_FILE_BYTES), Path(name).suffix
        if suffix in TEXT[1]:
            return Answer(data, TEXT[0])
        shown = suffix in (".html", ".svg")
        return Answer(
            data, KINDS[suffix] if shown else "application/octet-stream", name="" if shown else name
        )

    def add(self, query: dict[str, str], body: bytes) -> Answer:
        """Keep a drawing."""
        return _object({"drawing": self.folder.add(query.get("name", ""), body)})

    def preview(self, query: dict[str, str], body: bytes) -> Answer:
        """What a drawing shows with some settings."""
        drawing = query.get("drawing", "")
        arguments = self.folder.arguments(drawing, _settings(body))
        command = typed(["try", beginning(drawing), *arguments])
        return _object({**self.reader.ask([beginning(drawing), *arguments]), "command": command})

    def plan(self, query: dict[str, str], body: bytes) -> Answer:
        """Begin to plan."""
        drawing = query.get("drawing", "")
        arguments = self.folder.arguments(drawing, _settings(body))
        refused = self.reader.ask([beginning(drawing), *arguments])["error"]
        if refused:
            raise UsageError(refused)
        return _object({"plan": self.folder.begin(drawing, arguments)})

    def stop(self, query: dict[str, str], _body: bytes) -> Answer:
        """Ask a plan to end with what stands."""
        self.folder.stop(query.get("plan", ""))
        return _object({})


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: Studio
    timeout = PATIENCE_S
    server_version, sys_version = "squeezetree", ""

    def do_GET(self) -> None:
        """Answer with a page, the folder's state or a file."""
        path, studio = urlsplit(self.path).path, self.server
        pages: dict[str, Callable[[], Answer]] = {"/": studio.page, "/folder.json": studio.state}
        if path in pages:
            self._answer(pages[path])
        elif path in ("/studio.css", "/studio.js", "/drawing.js"):
            self._answer(lambda: studio.static(path[1:]))
        elif path.startswith("/files/"):
            self._answer(lambda: studio.file(unquote(path.removeprefix("/files/"))))
        else:
            self._answer(lambda: _refused(404, "there is no such page"))

    def do_POST(self) -> None:
        """Do what the page asks for."""
        url, studio = urlsplit(self.path), self.server
        actions = {
            "/drawings": (studio.add, MAX_BYTES),
            "/preview": (studio.preview, MOST_SETTINGS_BYTES),
            "/plan": (studio.plan, MOST_SETTINGS_BYTES),
            "/stop": (studio.stop, MOST_SETTINGS_BYTES),
        }
        if self.headers.get("Origin") != f"http://{self.headers.get('Host')}":
            return self._answer(lambda: _refused(403, "only the studio's page may ask for this"))
        if url.path not in actions:
            return self._answer(lambda: _refused(404, "there is no such action"))
        action, most = actions[url.path]
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > most:
            return self._answer(lambda: _refused(413, f"is larger than {most >> 10} KB"))
        query = {key: values[0] for key, values in parse_qs(url.query).items()}
        body = self.rfile.read(int(length))
        if len(body) < int(length):
            return self._answer(lambda: _refused(400, "the request was cut off; try again"))
        return self._answer(lambda: action(query, body))

    def _answer(self, work: Callable[[], Answer]) -> None:
        if self.headers.get("Host") not in [f"{name}:{self.server.server_port}" for name in NAMES]:
            work = lambda: _refused(403, "ask for localhost or 127.0.0.1")  # noqa: E731
        try:
            answer = work()
        except (ExpectedError, OSError) as error:
            answer = _refused(400, sentence_of(error))
        except Exception as error:
            words = (
                f"internal error, please report it: {type(error).__name__}: {sentence_of(error)}"
            )
            answer = _refused(500, words)
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
        """Say nothing: the terminal has the address, and later errors are on the page."""


def _shown(plan: Plan) -> dict[str, Any]:
    return {**plan._asdict(), "log": plan.log._asdict()}


def _settings(body: bytes) -> dict[str, Any]:
    try:
        settings = json.loads(body)
    except (ValueError, RecursionError):
        settings = None
    if not isinstance(settings, dict):
        raise UsageError("settings are a JSON object")
    return settings


def _object(values: dict[str, Any], code: int = 200) -> Answer:
    return Answer(json.dumps(values).encode(), code=code)


def _refused(code: int, reason: str) -> Answer:
    return _object({"error": reason}, code)
