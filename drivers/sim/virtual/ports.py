"""Ports of a cell in one thread: data arrives on a virtual clock."""

import errno
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.sim.devices.arm import ACCEPT_S, MAX_STRING, Answer, ArmModel
from drivers.sim.devices.rapid import RapidError
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.wire.line import BYTE_S, Outbox, UnpluggedError
from drivers.sim.wire.rtu import RtuSlave
from drivers.stream import port_error

FRAME_GAP_S = 0.002  # silence that ends a frame (Modbus over serial line 1.02, 2.5.1.1: 1.75 ms)
TURNAROUND_S = 0.001  # response time of the gripper, and of the network to the arm's controller


class VirtualPort:
    """A port in memory, a `drivers.stream.Stream` whose data arrives in virtual time.

    Args:
        endpoint: name of the port in messages.
        clock: clock of the cell.
    """

    def __init__(self, endpoint: str, clock: VirtualClock) -> None:
        self.endpoint = endpoint
        self._clock = clock
        self._arrived = b""
        self._gone: OSError | None = None

    def receive(self, seconds: float) -> bytes:
        """Advances time by at most `seconds` until data arrives; returns the data, empty if none arrived."""
        until = self._clock.now() + max(seconds, 0.0)
        while not self._arrived:
            self._check()
            if self._clock.now() >= until:
                break
            self._clock.advance(min(self._clock.next_s, until))
        data, self._arrived = self._arrived, b""
        return data

    def close(self) -> None:
        """Closes the port."""
        self._gone = self._gone or OSError("the port was closed")

    def _arrive(self, data: bytes) -> None:
        self._arrived += data

    def _check(self) -> None:
        if self._gone is not None:
            raise self._gone


class GripperPort(VirtualPort):
    """A serial port with the gripper behind it."""

    def __init__(self, slave: RtuSlave, clock: VirtualClock) -> None:
        super().__init__("virtual gripper", clock)
        self._slave = slave
        self._outbox = Outbox(BYTE_S, clock.at, self._arrive)
        self._sent_s = 0.0

    def open(self) -> "GripperPort":
        """Opens the port, also after a `close`, and returns it.

        Raises:
            PortError: the port is unplugged, or may not be opened any more.
        """
        if isinstance(self._gone, UnpluggedError):
            raise port_error(
                self.endpoint, OSError(errno.EACCES if self._gone.forbidden else errno.ENOENT, "")
            )
        self._gone = None
        return self

    def send(self, data: bytes) -> None:
        """Sends data on the line; time advances while the bytes cross it."""
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
        self._outbox.put(pieces, self._sent_s + TURNAROUND_S)


@dataclass
class ArmPort:
    """Network port of the arm controller in virtual time; accepts clients and executes their strings."""

    controller: ArmModel  # executes instructions
    clock: VirtualClock
    stands: Callable[[], None]  # called when an instruction is over
    overheard: Callable[[str], None] | None = None  # receives each string
    free_s: float = 0.0  # time from which on the controller can execute the next string
    stale: str = ""  # acknowledgement that the next client receives

    def connect(self) -> "ArmConnection":
        """Connects a client, which first receives an acknowledgement left over from its predecessor."""
        connection = ArmConnection(self, self.clock)
        self.free_s = max(self.free_s, self.clock.now()) + ACCEPT_S
        connection.arrives(self.stale, self.free_s)
        self.stale = ""
        return connection

    def execute(self, text: str, connection: "ArmConnection") -> None:
        """Executes one received string; sends the acknowledgement when the instruction is over."""
        if self.overheard is not None:
            self.overheard(text)
        start_s = max(self.clock.now() + TURNAROUND_S, self.free_s)
        try:
            answer = self.controller.execute(text, start_s)
        except RapidError:
            connection.hang_up()
            return
        if math.isinf(answer.ready_s):
            return
        self.free_s = answer.ready_s
        if answer.broken or answer.text is None:
            connection.hang_up()
        connection.arrives(answer.before, start_s)
        self.clock.at(answer.ready_s, lambda: self._over(answer, connection))

    def _over(self, answer: Answer, connection: "ArmConnection") -> None:
        self.stands()
        if answer.text is not None and not connection.arrives(answer.text, self.clock.now()):
            self.stale = answer.text


class ArmConnection(VirtualPort):
    """One client's connection to the arm."""

    def __init__(self, port: ArmPort, clock: VirtualClock) -> None:
        super().__init__("virtual arm", clock)
        self._port = port

    def send(self, data: bytes) -> None:
        """Sends data in one piece."""
        self._check()
        for start in range(0, len(data), MAX_STRING):
            self._port.execute(data[start : start + MAX_STRING].decode("latin-1"), self)

    def hang_up(self) -> None:
        """Closes the connection on behalf of the controller."""
        self._gone = ConnectionResetError("closed by the arm")

    def arrives(self, text: str, moment: float) -> bool:
        """Schedules the delivery of a text for a moment; returns False if the connection is closed."""
        if self._gone is None and text:
            self._clock.at(moment + TURNAROUND_S, partial(self._arrive, text.encode("latin-1")))
        return self._gone is None
