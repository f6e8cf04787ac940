"""Link to a Robotiq gripper over CANopen: the register blocks are two objects, transferred byte by byte.

UNVERIFIED. Robotiq publishes no object dictionary, PDO map or bitrate for a 2F gripper. The map here is
inferred from the only public client for a gripper of the same family, the 3-Finger (ros-industrial/robotiq,
`robotiq_3f_gripper_can_client.cpp`): node 11, object 0x2200 takes the output bytes and 0x2000 gives the input
bytes, sub-index = byte + 1, expedited SDOs, no PDOs. Every number of this map is a setting of the port:

    can:can0?node=11&output=0x2200&input=0x2000&bitrate=500000&interface=socketcan

Needs the extra `can` (python-can, canopen).
"""

import contextlib
import logging
import struct
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import parse_qsl

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, PortError, shown
from drivers.links import ReportingLink
from drivers.ports import GripperProfile, Report, no_report
from drivers.robotiq.gripper import Gripper
from drivers.robotiq.registers import BLOCK_BYTES

if TYPE_CHECKING:
    import canopen

HEAR_S = 0.1  # longest sleep of the listening thread; closing waits for it
ACTION, GOES = 0, 0x08  # byte 0 of the output block, and its bit rGTO
# Speed and force are written before their position; what starts a motion comes last.
WRITE_ORDER = (5, 4, 2, 1, 3, ACTION)
STOP_ORDER = (ACTION, 5, 4, 2, 1, 3)

# SDO command specifiers of requests: a write of one byte, as the known client sends it, and a read as CiA 301
# defines it; the known client reads with 0x4F, which is no request of CiA 301. A read is answered with 0x4F
# or the like, with the data in byte 4; `ANSWER_MASK` selects the bits that must equal the bits of `ANSWERS`.
# canopen's `download` is not used: it repeats a failed write when its buffer is garbage-collected.
WRITE_ONE, READ = 0x2F, 0x40
ANSWER_MASK = 0xE2
ANSWERS = {WRITE_ONE: 0x60, READ: 0x42}


class CanMap(NamedTuple):
    """Bus, node and objects of the register blocks; the module's docstring explains the defaults."""

    channel: str
    interface: str = "socketcan"
    bitrate: int = 0  # 0: as set by the operating system
    node: int = 11
    output: int = 0x2200
    input: int = 0x2000


