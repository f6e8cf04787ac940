"""The TCP server of the live page, and where it listens: `PORT`, `HOST:PORT` or `[::1]:PORT`.

Without a host it listens for this machine alone.
"""

import ipaddress
import socket
from collections.abc import Callable
from typing import NamedTuple

from runtime.errors import ArgumentsError
from runtime.monitoring.http_server import MOST_CLIENTS, Server

LOOPBACK = "127.0.0.1"
MAX_PORT = 65535


class Address(NamedTuple):
    """A host, by name or number, and a TCP port; port 0 stands for any that is free."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse(text: str) -> Address:
    """Read an address.

    Args:
        text: as `--http` takes it.

    Raises:
        ArgumentsError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and int(port) <= MAX_PORT) or _is_odd(
        host, text
    ):
        raise ArgumentsError(
            f"--http {text}: write PORT or HOST:PORT, the port from 1 to {MAX_PORT}, or 0 for a free one"
        )
    return Address(host.strip("[]") or LOOPBACK, int(port))


def is_loopback(host: str) -> bool:
    """Whether a host, by name or number, is a loopback address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class PageServer(Server):
    """Answers requests on a TCP port in a thread of its own; leaving the context ends it.

    Args:
        address: where to listen.
        answer: the whole response to a request's head.

    Attributes:
        address: where it listens, port 0 replaced by the one that was free.

    Raises:
        ArgumentsError: nothing can listen there.
    """

    def __init__(self, address: Address, answer: Callable[[bytes], bytes]) -> None:
        listener = _listening(address)
        self.address = Address(address.host, int(listener.getsockname()[1]))
        super().__init__(listener, answer)


def _is_odd(host: str, text: str) -> bool:
    """Whether the text before the port is no host: a bare colon, an IPv6 address without its brackets."""
    if host.startswith("[") and host.endswith("]"):
        return ":" not in host
    return ":" in host or not set("[]/ ").isdisjoint(host) or text.startswith(":")


def _listening(address: Address) -> socket.socket:
    """A socket that listens at an address."""
    try:
        family, kind, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise ArgumentsError(
            f"--http {address}: {address.host} is no host of this network; {_WORD}"
        ) from error
    listener = socket.socket(family, kind | socket.SOCK_CLOEXEC)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(place)
        listener.listen(MOST_CLIENTS)
    except OSError as error:
        listener.close()
        raise ArgumentsError(f"--http {address}: {_told(error, address)}") from error
    return listener


_WORD = "name an address of this machine, or the port alone"


def _told(error: OSError, address: Address) -> str:
    reason = (error.strerror or str(error)).lower()
    if isinstance(error, PermissionError):
        return f"{reason}: ports below 1024 are for root; take one above, such as 8080"
    if address.port and "in use" in reason:
        return f"{reason}; name another port, or 0 for a free one"
    return f"{reason}; {_WORD}"
