"""Looks up the addresses of a host, with a deadline."""

import contextlib
import errno
import queue
import socket
import threading
from typing import Any


def addresses_of(host: str, port: int | None, seconds: float) -> list[Any]:
    """Looks up a host's addresses; returns them in the form of `socket.getaddrinfo`.

    If the name server does not answer in time, a thread goes on waiting for its answer.

    Args:
        host: name or number of the host.
        port: TCP port to include in the addresses.
        seconds: deadline, in s of wall time.

    Raises:
        OSError: the name is unknown, or there is no answer in time.
        UnicodeError: the name is invalid.
    """
    with contextlib.suppress(socket.gaierror):
        return socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST)
    answers: queue.SimpleQueue[list[Any] | Exception] = queue.SimpleQueue()

    def look_up() -> None:
        try:
            answers.put(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
        except Exception as error:
            answers.put(error)

    threading.Thread(target=look_up, name="look-up", daemon=True).start()
    try:
        answer = answers.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError(errno.ETIMEDOUT, f"no name server tells the address of {host}") from None
    if isinstance(answer, Exception):
        raise answer
    return answer
