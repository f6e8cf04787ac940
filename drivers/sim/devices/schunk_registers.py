"""The parameters of a simulated SCHUNK gripper on the wire."""

from collections.abc import Callable

from drivers.schunk.registers import PARAMETERS
from drivers.sim.devices.schunk import SchunkModel

_BY_ADDRESS = {parameter.address: parameter for parameter in PARAMETERS.values()}


class SchunkRegisters:
    """The parameters at their wire addresses, for `drivers.sim.wire.modbus.answer`.

    Args:
        device: the gripper.
        now: simulated seconds.
    """

    functions = frozenset({3, 16})  # [CM]: no others are supported

    def __init__(self, device: SchunkModel, now: Callable[[], float]) -> None:
        self._device = device
        self._now = now

    def serves(self, address: int, count: int) -> bool:
        """Whether the registers are those of one whole parameter."""
        parameter = _BY_ADDRESS.get(address)
        return parameter is not None and parameter.registers == count

    def read(self, address: int, count: int) -> bytes:
        """Reads the registers of a parameter."""
        del count
        return self._device.read(_BY_ADDRESS[address].name, self._now())

    def write(self, address: int, data: bytes) -> bool:
        """Writes a parameter; returns whether that is allowed."""
        if not self.serves(address, len(data) // 2):
            return False
        parameter = _BY_ADDRESS[address]
        if parameter.writable:
            self._device.write(parameter.name, data, self._now())
        return parameter.writable
