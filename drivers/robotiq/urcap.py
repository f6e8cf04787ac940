"""The gripper's register blocks through Robotiq's URCap: lines of text on TCP port 63352 of a UR controller.

`GET POS` is answered by `POS 147`, `SET SPE 255 POS 0 GTO 1` by `ack`. The names are those of the registers.
ACT, GTO, POS, SPE and FOR are written. ACT, GTO, STA, OBJ, FLT, PRE (echo of POS) and POS (encoder) are read;
there is no motor current. Whether a line end follows an answer is not documented, so both are understood.

Answers have no sequence number. So the link resynchronises after a missing answer: it asks for one of
`FENCES`, for which it asks at no other time, and discards all answers before that one.
"""

import re
from functools import partial

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, shown
from drivers.links import StreamLink
from drivers.ports import GripperProfile, Report, no_report
from drivers.robotiq.counts import Counts
from drivers.robotiq.gripper import Gripper
from drivers.robotiq.registers import INPUT_FIELDS, OUTPUT_FIELDS, pack, unpack
from drivers.stream import Stream, open_tcp, tcp_address

PORT = 63352
# Position last: a flag read before it is never newer than the count.
READ = {
    "ACT": "gACT",
    "GTO": "gGTO",
    "STA": "gSTA",
    "FLT": "gFLT",
    "PRE": "gPR",
    "OBJ": "gOBJ",
    "POS": "gPO",
}
# Number of digits with which an answer is complete without a line end or a pause, by name; `MOST_DIGITS` for
# names that are not listed.
DIGITS = dict.fromkeys(("ACT", "GTO", "STA", "OBJ"), 1)
MOST_DIGITS = 3
FENCES = ("SPE", "FOR")  # used only to resynchronise
QUIET_S = 0.003  # wall: silence after which an answer without a line end is complete
ANSWER = re.compile(rb"([A-Z]{3}) +(\d{1,3})(?!\d)(\s?)")
MOST_BYTES = 600  # greatest length of received text that is kept for parsing
HINT = "check that the Robotiq URCap is installed, its gripper enabled, and port 63352 not blocked"


class UrcapLink(StreamLink):
    """Reads and writes a gripper's two register blocks through the URCap; owns the connection."""

    def __init__(self, stream: Stream, pace: Pace, report: Report = no_report) -> None:
        super().__init__(stream, pace, report)
        self._text = b""
        self._active = 0  # ACT as last read
        # Names to resynchronise with, to which no answer is pending; empty: synchronised.
        self._fences: list[str] = []

    def read(self) -> bytes:
        """Reads the input block, 6 bytes; up to 3 attempts a variable, since reading changes nothing."""
        seen = {field: self._repeated(partial(self._get, name)) for name, field in READ.items()}
        self._active = seen["gACT"]
        # The URCap reports the whole fault byte; its low nibble is the gripper's.
        return pack(INPUT_FIELDS, {**seen, "gFLT": seen["gFLT"] & 0x0F})

    def write(self, block: bytes) -> None:
        """Writes the output block, once, in one line; GTO 1, which starts a motion, comes last.

        ACT is sent only if rGTO is 0 and ACT differs from the value last read: otherwise a gripper that lost
        power meanwhile would start its activation sweep.
        """
        image = unpack(OUTPUT_FIELDS, block)
        if image["rGTO"]:
            words = f"SPE {image['rSP']} FOR {image['rFR']} POS {image['rPR']} GTO 1"
        elif image["rACT"] == self._active:
            words = "GTO 0"
        else:
            words = f"GTO 0 ACT {image['rACT']}"
        self._transact(f"SET {words}", "ack")

    def _get(self, name: str) -> int:
        value = self._transact(f"GET {name}", name)
        self._check_in_time()
        if value > 255:
            raise LinkError(
                f"gripper at {self.endpoint} answered {name} {value}, which is no register value"
            )
        return value

    def _transact(self, line: str, wanted: str) -> int:
        """Sends a line and returns the number in its answer, 0 for an acknowledgement."""
        self._begin()
        try:
            self._find_step()
            self._fences = [*FENCES]  # cleared only if this request is answered
            value = self._exchange(line, wanted)
        except OSError as error:
            if isinstance(error, LinkError):
                raise
            raise self._broken(error, "the controller and its cable") from error
        self._fences = []
        return value

    def _find_step(self) -> None:
        """Resynchronises: asks for one of `FENCES`, and discards everything before the answer."""
        if not self._fences:
            return
        if self._fences == ["lost"]:
            self._lost = "the URCap fell silent, and its answers can no longer be told apart"
            self._begin()
        fence, self._fences = self._fences[0], self._fences[1:] or ["lost"]
        self._exchange(f"GET {fence}", fence, stale=True)

    def _exchange(self, line: str, wanted: str, *, stale: bool = False) -> int:
        self._text = b""
        self._drain()
        self._stream.send(line.encode("ascii") + b"\n")
        for piece in self._pieces():
            self._text = (self._text + piece)[-MOST_BYTES:]
            value = self._answer(line, wanted, stale=stale)
            if value is not None:
                return value
        self._tell("no answer", line=line)
        raise LinkTimeout(
            f"gripper at {self.endpoint} did not answer {line!r} within {LINK_TIMEOUT_S} s; {HINT}"
        )

    def _answer(self, line: str, wanted: str, *, stale: bool) -> int | None:
        """The number in the answer `wanted`, 0 for "ack"; None if that answer is not complete yet.

        Args:
            line: the request, for messages.
            wanted: name of the expected answer.
            stale: whether other answers are dropped.

        Raises:
            LinkError: another answer came, and `stale` is false.
        """
        while self._text.strip():
            text = self._text.lstrip()
            if text.startswith(b"ack"):
                name, value, size = "ack", 0, 3
            elif matches := ANSWER.match(text):
                name, value, size = matches[1].decode(), int(matches[2]), matches.end()
                whole = matches[3] or len(matches[2]) >= DIGITS.get(name, MOST_DIGITS)
                if not whole and len(text) == size and (more := self._stream.receive(QUIET_S)):
                    self._text += more
                    continue
            elif b"ack".startswith(text) or re.fullmatch(rb"[A-Z]{1,3} *", text):
                return None
            else:
                name, value, size = "", 0, len(text)
            self._text = text[size:]
            if name == wanted:
                return value
            if not stale:
                raise LinkError(
                    f"gripper at {self.endpoint} answered {line!r} by '{shown(text)}'; "
                    "check that it is Robotiq's URCap, and the only one for this gripper"
                )
        return None


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """Opens a Robotiq gripper at `urcap://host`; raises the errors of `drivers.robotiq.modbus.gripper`."""
    Counts(profile)  # before anything is opened
    link = UrcapLink(open_tcp(*tcp_address(port, PORT), port, HINT), pace, report)
    return Gripper(link, pace, report, profile, read_only=read_only)
