"""The HTTP server of the live page, and the addresses of all servers of a run.

The server answers the methods GET and HEAD for a few pages; other requests get one sentence. If its address
has no host, only this machine can connect.
"""

import contextlib
import ipaddress
import re
import socket
import threading
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from typing import NamedTuple, Self
from urllib.parse import urlsplit

from runtime.devices.clock import SystemClock
from runtime.shell.errors import UsageError

LOOPBACK = "127.0.0.1"
MAX_PORT = 65535
Pages = Mapping[str, tuple[str, Callable[[], bytes]]]
REQUEST = re.compile(rb"([A-Z]{1,10}) (/[!-~]*) HTTP/1\.[01]\r?$")
HOST = re.compile(rb"^host[ \t]*:(.*)$", re.IGNORECASE | re.MULTILINE)
TEXT = "text/plain; charset=utf-8"
MOST_CLIENTS = 8  # a further client disconnects the client that connected first
PATIENCE_S = 5.0
PAUSE_S = 0.02  # pause after each accepted client: at most fifty a second
MAX_ASK_BYTES = 8192
# No caching, no guessing of media types, no frames; a response ends with its connection.
ALWAYS = """\
Cache-Control: no-store\r
X-Content-Type-Options: nosniff\r
X-Frame-Options: DENY\r
Connection: close\r
"""


