"""The address space of the OPC UA server: objects, variables and methods below the object `VisionSystem`.

Each of these nodes has a path below `VisionSystem`. The node's identifier is this path with dots in place of
slashes, so that clients need not browse for it.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.event_objects import TransitionEvent

from runtime.plc.panel import AUTOMATIC, MACHINE, Change, Value
from runtime.plc.vision import VisionState

NAMESPACE = "http://opcfoundation.org/UA/MachineVision"
SYSTEM = "VisionSystem"
STATE_MACHINE, STATE = ua.NodeId(2299), ua.NodeId(2307)  # types of OPC 10000-5
TYPES: Mapping[type, ua.VariantType] = {
    str: ua.VariantType.String,
    int: ua.VariantType.UInt32,
    float: ua.VariantType.Double,
    bool: ua.VariantType.Boolean,
}
Arguments = tuple[ua.Argument, ...]


def argument(name: str, kind: ua.VariantType, *, many: bool = False) -> ua.Argument:
    """Describes an input or output argument of an OPC UA method.

    Args:
        name: name of the argument.
        kind: type of the value.
        many: whether the argument is an array of such values.
    """
    rank, dimensions = (1, [0]) if many else (-1, [])
    return ua.Argument(name, ua.NodeId(kind.value), rank, dimensions)


class AddressSpace:
    """The OPC UA nodes below `VisionSystem`; `show` updates the values that clients see."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._nodes: dict[str, Node] = {}
        self._shown: dict[str, Value] = {}

    async def build(self, values: Iterable[tuple[str, Value]]) -> None:
        """Creates the two state machines, and a variable for each pair of a path and a value."""
        self._index = await self._server.register_namespace(NAMESPACE)
        for machine in (MACHINE, AUTOMATIC):
            await self._add_machine(machine)
        for path, value in values:
            if path not in self._nodes:
                parent = await self._at(_above(path))
                kind = TYPES[type(value)]
                self._nodes[path] = await parent.add_variable(*self._ids(path), value, kind)
            await self._write(path, value)
        self._transitions = await self._server.get_event_generator(
            TransitionEvent(), emitting_node=self._nodes[MACHINE]
        )

    async def show(self, values: Iterable[tuple[str, Value]], change: Change | None) -> None:
        """Writes the values that have changed, and sends an event to clients.

        Args:
            values: all values, each with its path.
            change: the change of the displayed state, for the event; None: no event.
        """
        for path, value in values:
            if self._shown[path] != value:
                await self._write(path, value)
        if change is None:
            return
        event, name = self._transitions.event, ua.LocalizedText(change.name)
        event.Message = event.Transition = name
        event.FromState = ua.LocalizedText(change.left.value)
        event.ToState = ua.LocalizedText(change.entered.value)
        await self._transitions.trigger()
        for machine in (MACHINE, AUTOMATIC):
            await self._nodes[f"{machine}/LastTransition"].write_value(name)

    async def add_method(
        self, path: str, call: Callable[..., Any], inputs: Arguments, outputs: Arguments
    ) -> None:
        """Adds a method that clients can call.

        Args:
            path: path of the method.
            call: function that asyncua calls with the object's id and the arguments as variants.
            inputs: descriptions of the input arguments.
            outputs: descriptions of the output arguments.
        """
        parent = await self._at(_above(path))
        node = await parent.add_method(*self._ids(path), call, [*inputs], [*outputs])
        if _above(path) == AUTOMATIC:  # the outer state machine offers the method, too
            await self._nodes[MACHINE].add_reference(node, ua.ObjectIds.HasComponent)

    async def _write(self, path: str, value: Value) -> None:
        self._shown[path] = value
        node, machine = self._nodes[path], _above(path)
        if machine not in (MACHINE, AUTOMATIC) or not path.endswith("/CurrentState"):
            await node.write_value(ua.Variant(value, TYPES[type(value)]))
            return
        await node.write_value(ua.LocalizedText(str(value)))
        state = self._nodes.get(f"{machine}/{value}")
        state_id = ua.NodeId() if state is None else state.nodeid
        await (await node.get_child("0:Id")).write_value(state_id, ua.VariantType.NodeId)

    async def _add_machine(self, machine: str) -> None:
        node = await self._at(machine, STATE_MACHINE)
        for name in ("CurrentState", "LastTransition"):
            self._nodes[f"{machine}/{name}"] = await node.get_child(f"0:{name}")
        # As in a FiniteStateMachineType, which asyncua cannot instantiate, the id is a NodeId.
        state_id = await node.get_child(["0:CurrentState", "0:Id"])
        kind = ua.Variant(ua.NodeId(ua.VariantType.NodeId.value), ua.VariantType.NodeId)
        await state_id.write_attribute(ua.AttributeIds.DataType, ua.DataValue(kind))
        outer = machine == MACHINE
        states = [state for state in VisionState if outer or state.automatic]
        names = dict.fromkeys(state.outer if outer else state.value for state in states)
        for number, name in enumerate(names, 1):
            state = await self._at(f"{machine}/{name}", STATE)
            state_number = await state.get_child("0:StateNumber")
            await state_number.write_value(number, ua.VariantType.UInt32)

    async def _at(self, path: str, kind: ua.NodeId | None = None) -> Node:
        """Returns the object at a path; creates a missing object.

        Args:
            path: path of the object; "" is `VisionSystem` itself.
            kind: OPC UA type of a new object; None: the base type.
        """
        if path not in self._nodes:
            parent = await self._at(_above(path)) if path else self._server.nodes.objects
            every = kind is STATE_MACHINE  # its LastTransition is optional
            node = await parent.add_object(*self._ids(path), kind, instantiate_optional=every)
            self._nodes[path] = node
        return self._nodes[path]

    def _ids(self, path: str) -> tuple[ua.NodeId, ua.QualifiedName]:
        names = [SYSTEM, *filter(None, path.split("/"))]
        return ua.NodeId(".".join(names), self._index), ua.QualifiedName(names[-1], self._index)


def _above(path: str) -> str:
    return path.rpartition("/")[0]
