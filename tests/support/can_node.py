"""The simulated gripper as a CANopen node with the two objects that `drivers.robotiq.canopen` uses.

The node aborts a request for any other object, as CiA 301 demands.
"""

from collections.abc import Callable

import canopen
from canopen import objectdictionary

from drivers.robotiq.canopen import HEAR_S, CanMap
from drivers.robotiq.registers import BLOCK_BYTES
from drivers.sim.devices.gripper import GripperModel


class CanNode:
    """Connects the simulated gripper to a CAN bus, as a node.

    Args:
        device: the simulated gripper.
        now: returns simulated seconds.
        where: the bus, the number of the node, and the indices of the objects.
    """

    def __init__(self, device: GripperModel, now: Callable[[], float], where: CanMap) -> None:
        self._device = device
        self._now = now
        self._where = where
        self._network = canopen.Network()
        self._network.NOTIFIER_CYCLE = HEAR_S
        self._node = canopen.LocalNode(where.node, dictionary(where))
        self._node.add_read_callback(self._read)  # type: ignore[no-untyped-call]
        self._node.add_write_callback(self._write)  # type: ignore[no-untyped-call]
        self._network.connect(interface=where.interface, channel=where.channel)
        self._network.add_node(self._node)

    def close(self) -> None:
        """Leaves the bus."""
        self._network.disconnect()

    def _read(self, *, index: int, subindex: int, od: objectdictionary.ODVariable) -> int | None:
        del od
        byte = subindex - 1
        if not 0 <= byte < BLOCK_BYTES:
            return None
        if index == self._where.input:
            return self._device.read_input(self._now())[byte]
        return self._device.read_output()[byte]

    def _write(
        self, *, index: int, subindex: int, od: objectdictionary.ODVariable, data: bytes
    ) -> None:
        del od
        if index == self._where.output:
            self._device.write_output(subindex - 1, data, self._now())


def dictionary(where: CanMap) -> canopen.ObjectDictionary:
    """Returns an object dictionary with the two objects of a map; each byte of them is a subindex."""
    result = canopen.ObjectDictionary()
    for index, name, access in ((where.output, "output", "rw"), (where.input, "input", "ro")):
        record = objectdictionary.ODRecord(name, index)
        for sub in range(1, BLOCK_BYTES + 1):
            variable = objectdictionary.ODVariable(f"byte {sub - 1}", index, sub)
            variable.data_type = objectdictionary.UNSIGNED8
            variable.access_type = access
            record.add_member(variable)
        result.add_object(record)
    return result