class CanLink(ReportingLink):
    """Reads and writes a gripper's two register blocks on a CANopen node.

    Only bytes that change are written, since the device copes badly with many writes; the public client for
    the 3-Finger gripper does the same. The link owns the connected network, and disconnects it.
    """

    def __init__(
        self, network: "canopen.Network", where: CanMap, endpoint: str, report: Report = no_report
    ) -> None:
        import canopen

        super().__init__(endpoint, report)
        self._network = network
        self._where = where
        self._written: list[int | None] = [None] * BLOCK_BYTES
        no_objects = canopen.ObjectDictionary()  # type: ignore[no-untyped-call]
        node = canopen.RemoteNode(where.node, no_objects)
        network.add_node(node)
        self._sdo = node.sdo
        self._sdo.RESPONSE_TIMEOUT = LINK_TIMEOUT_S

    def read(self) -> bytes:
        """Reads the input block; up to 3 attempts for each byte."""
        reads = (partial(self._transact, self._where.input, byte) for byte in range(BLOCK_BYTES))
        return bytes(map(self._repeated, reads))

    def write(self, block: bytes) -> None:
        """Writes those bytes of the output block that differ from the last write, each once."""
        for index in WRITE_ORDER if block[ACTION] & GOES else STOP_ORDER:
            if block[index] != self._written[index]:
                self._written[index] = None  # until it is acknowledged
                self._transact(self._where.output, index, block[index])
                self._written[index] = block[index]

    def close(self) -> None:
        """Leaves the bus; nothing moves."""
        self._lost = self._lost or "it was closed"
        self._network.disconnect()

    def _transact(self, index: int, byte: int, data: int | None = None) -> int:
        """Makes one expedited transfer (CiA 301, 7.2.4): reads a byte of a block, or writes `data` to it.

        Args:
            index: index of the object that is the block.
            byte: number of the byte, from 0.
            data: value to write; None: the byte is read.

        Returns:
            The byte read; after a write it has no meaning.
        """
        self._begin()
        command = READ if data is None else WRITE_ONE
        reply = self._ask(struct.pack("<BHBI", command, index, byte + 1, data or 0), index, byte)
        answered, *place, _ = struct.unpack("<BHBI", reply)
        if place != [index, byte + 1] or answered & ANSWER_MASK != ANSWERS[command]:
            raise self._silent(index, byte)
        return reply[4]

    def _ask(self, request: bytes, index: int, byte: int) -> bytes:
        import can
        import canopen

        try:
            reply: bytes = self._sdo.request_response(request)
        except canopen.SdoAbortedError as error:
            raise LinkError(
                f"gripper at {self.endpoint} refused object 0x{index:04X}:{byte + 1} ({shown(error)}); the "
                "map is not verified, set output and input in the port's name"
            ) from error
        except canopen.SdoCommunicationError as error:
            raise self._silent(index, byte) from error
        except (can.CanError, OSError) as error:
            self._lost = "the bus broke"
            raise LinkError(f"gripper link {self.endpoint} broke: {shown(error)}") from error
        return reply

    def _silent(self, index: int, byte: int) -> LinkTimeout:
        self._tell("no answer", object=f"0x{index:04X}:{byte + 1}")
        return LinkTimeout(
            f"gripper at {self.endpoint} did not answer within {LINK_TIMEOUT_S} s; check power, bitrate "
            f"and node {self._where.node}"
        )


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None = None
) -> Gripper:
    """Opens the gripper at `can:channel?setting=value&...`; starts the node, unless `read_only`.

    Raises:
        PortError: the extra is not installed, a setting is invalid, or there is no such bus.
        LinkError: no such node answers.
    """
    where = parse(port)
    link = CanLink(_network(port, where, read_only=read_only), where, port, report)
    return Gripper(link, pace, report, profile, read_only=read_only)


def parse(port: str) -> CanMap:
    """Parses the map in a port's name; a setting that the name does not state has its default.

    Raises:
        PortError: a setting is invalid.
    """
    name, _, query = port.removeprefix("can:").partition("?")
    settings: dict[str, Any] = {}
    for key, text in parse_qsl(query, keep_blank_values=True):
        with contextlib.suppress(ValueError):
            if key in CanMap._fields and key != "channel":
                settings[key] = text if key == "interface" else int(text, 0)
        if key not in settings:
            known = ", ".join(CanMap._fields[1:])
            raise PortError(f"port {port}: {key}={text} is not understood; there are {known}")
    where = CanMap(name, **settings)
    if not name or not 0 < where.node < 128:
        raise PortError(f"port {port}: name a channel and a node of 1 to 127, as can:can0?node=11")
    return where


def _network(port: str, where: CanMap, *, read_only: bool) -> "canopen.Network":
    try:
        import can
        import canopen
    except ImportError as error:
        raise PortError(f"port {port}: {error}; install squeezetree[can]") from error
    # Failures that canopen logs reach the caller as exceptions of `drivers.errors`.
    logging.getLogger("canopen").setLevel(logging.CRITICAL + 1)
    network = canopen.Network()
    network.NOTIFIER_CYCLE = HEAR_S
    options = {"bitrate": where.bitrate} if where.bitrate else {}
    try:
        network.connect(interface=where.interface, channel=where.channel, **options)
    except (can.CanError, OSError, ValueError) as error:
        raise PortError(f"port {port} cannot be opened: {shown(error)}; check `ip link`") from error
    if not read_only:  # starts the node (NMT); this makes no gripper move
        network.send_message(0, bytes((1, where.node)))
    return network
