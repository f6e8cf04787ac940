"""Locks a device for one process, under all paths and addresses of the device.

The lock is a socket in Linux's abstract namespace. Unlike a file, such a socket cannot be replaced, is the
same for all users and sessions, and ends with its process.
"""

import errno
import hashlib
import ipaddress
import os
import socket
import stat
import struct
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import SplitResult, parse_qs, urlsplit

from runtime.shell.errors import UnreachableError
from runtime.shell.host_names import addresses_of

CREDENTIALS = struct.Struct("3i")  # process, user and group, as in SO_PEERCRED
MANUAL = "manual"  # a person, whom a simulated arm may follow: manual+tcp://host:port
GATEWAYS = frozenset({"tcp", "rtu+tcp"})  # schemes by which several units may answer at one port
USUAL_UNIT = 9
LOOK_UP_S = 5.0  # wall time to look up a host's addresses
# Port of a device whose address names none.
USUAL = {"ur": 30004, "urcap": 63352, "omnicore": 443, "tcp": 502}
# Ports of a host that move the same device.
ONE_DEVICE = (
    frozenset({30001, 30002, 30003, 30004}),  # a UR arm: its interfaces
    # the gripper at its tool connector: Robotiq's URCap, and the forwarder
    frozenset({63352, 54321}),
    frozenset({443, 5000}),  # an ABB arm: Robot Web Services, and open_abb
)
SCRIPT_PORT_BELOW = 2  # the port at which a UR arm takes programs is so far below its RTDE port


class PortLock(ExitStack):
    """Lock that a process holds while it uses a device; released when the process ends, however it ends.

    A port that is a link, such as /dev/serial/by-id/..., locks the device to which the link leads. The name
    of a host locks all addresses of the host.

    Raises:
        UnreachableError: another process holds the lock; the message names the process.
    """

    def __init__(self, port: str) -> None:
        super().__init__()
        try:
            for name in _devices(port):
                self.enter_context(_bound(name, port))
        except BaseException:
            self.close()
            raise


def _bound(name: str, port: str) -> socket.socket:
    """Locks the identity `name` of the device at a port; returns the socket that holds the lock."""
    address = f"\0squeezetree-{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    result = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        result.bind(address)
        result.listen()  # so that a process that finds it taken can connect and learn the owner
    except OSError as error:
        result.close()
        if error.errno != errno.EADDRINUSE:
            raise UnreachableError(
                f"port {port}: its lock cannot be taken ({error.strerror})"
            ) from error
        owner = _owner(address)
        if owner == str(os.getpid()):
            message = "this command itself under another name", "name another device"
        else:
            message = "another process of squeezetree", "stop that first"
        raise UnreachableError(
            f"port {port} is in use by {message[0]} (process {owner}); {message[1]}"
        ) from None
    return result


def _owner(address: str) -> str:
    """The process id, as text, of the process that holds the lock at an address; or why it is unknown."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.setblocking(False)
        try:
            asking.connect(address)
            credentials = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
        except OSError:  # it was released meanwhile, or has been asked too often
            return "unknown"
    return str(CREDENTIALS.unpack(credentials)[0] or "of another container")


def _devices(port: str) -> list[str]:
    """Identities of the device at a port; none if a person takes the place of the device.

    They are a host's addresses and ports, the interface of a CAN bus, or the number of a device file; for any
    other path, the path itself.
    """
    port = port.removeprefix(f"{MANUAL}+")
    if port.partition(":")[0] == MANUAL:
        return []
    if port.startswith("can:"):
        return [port.partition("?")[0]]
    behind = port.partition("://")[2]
    if behind and not behind.startswith("/"):
        return _addresses(port)
    # The address of a tty may name its driver: other:///dev/ttyUSB0?unit=1.
    path = os.path.realpath(behind.partition("?")[0] or port)
    try:
        status = Path(path).stat()
    except OSError:
        return [path]
    return [f"device {status.st_rdev}" if stat.S_ISCHR(status.st_mode) else path]


def _addresses(url: str) -> list[str]:
    """Identities of a network device.

    They combine each IP address of the host with each port through which the device can be moved. All names
    and addresses of this machine count as one address.
    """
    try:
        parts = urlsplit(url)
        host, number = (parts.hostname or "").rstrip("."), parts.port or USUAL.get(parts.scheme)
    except ValueError:
        return [url]
    try:
        texts = {str(row[4][0]) for row in addresses_of(host, number, LOOK_UP_S)}
    except (OSError, UnicodeError):
        texts = {host}  # which nobody can connect to
    addresses = {_canonical(text) for text in texts}
    ports, unit = _together(parts.scheme, number), _unit(parts)
    return sorted(f"{address} {port}{unit}" for address in addresses for port in ports)


def _unit(parts: SplitResult) -> str:
    """Names the Modbus unit behind a gateway, as the end of an identity; "" for the unit `USUAL_UNIT`."""
    if parts.scheme not in GATEWAYS:
        return ""
    try:
        unit = int(parse_qs(parts.query).get("unit", [str(USUAL_UNIT)])[-1], 0)
    except ValueError:  # no driver accepts it
        return ""
    return "" if unit == USUAL_UNIT else f" unit {unit}"


def _together(scheme: str, number: int | None) -> set[int | None]:
    """All ports of a host through which the same device can be moved, `number` among them.

    A process that uses one of them locks all.
    """
    ports = {number}
    if scheme == "ur" and number is not None:
        ports.add(number - SCRIPT_PORT_BELOW)
    return ports.union(*(group for group in ONE_DEVICE if not ports.isdisjoint(group)))


def _canonical(text: str) -> str:
    """One spelling of an IP address: "this machine" for all of this machine's; other texts unchanged."""
    try:
        address = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return text
    address = getattr(address, "ipv4_mapped", None) or address
    is_local = address.is_loopback or address.is_unspecified or _is_own(str(address))
    return "this machine" if is_local else str(address)


def _is_own(address: str) -> bool:
    """Whether an IP address belongs to this machine: packets sent to the address also come from it.

    Nothing is sent.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as looking:
        try:
            looking.connect((address, 9))
        except OSError:  # no route
            return False
        return str(looking.getsockname()[0]) == address
