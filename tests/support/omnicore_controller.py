"""A simulated OmniCore controller: the Robot Web Services 2 that the driver uses, and its RAPID program.

The arm moves as the simulated IRC5 arm. The program `SqueezeTree.modx` is rewritten here in Python; other
RAPID is not executed. The caller provides a certificate for TLS.
"""

import base64
import hashlib
import json
import re
import ssl
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from drivers.abb.codec import Pose
from drivers.abb.omnicore import MODULE, POINTER, ROUTINE, SYMBOL, TASK, UNIT
from drivers.abb.rws import ACCEPT, FACTORY, FORM
from drivers.sim.devices.arm import ArmModel, HaltError
from drivers.sim.wire.serving import LibraryServer

MAIN = ("Module1", "main")  # module and routine of another program of the cell
REALM = "validusers@robapi.abb"
NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
IDENTITY_TEXT = "[[0,0,0],[1,0,0,0]]"
NUMBERS = {"sq_speed": "20", "sq_turn": "10", "sq_request": "0", "sq_started": "0", "sq_done": "0"}


class RefusedError(Exception):
    """Raised where the controller refuses a request; `status` is the HTTP status of the answer."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class OmniCore:
    """The controller's state and program.

    At first nothing runs, and the program pointer is in another program of the cell.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.mode, self.motors = "AUTO", "motoron"
        self.running = False
        self.pointer = MAIN
        self.master = False  # whether a client holds mastership over edits
        poses = dict.fromkeys(("sq_tframe", "sq_oframe", "sq_target"), IDENTITY_TEXT)
        self.symbols = {**poses, "sq_version": "1", "sq_fastest": "250", **NUMBERS}
        self._arm = arm  # moves as commanded
        self._ends_s = -1.0  # time at which the motion under way ends; negative: there is none

    def advance(self, now_s: float) -> None:
        """Executes the program up to the time `now_s`."""
        if not (self.running and self.pointer == (MODULE, ROUTINE)):
            return
        if 0.0 <= self._ends_s <= now_s:
            self._ends_s = -1.0
            self.symbols["sq_done"] = self.symbols["sq_started"]
        if self._ends_s < 0.0 and self.symbols["sq_request"] != self.symbols["sq_done"]:
            self.symbols["sq_started"] = self.symbols["sq_request"]
            speed = min(float(self.symbols["sq_speed"]), float(self.symbols["sq_fastest"]))
            self._arm.frames(self._pose("sq_tframe"), self._pose("sq_oframe"))
            try:
                pacing = (speed, float(self.symbols["sq_turn"]))
                self._ends_s = self._arm.line(self._pose("sq_target"), pacing, now_s)
            except HaltError:
                self.running = False

    def stop(self, now_s: float) -> None:
        """Stops program and arm."""
        self.advance(now_s)
        self._arm.stop(now_s)
        self.running, self._ends_s = False, -1.0

    def read(self, path: str, now_s: float) -> list[dict[str, Any]]:
        """Returns the content of the resource at a path.

        Raises:
            RefusedError: there is no such resource.
        """
        self.advance(now_s)
        flange = self._arm.flange_at(now_s)
        axes = {f"rax_{n}": f"{angle:.6f}" for n, angle in enumerate(self._arm.joints_at(now_s), 1)}
        place = {"x": flange.x_mm, "y": flange.y_mm, "z": flange.z_mm}
        place |= dict(zip(("q1", "q2", "q3", "q4"), flange.rotation, strict=True))
        module, routine = self.pointer
        unit = f"/rw/motionsystem/mechunits/{UNIT}"
        match path:
            case "/rw/panel/opmode":
                kind, fields = "pnl-opmode", {"opmode": self.mode}
            case "/rw/panel/ctrl-state":
                kind, fields = "pnl-ctrlstate", {"ctrlstate": self.motors}
            case "/rw/rapid/execution":
                state = "running" if self.running else "stopped"
                kind, fields = "rap-execution", {"ctrlexecstate": state}
            case _ if path == POINTER:
                at = {"_title": "progpointer", "modulemame": module, "routinename": routine}
                return [{"_type": "pcp-info", **row} for row in (at, {"_title": "motionpointer"})]
            case _ if path == f"{unit}/jointtarget":
                kind, fields = "ms-jointtarget", axes
            case _ if path == f"{unit}/cartesian":
                kind = "ms-mechunit-cartesian"
                fields = {name: f"{value:.6f}" for name, value in place.items()}
            case _:
                kind, fields = "rap-data", {"value": self.symbols[self._name(path)]}
        return [{"_type": kind, **fields}]

    def write(self, path: str, form: dict[str, str], now_s: float, *, implicit: bool) -> None:
        """Executes a request that changes the resource at a path, or that starts an action.

        An `implicit` request takes mastership while it is executed.

        Raises:
            RefusedError: the change is not allowed.
        """
        self.advance(now_s)
        match path:
            case "/rw/mastership/edit/request" | "/rw/mastership/request":
                self.master = True
            case "/rw/mastership/edit/release" | "/rw/mastership/release":
                self.master = False
            case "/rw/rapid/execution/stop":
                self.stop(now_s)
            case "/rw/rapid/execution/resetpp":
                self._need(self.master and not self.running, "mastership, or a program runs")
                self.pointer = MAIN
            case "/rw/rapid/execution/start":
                self._need(not self.master and implicit, "mastership")
                self._need(self.mode == "AUTO" and self.motors == "motoron", "mode or motors")
                self.running = True
                self.symbols |= dict.fromkeys(("sq_started", "sq_done"), self.symbols["sq_request"])
            case _ if path == f"{POINTER}/routine":
                self._need(self.master and not self.running, "mastership, or a program runs")
                self.pointer = (form.get("module", ""), form.get("routine", ""))
            case _:
                name, value = self._name(path), form.get("value", "")
                self._need(implicit or self.master, "mastership")
                self._need(_fits(value, self.symbols[name]), "the value is none of its type")
                self.symbols[name] = value
                self.advance(now_s)

    def _name(self, path: str) -> str:
        name = path.removeprefix(f"{SYMBOL}/").removesuffix("/data")
        if name not in self.symbols or path != f"{SYMBOL}/{name}/data":
            raise RefusedError(HTTPStatus.NOT_FOUND, f"no such resource in {TASK}")
        return name

    def _need(self, given: bool, what: str) -> None:
        if not given:
            raise RefusedError(HTTPStatus.FORBIDDEN, f"not allowed: {what}")

    def _pose(self, name: str) -> Pose:
        x, y, z, *turn = (float(match[0]) for match in NUMBER.finditer(self.symbols[name]))
        w, a, b, c = turn
        return Pose(x, y, z, (w, a, b, c))


