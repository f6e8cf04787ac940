"""The status of a run on a Unix socket.

```
$ curl -s --unix-socket cell.sock http://cell/           one JSON object
$ curl -s --unix-socket cell.sock http://cell/metrics    Prometheus text
```

A client that says nothing, or no HTTP, gets the JSON object and nothing around it. The socket belongs to the
process: clients may come and go, and can change nothing.
"""

import json
import socket
from pathlib import Path

from runtime.errors import ArgumentsError
from runtime.monitoring.http_server import MOST_CLIENTS, Server, response
from runtime.monitoring.status import Status

ASK_S = 0.25  # how long a client may take to say what it wants


class StatusServer(Server):
    """Answers for a status on a Unix socket; one that nobody listens at any more is replaced.

    Raises:
        ArgumentsError: the socket cannot be made there, or somebody else listens.
    """

    def __init__(self, path: Path, status: Status) -> None:
        self._path, self._status = path, status
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        try:
            _bind(listener, path)
            listener.listen(MOST_CLIENTS)
        except OSError as error:
            listener.close()
            raise ArgumentsError(
                f"--status {path}: {error.strerror or error}; name another path"
            ) from error
        super().__init__(listener, self._told, ASK_S)

    def close(self) -> None:
        """Stop answering and remove the socket."""
        super().close()
        if self._path.is_socket():  # what somebody else put there stays
            self._path.unlink()

    def _told(self, asked: bytes) -> bytes:
        words = asked.split()
        plain = json.dumps(self._status.as_object()).encode() + b"\n"
        if len(words) < 2 or words[0] not in (b"GET", b"HEAD"):
            return plain
        if words[1].startswith(b"/metrics"):
            return response(200, "text/plain; version=0.0.4", self._status.as_metrics().encode())
        return response(200, "application/json", plain)


def _bind(server: socket.socket, path: Path) -> None:
    try:
        server.bind(str(path))
    except OSError:
        if not path.is_socket() or _is_answered(path):
            raise
        path.unlink()  # left behind by a process that was killed
        server.bind(str(path))


def _is_answered(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        return probe.connect_ex(str(path)) == 0
