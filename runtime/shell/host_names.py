"""The addresses of a host by its name."""

import contextlib
import errno
import queue
import socket
import threading
from typing import Any


def addresses_of(host: str, port: int | None, seconds: float) -> list[Any]:
    """A host's addresses as from `socket.getaddrinfo`, looked up within `seconds` of wall time.

    A silent name server is left to a separate thread.

    Raises:
        OSError: the name is unknown, or there is no answer in time. UnicodeError: an invalid name.
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
