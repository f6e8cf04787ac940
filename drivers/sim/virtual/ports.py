"""Ports of a cell in one thread: what is written arrives on a virtual clock."""

import errno
import math
from collections.abc import Callable

from drivers.sim.devices.arm import Answer, Controller
from drivers.sim.devices.rapid import RapidError
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.wire.line import Outbox, Piece, UnpluggedError
from drivers.sim.wire.rtu import BYTE_S, RtuSlave
from drivers.stream import port_error

FRAME_GAP_S = 0.002  # silence that ends a frame (Modbus over serial line 1.02, 2.5.1.1: 1.75 ms)
TURNAROUND_S = 0.001  # of the gripper, and of the network to the arm's controller
ACCEPT_S = 0.5  # SERVER.mod waits so long after it has accepted a client
MAX_STRING = 80  # SocketReceive \\Str takes so much at once


class GripperPort:
    """A serial port with the gripper behind it, as `drivers.stream.Stream`.

    Args:
        slave: the gripper's end.
        clock: the cell's.
    """

    endpoint = "virtual gripper"

    def __init__(self, slave: RtuSlave, clock: VirtualClock) -> None:
        self._slave = slave
        self._clock = clock
        self._outbox = Outbox()
        self._sent_s = 0.0
        self._gone: OSError | None = None

    def open(self) -> "GripperPort":
        """The port, if it can be opened.

        Raises:
            PortError: it was unplugged, or may not be opened any more.
        """
        if isinstance(self._gone, UnpluggedError):
            raise port_error(
                self.endpoint, OSError(errno.EACCES if self._gone.forbidden else errno.ENOENT, "")
            )
        self._gone = None
        return self

    def send(self, data: bytes) -> None:
        """Put a frame on the line; time passes while it crosses."""
        self._check()
        if self._clock.now() - self._sent_s > FRAME_GAP_S:
            self._slave.silence()
        self._clock.sleep(len(data) * BYTE_S)
        self._sent_s = self._clock.now()
        try:
            pieces = self._slave.feed(data)
        except UnpluggedError as error:
            self._gone = error
            raise
        self._outbox.put(pieces, self._sent_s + TURNAROUND_S, BYTE_S)

    def receive(self, seconds: float) -> bytes:
        """What has come by then."""
        self._check()
        return _receive(self._outbox, self._clock, seconds)

    def close(self) -> None:
        """Give the port up."""
        self._gone = self._gone or OSError("the port was closed")

    def _check(self) -> None:
        if self._gone is not None:
            raise self._gone


class ArmPort:
    """The arm controller's network port; `connect` gives a connection to it.

    Args:
        controller: what executes instructions.
        clock: the cell's.
        stands: called when an instruction is over.
        overheard: told of each string received.
    """

    def __init__(
        self,
        controller: Controller,
        clock: VirtualClock,
        stands: Callable[[], None],
        overheard: Callable[[str], None] | None = None,
    ) -> None:
        self._controller = controller
        self._clock = clock
        self._stands = stands
        self._overheard = overheard
        self._free_s = 0.0
        self._stale = ""

    def connect(self) -> "ArmConnection":
        """A connection, greeted with the acknowledgement that its predecessor did not stay for."""
        made = ArmConnection(self, self._clock)
        self._free_s = max(self._free_s, self._clock.now()) + ACCEPT_S
        made.arrives(self._stale, self._free_s)
        self._stale = ""
        return made

    def execute(self, text: str, connection: "ArmConnection") -> None:
        """One received string: what it comes to happens later, in its time."""
        if self._overheard is not None:
            self._overheard(text)
        start_s = max(self._clock.now() + TURNAROUND_S, self._free_s)
        try:
            answer = self._controller.execute(text, start_s)
        except RapidError:
            connection.hang_up()
            return
        if math.isinf(answer.ready_s):
            return
        self._free_s = answer.ready_s
        if answer.broken or answer.closing:
            connection.hang_up()
        connection.arrives(answer.before, start_s)
        self._clock.at(answer.ready_s, lambda: self._over(answer, connection))

    def _over(self, answer: Answer, connection: "ArmConnection") -> None:
        self._stands()
        if answer.text is not None and not connection.arrives(answer.text, self._clock.now()):
            self._stale = answer.text


class ArmConnection:
    """One client's connection, as `drivers.stream.Stream`.

    Args:
        port: the controller's.
        clock: the cell's.
    """

    endpoint = "virtual arm"

    def __init__(self, port: ArmPort, clock: VirtualClock) -> None:
        self._port = port
        self._clock = clock
        self._outbox = Outbox()
        self._open = True

    def send(self, data: bytes) -> None:
        """Send in one piece."""
        self._check()
        for start in range(0, len(data), MAX_STRING):
            self._port.execute(data[start : start + MAX_STRING].decode("latin-1"), self)

    def receive(self, seconds: float) -> bytes:
        """What has come by then."""
        if data := self._outbox.due(self._clock.now()):
            return data
        self._check()
        return _receive(self._outbox, self._clock, seconds)

    def close(self) -> None:
        """Hang up."""
        self._open = False

    def hang_up(self) -> None:
        """The controller hangs up."""
        self._open = False

    def arrives(self, text: str, moment: float) -> bool:
        """Have a text arrive; False: nobody is there to take it."""
        if self._open and text:
            self._outbox.put([Piece(text.encode("latin-1"))], moment + TURNAROUND_S)
        return self._open

    def _check(self) -> None:
        if not self._open:
            raise ConnectionResetError("closed by the arm")


def _receive(outbox: Outbox, clock: VirtualClock, seconds: float) -> bytes:
    """Wait for what is on its way, at most so long; what happens meanwhile may send more."""
    until = clock.now() + max(seconds, 0.0)
    while not (data := outbox.due(clock.now())) and clock.now() < until:
        arrives_s = until if outbox.next_s is None else outbox.next_s
        clock.advance(min(arrives_s, clock.next_s, until))
    return data