def _fits(value: str, old: str) -> bool:
    if old.startswith("["):
        bare = NUMBER.sub("0", value)
        return bare == NUMBER.sub("0", IDENTITY_TEXT)
    return NUMBER.fullmatch(value) is not None


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """Prints nothing: a client may leave, or refuse the certificate."""
        del request, client_address


class RwsServer(LibraryServer):
    """Serves the web services of a controller on a port of this machine, with TLS.

    Args:
        model: the controller.
        lock: held while a request is served.
        now: returns simulated seconds.
        certificate: PEM file of a certificate and its key.
        digest: whether clients sign in by Digest instead of Basic.
    """

    def __init__(
        self,
        model: OmniCore,
        lock: AbstractContextManager[object],
        now: Callable[[], float],
        certificate: str,
        *,
        digest: bool = False,
    ) -> None:
        self.mute = False
        self.requests = 0
        self._stopped = threading.Event()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate)
        http = _Http(("127.0.0.1", 0), _handler(self, model, lock, now, digest=digest))
        # Each handler makes its own handshake: a client that only connects must not block others.
        late = {"do_handshake_on_connect": False}
        http.socket = context.wrap_socket(http.socket, server_side=True, **late)
        super().__init__(http)
        self.port: int = http.server_address[1]
        self.url = f"omnicore://127.0.0.1:{self.port}"

    def close(self) -> None:
        """Stops serving, and releases the requests that wait in `silent`."""
        self._stopped.set()
        super().close()

    def silent(self) -> bool:
        """Counts a request; returns True if the request must stay without an answer, else False.

        On a mute server, the call waits until the server is closed, and only then returns True.
        """
        self.requests += 1
        return self.mute and self._stopped.wait()


def _handler(
    server: RwsServer,
    model: OmniCore,
    lock: AbstractContextManager[object],
    now: Callable[[], float],
    *,
    digest: bool,
) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
            self._answer(changes=False)

        def do_POST(self) -> None:
            self._answer(changes=True)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class names it
            del format, args

        def _answer(self, *, changes: bool) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
            if server.silent():
                return
            if not self._signed_in():
                challenge = f'Digest realm="{REALM}", nonce="0123abcd", qop="auth", opaque="x"'
                asked = {"WWW-Authenticate": challenge if digest else f'Basic realm="{REALM}"'}
                self._send(HTTPStatus.UNAUTHORIZED, {"status": {"msg": "sign in"}}, asked)
                return
            parts = urlsplit(self.path)
            query = {name: words[-1] for name, words in parse_qs(parts.query).items()}
            given = parse_qs(body, keep_blank_values=True).items()
            form = {name: words[-1] for name, words in given}
            try:
                with lock:
                    if not changes:
                        self._expect("Accept", ACCEPT, HTTPStatus.NOT_ACCEPTABLE)
                        self._send(HTTPStatus.OK, {"state": model.read(parts.path, now())})
                        return
                    self._expect("Content-Type", FORM, HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
                    implicit = query.get("mastership") == "implicit"
                    model.write(parts.path, form, now(), implicit=implicit)
                self._send(HTTPStatus.NO_CONTENT, None)
            except RefusedError as error:
                self._send(error.status, {"status": {"code": -1, "msg": str(error)}})

        def _expect(self, header: str, value: str, otherwise: HTTPStatus) -> None:
            if self.headers.get(header) != value:
                raise RefusedError(otherwise, f"{header} must be {value}")

        def _signed_in(self) -> bool:
            result = self.headers.get("Authorization") or ""
            if not digest:
                return result == "Basic " + base64.b64encode(":".join(FACTORY).encode()).decode()
            given = dict(re.findall(r'(\w+)="?([^",]+)"?', result))
            ours = _md5(f"{FACTORY[0]}:{REALM}:{FACTORY[1]}")
            asked = _md5(f"{self.command}:{self.path}")
            middle = ":".join(given.get(name, "") for name in ("nonce", "nc", "cnonce", "qop"))
            return given.get("response") == _md5(f"{ours}:{middle}:{asked}")

        def _send(
            self, status: HTTPStatus, document: object, headers: dict[str, str] | None = None
        ) -> None:
            data = b"" if document is None else json.dumps(document).encode()
            self.send_response(status)
            headers = {"Set-Cookie": "-http-session-=7; path=/", **(headers or {})}
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Type", ACCEPT)
            if status != HTTPStatus.NO_CONTENT:
                self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

    return Handler


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
