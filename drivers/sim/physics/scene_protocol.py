"""The scene's line protocol, both ends: it stands for the feeder, and tells the ground truth.

One JSON object a line. `{"do":"next_part"}` -> `{"part": k}`; `{"do":"truth"}` -> pose, squeezes, crashes,
status (pose null where the world has no pose to tell); `{"do":"quit"}` ends the cell. Nothing of this exists
in a real cell.
"""

import contextlib
import json
import math
import socket
import threading
from collections.abc import Callable, Mapping

from drivers.errors import LinkError, PortError
from drivers.ports import Truth
from drivers.sim.wire.serving import TcpServer
from runtime.shell import strict_json

ANSWER_S = 10.0
MAX_LINE = 4096


def truth_of(said: Mapping[str, object]) -> Truth:
    """What the scene's answer to "truth" tells."""
    x, y, theta = (
        math.nan if said[name] is None else float(str(said[name])) for name in ("x_mm", "y_mm", "theta_rad")
    )
    squeezes, crashes = int(str(said["squeezes"])), int(str(said["crashes"]))
    return Truth(x, y, theta, squeezes, crashes, str(said["status"]), said.get("covered") is True)


class Scene:
    """Client of a simulated cell's scene.

    Raises:
        PortError: nobody accepts the connection.
    """

    def __init__(self, host: str, port: int) -> None:
        self.endpoint = f"tcp://{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout=ANSWER_S)
        except OSError as error:
            raise PortError(
                f"nobody accepts a connection at {self.endpoint}; is grasp-cell running?"
            ) from error
        self._file = self._socket.makefile("rb")

    def next_part(self) -> int:
        """Take the part away and bring the next; returns its number.

        Raises:
            LinkError: the cell is gone, or refuses.
        """
        return int(str(self._ask("next_part")["part"]))

    def truth(self) -> Truth:
        """Where the part really is.

        Raises:
            LinkError: the cell is gone, or refuses.
        """
        return truth_of(self._ask("truth"))

    def close(self) -> None:
        """Hang up; the cell stays."""
        self._file.close()
        self._socket.close()

    def _ask(self, what: str) -> Mapping[str, object]:
        try:
            self._socket.sendall(json.dumps({"do": what}).encode() + b"\n")
            said = json.loads(self._file.readline(MAX_LINE) or "null")
        except (OSError, ValueError) as error:
            raise LinkError(f"scene {self.endpoint} broke: {error}") from error
        if not isinstance(said, dict) or "error" in said:
            reason = said.get("error") if isinstance(said, dict) else "the cell is gone"
            raise LinkError(f"scene {self.endpoint}: {reason}")
        return said


class SceneServer(TcpServer):
    """Answers scene requests of any number of clients.

    Args:
        answer: request -> reply.
        stopped: tells that the cell stops.
    """

    def __init__(self, answer: Callable[[str], Mapping[str, object]], stopped: threading.Event) -> None:
        super().__init__("scene", stopped)
        self._answer = answer

    def _run(self) -> None:
        pending: dict[socket.socket, bytes] = {}  # of each client, what is no whole line yet
        with contextlib.ExitStack() as clients:
            while not self._stopped.is_set():
                for ready in self._readable([self._listener, *pending]):
                    if ready is self._listener:
                        pending[clients.enter_context(ready.accept()[0])] = b""
                    elif (left := self._heard(ready, pending.pop(ready))) is not None:
                        pending[ready] = left

    def _heard(self, client: socket.socket, pending: bytes) -> bytes | None:
        """Answer the lines of a client; returns what is left over, None once it is gone."""
        with contextlib.suppress(OSError):
            data = client.recv(MAX_LINE)
            *lines, left = (pending + data).split(b"\n")
            for line in lines:
                client.sendall(json.dumps(self._reply(line)).encode() + b"\n")
            if data and len(left) <= MAX_LINE:
                return left
        client.close()
        return None

    def _reply(self, line: bytes) -> Mapping[str, object]:
        try:
            request = strict_json.parse(line)
            what = request["do"]
        except (ValueError, TypeError, KeyError):
            return {"error": 'not understood; send {"do": "next_part"}, {"do": "truth"} or {"do": "quit"}'}
        return self._answer(str(what))
