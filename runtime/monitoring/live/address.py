"""Where the live page is told: `PORT`, `HOST:PORT` or `[::1]:PORT`; without a host on this machine alone."""

import ipaddress
from typing import NamedTuple

from runtime.errors import ArgumentsError

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
    """Whether a host, by name or number, is this machine under its own name for itself."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def _is_odd(host: str, text: str) -> bool:
    """Whether what stands before the port is no host: a bare colon, an IPv6 address without its brackets."""
    if host.startswith("[") and host.endswith("]"):
        return ":" not in host
    return ":" in host or not set("[]/ ").isdisjoint(host) or text.startswith(":")
