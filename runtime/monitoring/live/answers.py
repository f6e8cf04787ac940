"""The answers to a browser's requests: GET and HEAD of a few pages, one sentence for all else."""

import re
from collections.abc import Callable, Mapping

from runtime.monitoring.http_server import response
from runtime.monitoring.live.server import is_loopback

Page = Callable[[], bytes]
REQUEST = re.compile(rb"([A-Z]{1,10}) (/[!-~]*) HTTP/1\.[01]\r?$")
HOST = re.compile(rb"^host[ \t]*:(.*)$", re.IGNORECASE | re.MULTILINE)
TEXT = "text/plain; charset=utf-8"


class Answers:
    """The pages of one server.

    Args:
        pages: by path, each with its media type.
        local: whether only questions to this machine's own name are answered: a page elsewhere that has its
            name point here (DNS rebinding) then learns nothing.
    """

    def __init__(self, pages: Mapping[str, tuple[str, Page]], *, local: bool) -> None:
        self._pages, self._local = pages, local

    def __call__(self, asked: bytes) -> bytes:
        """The whole response to a request's head."""
        line, _, fields = asked.partition(b"\n")
        understood = REQUEST.match(line)
        if understood is None:
            return response(400, TEXT, b"this is no HTTP/1.0 or HTTP/1.1 request\n")
        method, path = understood[1].decode(), understood[2].decode().partition("?")[0]
        if method not in ("GET", "HEAD"):
            return response(405, TEXT, b"read only: GET and HEAD\n", "Allow: GET, HEAD\r\n")
        if self._local and not _asks_here(fields):
            return self._cut(method, response(403, TEXT, b"ask for localhost or 127.0.0.1\n"))
        if path not in self._pages:
            told = f"there are {', '.join(self._pages)}\n".encode()
            return self._cut(method, response(404, TEXT, told))
        kind, page = self._pages[path]
        return self._cut(method, response(200, kind, page()))

    @staticmethod
    def _cut(method: str, answer: bytes) -> bytes:
        """Cut the response to a HEAD request to its head."""
        return answer if method == "GET" else answer[: answer.index(b"\r\n\r\n") + 4]


def _asks_here(fields: bytes) -> bool:
    named = HOST.findall(fields)
    if len(named) != 1:
        return not named  # HTTP/1.0 need not name a host; no browser leaves it out
    host = re.sub(r":\d*$", "", named[0].decode("latin-1").strip())
    return is_loopback(host.strip("[]"))
