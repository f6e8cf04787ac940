"""Modbus transports of the gripper over pymodbus: RTU on a serial port, RTU over TCP, Modbus TCP.

One transaction is tried once here; `read` may be repeated, a write never is (the device logic reads the
state first).
"""

import contextlib
import errno
import fcntl
import logging
import os
import stat
from typing import NamedTuple

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import ModbusPDU

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.robotiq.registers import BLOCK_REGISTERS, to_bytes, to_registers

GAP_S = 0.005  # manuals ask for 5 ms between commands: the gripper refreshes at 200 Hz ([M16] p55)
LATE_S = 0.02  # wall; how long a late answer is waited for before the line counts as quiet
READ_TRIES = 3  # as the SDK: the link is down after 3 failures in a row
BAUD = 115200


class Wiring(NamedTuple):
    """Where the register blocks are on one kind of link, and with which function they are read."""

    unit: int
    output_address: int
    input_address: int
    read_function: int


RTU = Wiring(unit=9, output_address=0x03E8, input_address=0x07D0, read_function=3)  # [M16] p55
TCP = Wiring(unit=2, output_address=0, input_address=0, read_function=4)  # [M200] p66-78


class ModbusLink:
    """A gripper's two register blocks on one Modbus connection.

    Args:
        client: a connected pymodbus client with `retries=0`.
        wiring: addresses and functions of this kind of link.
        endpoint: the port as the user named it, for messages.
        pace: clock of the gap between transactions.
    """

    def __init__(
        self, client: ModbusSerialClient | ModbusTcpClient, wiring: Wiring, endpoint: str, pace: Pace
    ) -> None:
        self.endpoint = endpoint
        self.transactions = 0
        self.retries = 0
        self._client = client
        self._wiring = wiring
        self._pace = pace
        self._free_at = pace.now()
        self._lost = ""
        self._out_of_step = False

    def read(self) -> bytes:
        """The input block, 6 bytes; tried up to 3 times, since reading changes nothing.

        Raises:
            LinkTimeout: no valid answer to any try.
            LinkError: the connection is gone, or the device refuses the request.
        """
        for _ in range(READ_TRIES - 1):
            try:
                return self._read_once()
            except LinkTimeout:
                self.retries += 1
        return self._read_once()

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, once.

        Raises:
            LinkTimeout: no valid answer; whether the write arrived is unknown: read the state before
            repeating it. LinkError: the connection is gone, or the device refuses the request.
        """
        wiring = self._wiring
        self._pause()
        try:
            reply = self._client.write_registers(
                wiring.output_address, list(to_registers(block)), device_id=wiring.unit
            )
        except ModbusException as error:
            raise self._failure(error) from error
        self._check(reply, function=16)

    def close(self) -> None:
        """Close the connection; moves nothing (over Modbus TCP the device then stops itself, [M200] p66)."""
        self._client.close()  # type: ignore[no-untyped-call]
        self._lost = "it was closed"

    def _read_once(self) -> bytes:
        wiring = self._wiring
        self._pause()
        read = self._client.read_holding_registers
        if wiring.read_function == 4:
            read = self._client.read_input_registers
        try:
            reply = read(wiring.input_address, count=BLOCK_REGISTERS, device_id=wiring.unit)
        except ModbusException as error:
            raise self._failure(error) from error
        self._check(reply, wiring.read_function)
        if len(reply.registers) != BLOCK_REGISTERS:
            raise LinkTimeout(
                f"gripper at {self.endpoint} sent {len(reply.registers)} registers, not {BLOCK_REGISTERS}; "
                "check that no other device has its slave id",
                self.endpoint,
            )
        return to_bytes(tuple(reply.registers))

    def _pause(self) -> None:
        # pymodbus would silently reopen a lost port, perhaps onto another device.
        if self._lost:
            raise LinkError(f"gripper link {self.endpoint} is closed: {self._lost}", self.endpoint)
        wait = self._free_at - self._pace.now()
        if wait > 0.0:
            self._pace.clock.sleep(wait)
        if self._out_of_step:
            self._drain()
        self._out_of_step = True  # until this transaction is answered, or after an interrupt
        self.transactions += 1

    def _drain(self) -> None:
        """Throw away a late answer before it is taken for the next one."""
        self._pace.clock.sleep(LATE_S)
        with contextlib.suppress(OSError):
            if isinstance(self._client, ModbusSerialClient):
                if self._client.socket is not None:
                    self._client.socket.reset_input_buffer()
            elif self._client.socket is not None:
                self._client.socket.setblocking(False)
                while self._client.socket.recv(4096):
                    pass

    def _check(self, reply: ModbusPDU, function: int) -> None:
        self._free_at = self._pace.now() + GAP_S / self._pace.time_scale
        if reply.function_code & 0x7F != function:
            raise LinkTimeout(
                f"gripper at {self.endpoint} answered function {reply.function_code} to {function}: "
                "an answer was late; check the wiring",
                self.endpoint,
            )
        self._out_of_step = False
        if reply.isError():
            raise LinkError(
                f"gripper at {self.endpoint} refused function {reply.function_code & 0x7F} (exception "
                f"{getattr(reply, 'exception_code', 0)}); check that the device is a Robotiq 2F gripper",
                self.endpoint,
            )

    def _failure(self, error: ModbusException) -> LinkError:
        self._free_at = self._pace.now() + GAP_S / self._pace.time_scale
        if isinstance(error, ConnectionException) or not self._client.connected:
            self._lost = "the connection broke"
            self._client.close()  # type: ignore[no-untyped-call]
            return LinkError(
                f"gripper link {self.endpoint} broke; check cable, adapter and power", self.endpoint
            )
        return LinkTimeout(
            f"gripper at {self.endpoint} did not answer within {LINK_TIMEOUT_S} s; check its power, "
            f"slave id {self._wiring.unit} and wiring",
            self.endpoint,
        )


def open_serial(path: str, pace: Pace) -> ModbusLink:
    """Open a tty as Modbus RTU, 115200 8N1, slave 9.

    Raises:
        PortError: no such device, no permission, not a serial port, or in use.
    """
    _quiet_library()
    _probe_tty(path)
    client = ModbusSerialClient(
        path, framer=FramerType.RTU, baudrate=BAUD, timeout=LINK_TIMEOUT_S, retries=0, name="gripper"
    )
    if not client.connect():
        raise PortError(f"port {path} cannot be opened as a serial port; check that it is one", path)
    return ModbusLink(client, RTU, path, pace)


def open_tcp(host: str, port: int, pace: Pace, *, rtu: bool) -> ModbusLink:
    """Open a TCP connection that carries RTU frames (`rtu`) or Modbus TCP.

    Raises:
        PortError: nobody accepts the connection.
    """
    _quiet_library()
    endpoint = f"{'rtu+tcp' if rtu else 'tcp'}://{host}:{port}"
    framer = FramerType.RTU if rtu else FramerType.SOCKET
    client = ModbusTcpClient(
        host, framer=framer, port=port, timeout=LINK_TIMEOUT_S, retries=0, name="gripper"
    )
    if not client.connect():  # type: ignore[no-untyped-call]
        raise PortError(
            f"nobody accepts a connection at {endpoint}; check address, cable and power", endpoint
        )
    return ModbusLink(client, RTU if rtu else TCP, endpoint, pace)


def _quiet_library() -> None:
    # Every failure pymodbus logs reaches the caller as an exception of ours.
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)


def _probe_tty(path: str) -> None:
    """Find out why a port cannot be opened, which pymodbus does not tell."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except FileNotFoundError as error:
        raise PortError(
            f"port {path} does not exist; list ports with `ls /dev/serial/by-id`, or use --port sim", path
        ) from error
    except PermissionError as error:
        raise PortError(
            f"no permission to open port {path}; add this user to its group (often dialout) and log in again",
            path,
        ) from error
    except OSError as error:
        reason = (
            "is in use by another program"
            if error.errno == errno.EBUSY
            else f"cannot be opened ({error.strerror})"
        )
        raise PortError(f"port {path} {reason}; close what uses it, or name another", path) from error
    try:
        if not stat.S_ISCHR(os.fstat(descriptor).st_mode):
            raise PortError(f"{path} is not a serial port; name a device such as /dev/ttyUSB0", path)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise PortError(f"port {path} is in use by another program; stop that program first", path) from error
    finally:
        os.close(descriptor)