class Address(NamedTuple):
    """A host, given by name or number, and a TCP port; port 0 stands for any free port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse(text: str, option: str = "--http") -> Address:
    """Parses the address that is the value of an option: `PORT`, `HOST:PORT` or `[HOST]:PORT`.

    Args:
        text: the value; without a host, the host is this machine.
        option: name of the option, for error messages.

    Raises:
        UsageError: the text is not an address.
    """
    netloc = text if ":" in text else f"{LOOPBACK}:{text}"
    try:
        url = urlsplit(f"//{netloc}")
        host, port = url.hostname, url.port
    except ValueError:
        host = port = None
    if not host or port is None or url.netloc != netloc or not set("@ ").isdisjoint(netloc):
        raise UsageError(
            f"{option} {text}: write PORT or HOST:PORT, the port from 1 to {MAX_PORT}, or 0 for a free one"
        )
    return Address(host, port)


def served(
    text: str, option: str, schemes: Collection[str], *, network: bool, risk: str
) -> Address:
    """Parses the address `SCHEME://HOST:PORT` at which a server listens, and checks that it is allowed.

    Args:
        text: value of the option that states the address.
        option: name of the option.
        schemes: the valid schemes.
        network: whether other machines may reach the address.
        risk: what any client that connects may do, for the error message.

    Raises:
        UsageError: the text is not such an address, or other machines reach it although `network` is false.
    """
    scheme, _, place = text.partition("://")
    address = None
    with contextlib.suppress(UsageError):
        address = parse(place, option) if scheme in schemes else None
    if address is None:
        forms = " or ".join(f"{name}://{LOOPBACK}:PORT" for name in schemes)
        ports = f"the port from 1 to {MAX_PORT}, or 0 for a free one"
        raise UsageError(f"{option} {text}: write {forms}, {ports}")
    if not (network or is_loopback(address.host)):
        raise UsageError(
            f"{option} {text}: there is no password, and whoever reaches that address may {risk}; "
            "add --network if nothing but the cell's own network does"
        )
    return address


def is_loopback(host: str) -> bool:
    """Whether a host, given by name or number, is this machine itself (loopback)."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class PageServer:
    """Serves pages over HTTP in separate threads; leaving the context ends the server.

    The server and the run never wait for each other. To bound the load, the server limits how many clients
    are connected, how many connect in a second, how many bytes a request has, and how long a request and its
    response take. A client that sends no complete request within `PATIENCE_S` is disconnected.

    Args:
        address: the address; port 0 takes any free port.
        pages: media type and content of each page, by path.

    Attributes:
        address: the address with the actual port.
        local: whether only this machine can connect.

    Raises:
        UsageError: the address is not available.
    """

    def __init__(self, address: Address, pages: Pages) -> None:
        self._listener = listening(address, "--http")
        self._pages, self._clock = pages, SystemClock()
        self.address = Address(address.host, int(self._listener.getsockname()[1]))
        self.local = is_loopback(address.host)
        self._clients: dict[socket.socket, threading.Thread] = {}  # open ones, the oldest first
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="http", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops listening, and ends all connections."""
        self._ended.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # ends its `accept`
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve(self) -> None:
        with self._listener:
            while not self._ended.is_set():
                # An error means that the client is gone, or that no descriptors or threads are left. The
                # pause below helps then, too.
                with contextlib.suppress(OSError, RuntimeError):
                    self._let_in(self._listener.accept()[0])
                self._ended.wait(PAUSE_S)
        for client, thread in tuple(self._clients.items()):
            self._disconnect(client)
            thread.join()

    def _let_in(self, client: socket.socket) -> None:
        others = tuple(self._clients)
        if len(others) >= MOST_CLIENTS:
            self._disconnect(others[0])
        thread = threading.Thread(target=self._converse, args=(client,), name="http", daemon=True)
        with self._lock:
            thread.start()
            self._clients[client] = thread

    def _disconnect(self, client: socket.socket) -> None:
        """Shuts down a client's connection if it is still open; this also ends the client's thread."""
        with self._lock, contextlib.suppress(OSError):
            if self._clients.pop(client, None) is not None:
                client.shutdown(socket.SHUT_RDWR)

    def _converse(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            asked = self._read(client)
            if asked is not None:
                client.settimeout(PATIENCE_S)
                client.sendall(answer(self._pages, asked, local=self.local))
                client.shutdown(socket.SHUT_WR)
        with self._lock:
            self._clients.pop(client, None)
            client.close()

    def _read(self, client: socket.socket) -> bytes | None:
        """Receives the head of a request; returns None if no complete head comes within `PATIENCE_S`."""
        asked, until = b"", self._clock.now() + PATIENCE_S
        while b"\r\n\r\n" not in asked and b"\n\n" not in asked:
            client.settimeout(max(until - self._clock.now(), 1e-3))
            try:
                piece = client.recv(MAX_ASK_BYTES)
            except TimeoutError:
                piece = b""
            asked += piece
            if not piece or len(asked) > MAX_ASK_BYTES:
                return None
        return asked


def listening(address: Address, option: str, *, at_once: bool = True) -> socket.socket:
    """Returns a socket that listens at an address.

    Args:
        address: the address.
        option: the option that states the address, for error messages.
        at_once: whether the socket listens now. Otherwise the socket only reserves the address, and
            connections are refused.

    Raises:
        UsageError: the address is not available.
    """
    try:
        family, kind, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise UsageError(
            f"{option} {address}: {address.host} is no host of this network; {_WORD}"
        ) from error
    listener = socket.socket(family, kind | socket.SOCK_CLOEXEC)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(place)
        if at_once:
            listener.listen(MOST_CLIENTS)
    except OSError as error:
        listener.close()
        raise UsageError(f"{option} {address}: {_sentence(error, address)}") from error
    return listener


_WORD = "name an address of this machine, or the port alone"


def _sentence(error: OSError, address: Address) -> str:
    reason = (error.strerror or str(error)).lower()
    if isinstance(error, PermissionError):
        return f"{reason}: ports below 1024 are for root; take one above, such as 8080"
    if address.port and "in use" in reason:
        return f"{reason}; name another port, or 0 for a free one"
    return f"{reason}; {_WORD}"


def response(code: int, kind: str, body: bytes, more: str = "") -> bytes:
    """Builds an HTTP response.

    Args:
        code: status code.
        kind: media type of the body.
        body: the body.
        more: further header lines, each with its line end.
    """
    status = HTTPStatus(code)
    head = f"HTTP/1.0 {status} {status.phrase}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return f"{head}{more}{ALWAYS}\r\n".encode() + body


def answer(pages: Pages, asked: bytes, *, local: bool) -> bytes:
    """Returns the complete HTTP response to a request.

    Args:
        pages: media type and content of each page, by path.
        asked: the request's head.
        local: whether to refuse requests whose header names a host other than this machine. Then a foreign
            page whose host name resolves to this machine (DNS rebinding) can read nothing.
    """
    line, _, fields = asked.partition(b"\n")
    understood = REQUEST.match(line)
    if understood is None:
        return response(400, TEXT, b"this is no HTTP/1.0 or HTTP/1.1 request\n")
    method, path = understood[1].decode(), understood[2].decode().partition("?")[0]
    if method not in ("GET", "HEAD"):
        return response(405, TEXT, b"read only: GET and HEAD\n", "Allow: GET, HEAD\r\n")
    if local and not _asks_here(fields):
        reply = response(403, TEXT, b"ask for localhost or 127.0.0.1\n")
    elif path not in pages:
        reply = response(404, TEXT, f"there are {', '.join(pages)}\n".encode())
    else:
        kind, page = pages[path]
        reply = response(200, kind, page())
    return reply if method == "GET" else reply[: reply.index(b"\r\n\r\n") + 4]


def _asks_here(fields: bytes) -> bool:
    named = HOST.findall(fields)
    if len(named) != 1:
        return not named  # HTTP/1.0 need not name a host; no browser omits it
    host = re.sub(r":\d*$", "", named[0].decode("latin-1").strip())
    return is_loopback(host.strip("[]"))
