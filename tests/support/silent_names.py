"""A name server that does not answer."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from programs import WAIT_S


@contextmanager
def silent_names() -> Iterator[None]:
    """Context in which look-ups of host names do not end; asserts that the body of the `with` waits for none.

    They end when the context is left.
    """
    asked, over, answered = socket.getaddrinfo, threading.Event(), list[bool]()

    def silent(*words: Any, **settings: Any) -> list[Any]:
        if settings.get("flags"):
            return list(asked(*words, **settings))
        answered.append(over.wait(WAIT_S))
        return []

    with patch.object(socket, "getaddrinfo", silent):
        yield
    over.set()
    assert False not in answered
