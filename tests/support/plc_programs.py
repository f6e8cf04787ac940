"""A PLC's side of the handshake for tests: registers by name, in memory or over Modbus TCP."""

import ctypes
import socket
import time
from collections.abc import Callable, Sequence
from ctypes.util import find_library
from pathlib import Path

from programs import ROOT, WAIT_S, Closing, until
from pymodbus.client import ModbusTcpClient
from served import ServedRun
from structured_text import FunctionBlock

from runtime.plc.handshake import Error
from runtime.plc.registers import MAP, READ, READ_AT, WRITTEN_AT, Register, as_json
from runtime.plc.station import Answer, Refusal, Station

NAMED = {register.name: register for register in MAP}
SOURCE = ROOT / "tools" / "docs" / "clients" / "plc.st"
INPUTS = {
    "acknowledge": "is_acknowledged",
    "busy": "is_busy",
    "result_valid": "is_valid",
    "result_id": "valid_id",
    "outcome": "read_outcome",
    "error_id": "error",
    "x": "read_x",
    "y": "read_y",
    "angle": "read_angle",
}
FLAGS = {"acknowledge", "busy", "result_valid"}
OUTPUTS = ("enable", "trigger", "trigger_id", "result_acknowledge", "heartbeat")


def free_port() -> int:
    """A TCP port of this machine that nothing listens at."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


def integer(register: Register, words: Sequence[int]) -> int:
    """Returns the value of a register from its words, of which the high word comes first.

    A signed value is in two's complement.
    """
    value = int("".join(f"{word:016b}" for word in words), 2)
    return value - 2**32 if register.type == "int32" and value >= 2**31 else value


class MemoryPlc:
    """Reads and writes the registers of a station in memory, by name, at the time `now`.

    No runtime locates the parts: a test ends the part under way by `end_part`.
    """

    def __init__(self, digests: Sequence[int] = (0x12345678,)) -> None:
        self.station = Station(digests)
        self.now = 100.0

    def write(self, **values: int) -> None:
        """Writes registers, each by one exchange."""
        for name, value in values.items():
            assert self.station.write(NAMED[name].address, [value], self.now) is None

    def __getitem__(self, name: str) -> int:
        register = NAMED[name]
        words = self.station.read(register.address, register.words, self.now)
        assert not isinstance(words, Refusal)
        return integer(register, words)

    def __call__(self, *names: str) -> list[int]:
        """The values of several registers."""
        return [self[name] for name in names]

    def pulse(self, name: str) -> None:
        """Raises and drops a signal."""
        self.write(**{name: 1})
        self.write(**{name: 0})

    def end_part(self, **fields: int) -> None:
        """Ends the part under way with these fields of its result."""
        self.station.finish(Answer(**{"outcome": 1, **fields}))


class TcpPlc(Closing):
    """Reads and writes registers by name over Modbus TCP, with the client of pymodbus."""

    def __init__(self, port: int, unit: int = 1) -> None:
        self.map = {entry["name"]: entry for entry in as_json()["registers"]}
        self.unit = unit
        self._beat = 0
        self.client = ModbusTcpClient("127.0.0.1", port=port, timeout=WAIT_S, retries=0)
        until(self.client.connect, port)

    def write(self, **values: int) -> None:
        for name, value in values.items():
            assert self.code(name, value) == 0, name

    def code(self, name: str, value: int) -> int:
        """Writes a register; returns the exception code of Modbus, 0 if the value was accepted."""
        answer = self.client.write_register(self.map[name]["address"], value, device_id=self.unit)
        return answer.exception_code if answer.isError() else 0

    def __getitem__(self, name: str) -> int:
        register = NAMED[name]
        read = {
            "holding": self.client.read_holding_registers,
            "input": self.client.read_input_registers,
        }[register.kind]
        answer = read(register.address, count=register.words, device_id=self.unit)
        assert not answer.isError()
        return integer(register, answer.registers)

    def beat(self) -> None:
        """Sends one heartbeat."""
        self._beat = 1 - self._beat
        self.write(heartbeat_in=self._beat)

    def wait(self, name: str, value: int) -> None:
        """Waits until a register has a value; sends heartbeats meanwhile."""
        self.wait_for(lambda: self[name] == value, name)

    def wait_for(self, holds: Callable[[], bool], what: str) -> None:
        """Waits until a condition holds; sends heartbeats meanwhile."""

        def beaten() -> bool:
            self.beat()
            return holds()

        until(beaten, what, 0.002)

    def enable(self) -> None:
        self.beat()
        self.write(enable=0)
        self.write(enable=1)

    def begin(self, trigger_id: int) -> None:
        """Triggers a part, and drops the trigger once the runtime has acknowledged it.

        If the runtime refuses because heartbeats were late on a busy machine, enables and triggers again.
        """
        self.write(trigger_id=trigger_id, trigger=1)
        while not (self["acknowledge"] or self["busy"] or self["result_valid"]):
            assert self["error_id"] in (Error.NOT_ENABLED, Error.HEARTBEAT)
            self.write(trigger=0)
            self.enable()
            self.write(trigger=1)
        self.write(trigger=0)

    def result(self, trigger_id: int) -> dict[str, int]:
        """Waits for the result with this id, and ends the handshake; returns the result's fields by name."""
        self.wait("result_valid", 1)
        assert self["result_id"] == trigger_id
        names = ("outcome", "x", "y", "angle", "exit_code", "error_id")
        values = {name: self[name] for name in names}
        self.write(result_acknowledge=1)
        self.wait("result_valid", 0)
        self.write(result_acknowledge=0)
        self.wait("result_id", 0)
        return values

    def part(self, trigger_id: int) -> dict[str, int]:
        """Triggers a part and returns its result."""
        self.begin(trigger_id)
        return self.result(trigger_id)

    def close(self) -> None:
        self.client.close()


