"""The address space of an OPC UA server: objects, variables and methods by their paths below `VisionSystem`.

Node identifiers are the paths, with dots in place of slashes, so that clients can use them without browsing.
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
    """Describes an input or output argument of a method; with `many` it is an array."""
    rank, dimensions = (1, [0]) if many else (-1, [])
    return ua.Argument(name, ua.NodeId(kind.value), rank, dimensions)


class AddressSpace:
    """The nodes of `VisionSystem`, and their values."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._nodes: dict[str, Node] = {}
        self._shown: dict[str, Value] = {}

    async def build(self, values: Iterable[tuple[str, Value]]) -> None:
        """Creates the nodes: the two state machines, and a variable for each value."""
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
        """Writes the values that have changed, and sends clients an event if the state has changed."""
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
        """Adds a method, which asyncua calls with the object's id, then variants."""
        parent = await self._at(_above(path))
        node = await parent.add_method(*self._ids(path), call, [*inputs], [*outputs])
        if _above(path) == AUTOMATIC:  # offered by the outer machine, too
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
        # Like a finite state machine, whose type asyncua cannot instantiate.
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
        """Returns the object at a path ("": the vision system); creates it, of type `kind`, if missing."""
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
