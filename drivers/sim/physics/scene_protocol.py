"""The line protocol of a simulated cell's scene, for client and server.

The scene stands in for the feeder, and knows the ground truth; a real cell has none. Requests and answers are
JSON objects, one a line. `{"do":"next_part"}` -> `{"part": k}`; `{"do":"truth"}` -> the fields of
`drivers.ports.Truth` (null for the pose if the world has none); `{"do":"quit"}` ends the cell.
"""

import json
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from drivers.errors import LinkError, shown
from drivers.ports import Truth
from drivers.sim.wire.serving import Site
from drivers.stream import open_tcp
from runtime.shell import strict_json

ANSWER_S = 10.0
MAX_LINE = 4096


class Feeder:
    """Brings the parts of a simulated cell, and reads the ground truth about them.

    Args:
        ask: sends a request (`next_part`, `truth`) to the cell; returns the answer.
    """

    def __init__(self, ask: Callable[[str], Mapping[str, Any]]) -> None:
        self._ask = ask

    def next_part(self) -> int:
        """Brings the next part, and returns its number.

        Raises:
            LinkError: the cell is gone, or refuses.
        """
        return int(str(self._ask("next_part")["part"]))

    def truth(self) -> Truth:
        """Reads the ground truth about the part.

        Raises:
            LinkError: the cell is gone, or refuses.
        """
        return Truth(**self._ask("truth"))

    def close(self) -> None:
        """Does nothing: there is no connection to close."""


class Scene(Feeder):
    """Client of a simulated cell's scene; raises a PortError if the connection is refused."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(self._sent)
        self.endpoint = f"tcp://{host}:{port}"
        self._stream = open_tcp(host, port, self.endpoint, "is grasp-cell running?")
        self._lost = False  # whether pending data may answer an earlier question

    def close(self) -> None:
        """Disconnects; the cell continues."""
        self._stream.close()

    def _sent(self, what: str) -> Mapping[str, Any]:
        if self._lost:
            raise LinkError(f"scene {self.endpoint} broke before")
        try:
            self._lost = True  # until it has answered
            self._stream.send(json.dumps({"do": what}).encode() + b"\n")
            said = json.loads(self._line())
            self._lost = False
        except (OSError, ValueError, RecursionError) as error:
            raise LinkError(f"scene {self.endpoint} broke: {shown(error)}") from error
        if not isinstance(said, dict) or "error" in said:
            reason = said.get("error") if isinstance(said, dict) else "the cell is gone"
            raise LinkError(f"scene {self.endpoint}: {shown(reason)}")
        return {name: math.nan if value is None else value for name, value in said.items()}

    def _line(self) -> bytes:
        """Receives one answer, and returns it.

        Raises:
            TimeoutError: the answer is not complete within `ANSWER_S`.
        """
        until, line = time.monotonic() + ANSWER_S, b""
        while not line.endswith(b"\n") and len(line) < MAX_LINE:
            if (left_s := until - time.monotonic()) <= 0.0:
                raise TimeoutError(f"no answer within {ANSWER_S:g} s")
            line += self._stream.receive(left_s)
        return line


def open_port(answer: Callable[[str], Mapping[str, object]], site: Site) -> int:
    """Opens a TCP port that answers scene requests; returns the number of the port.

    A request to quit stops the site.
    """

    def answered(line: bytes) -> bytes:
        said = _reply(line, answer)
        if "quit" in said:
            site.stopped.set()
        # NaN is no JSON.
        plain = {name: value if value == value else None for name, value in said.items()}
        return json.dumps(plain).encode() + b"\n"

    return site.answer_lines(answered, MAX_LINE)


def _reply(line: bytes, answer: Callable[[str], Mapping[str, object]]) -> Mapping[str, object]:
    try:
        what = strict_json.parse(line)["do"]
    except (ValueError, TypeError, KeyError):
        known = '{"do": "next_part"}, {"do": "truth"} or {"do": "quit"}'
        return {"error": f"not understood; send {known}"}
    return answer(str(what))