class LibmodbusPlc(TcpPlc):
    """Reads and writes registers by name over Modbus TCP, with libmodbus, which must be installed."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.client.close()
        self._library = ctypes.CDLL(find_library("modbus"))
        self._library.modbus_new_tcp.restype = ctypes.c_void_p
        self._context = ctypes.c_void_p(self._library.modbus_new_tcp(b"127.0.0.1", port))
        self._library.modbus_set_response_timeout(self._context, int(WAIT_S), 0)
        assert self._library.modbus_connect(self._context) == 0

    def code(self, name: str, value: int) -> int:
        written = self._library.modbus_write_register(self._context, NAMED[name].address, value)
        return int(written != 1)

    def __getitem__(self, name: str) -> int:
        register, words = NAMED[name], (ctypes.c_uint16 * 2)()
        read = {
            "holding": self._library.modbus_read_registers,
            "input": self._library.modbus_read_input_registers,
        }[register.kind]
        assert read(self._context, register.address, register.words, words) == register.words
        return integer(register, words[: register.words])

    def close(self) -> None:
        self._library.modbus_close(self._context)
        self._library.modbus_free(self._context)


class StructuredPlc:
    """Executes the client tools/docs/clients/plc.st; a cycle reads and writes once, by way of a `TcpPlc`."""

    def __init__(self, plc: TcpPlc) -> None:
        self._client, self._block = plc.client, FunctionBlock(SOURCE.read_text())
        self._count = READ[-1].address + READ[-1].words - READ_AT

    def cycle(self, *, start: bool, number: int) -> dict[str, object]:
        words = self._client.read_input_registers(READ_AT, count=self._count).registers
        values: dict[str, object] = {}
        for register in READ:
            if register.name in INPUTS:
                first = register.address - READ_AT
                value = integer(register, words[first : first + register.words])
                values[INPUTS[register.name]] = bool(value) if register.name in FLAGS else value
        result = self._block(start=start, id=number, **values)
        image = [*(int(result[name]) for name in OUTPUTS), 0]
        answer = self._client.write_registers(WRITTEN_AT, image)
        assert not answer.isError()
        time.sleep(0.003)  # the cycle time of a PLC
        return result

    def part(self, number: int) -> dict[str, int]:
        result = self.cycle(start=True, number=number)
        while not result["done"]:
            result = self.cycle(start=bool(result["refused"]), number=number)
        return {name: result[name] for name in ("outcome", "x", "y", "angle")}


def by_pymodbus(port: int, parts: int) -> list[dict[str, int]]:
    """Locates the parts 1 to `parts` with the client of pymodbus; returns their results."""
    return _by_client(TcpPlc(port, unit=17), parts)


def by_libmodbus(port: int, parts: int) -> list[dict[str, int]]:
    """Locates the parts 1 to `parts` with libmodbus; returns their results."""
    return _by_client(LibmodbusPlc(port), parts)


def _by_client(client: TcpPlc, parts: int) -> list[dict[str, int]]:
    with client as plc:
        plc.enable()
        return [plc.part(number) for number in range(1, parts + 1)]


def in_structured_text(port: int, parts: int) -> list[dict[str, int]]:
    """Locates the parts 1 to `parts` with tools/docs/clients/plc.st; returns their results."""
    with TcpPlc(port, unit=17) as plc:
        program = StructuredPlc(plc)
        return [program.part(number) for number in range(1, parts + 1)]


class PlcServed(ServedRun):
    """A process of `grasp-runtime --plc`, which listens at the TCP port `port`."""

    def __init__(
        self,
        *trees: Path,
        more: Sequence[str] = (),
        count: int | None = None,
        plc: str = "modbus-tcp://127.0.0.1:0",
    ) -> None:
        words = ["--plc", plc, "--port", "sim", *more]
        words += [word for tree in trees for word in ("--tree", str(tree))]
        words += [] if count is None else ["--count", str(count)]
        super().__init__(trees[0].parent, "a PLC may connect at", *words)

    def plc(self, unit: int = 1) -> TcpPlc:
        return TcpPlc(self.port, unit)

    def until_squeezing(self, part: int) -> None:
        """Waits until the journal says that the hand has reached this part."""
        placed = f'"kind":"placed","part":{part},'
        until(lambda: placed in self.journal.read_text(), placed)
