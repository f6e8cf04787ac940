"""Checks of a UR controller for `grasp-doctor`: its open ports show which services and URCaps are missing."""

import socket
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

from runtime.commands.checks import Finding, bad, good, warning

RTDE, SCRIPTS, DASHBOARD = 30004, 30002, 29999
# ports of Robotiq's URCap, and of the URCap that forwards the tool connector's RS-485
GRIPPER, FORWARDER = 63352, 54321
USUAL = {"urcap": GRIPPER, "ur": RTDE}  # default port by the scheme of an address
LOOK_S = 1.0

Accepts = Callable[[str, int], bool]


def accepts(host: str, port: int) -> bool:
    """Whether a host accepts a connection to a TCP port; nothing is sent."""
    try:
        with socket.create_connection((host, port), timeout=LOOK_S):
            return True
    except (OSError, UnicodeError):
        return False


def check_controllers(addresses: Iterator[str], listens: Accepts = accepts) -> Iterator[Finding]:
    """Checks which ports are open on each UR controller that the addresses name; yields findings.

    Args:
        addresses: the addresses of gripper and arm.
        listens: whether a host accepts a connection to a port.
    """
    seen = set()
    for address in addresses:
        try:
            parts = urlsplit(address)
            port = parts.port
        except ValueError:  # the driver reports this when it opens the device
            continue
        wanted = port or USUAL.get(parts.scheme, 0)
        on_ur = parts.scheme in USUAL or (parts.scheme, port) == ("rtu+tcp", FORWARDER)
        if on_ur and parts.hostname and (parts.hostname, wanted) not in seen:
            seen.add((parts.hostname, wanted))
            yield from _check(parts.hostname, wanted, listens)


def _check(host: str, wanted: int, listens: Accepts) -> Iterator[Finding]:
    ports = (wanted, RTDE, SCRIPTS, DASHBOARD, GRIPPER, FORWARDER)
    here = {port for port in ports if listens(host, port)}
    if not here:
        yield bad(
            f"Nothing listens on {host}: neither {wanted} nor RTDE ({RTDE}).",
            "Check address, cable and power; enable the network, and the services under Settings, Security.",
        )
        return
    polyscope_x = DASHBOARD not in here and RTDE in here
    if wanted in here:
        yield good(f"Port {wanted} of {host} accepts connections.")
    elif wanted == GRIPPER:
        yield _without_urcap(host, forwarded=FORWARDER in here, polyscope_x=polyscope_x)
    elif wanted == FORWARDER:
        yield bad(
            f"{host} does not forward its tool connector (port {FORWARDER}).",
            "Install the tool communication forwarder's URCap, switch it on, and allow the port under "
            "Settings, Security.",
        )
    else:
        yield bad(
            f"Port {wanted} of {host} is closed.", "Enable RTDE under Settings, Security, Services."
        )
    if wanted == RTDE and SCRIPTS not in here:
        yield bad(
            f"Port {SCRIPTS} of {host} is closed, so the arm cannot be moved.",
            "Enable the secondary interface under Settings, Security, Services, for this machine's network.",
        )
    if {GRIPPER, FORWARDER} <= here:
        yield warning(
            f"Ports {GRIPPER} and {FORWARDER} of {host} are open: two URCaps may hold the tool connector.",
            "Keep one: Robotiq's (urcap://), or the forwarder (rtu+tcp://); together neither is reliable.",
        )


def _without_urcap(host: str, *, forwarded: bool, polyscope_x: bool) -> Finding:
    message = f"Nobody listens on port {GRIPPER} of {host}, where Robotiq's URCap should."
    if forwarded:
        return bad(
            message,
            f"The tool connector is forwarded; use --port rtu+tcp://{host}:{FORWARDER} instead.",
        )
    if polyscope_x:
        return bad(
            f"{message} There is no dashboard either, as on PolyScope X, "
            "whose gripper URCap has no such port.",
            f"Install the tool communication forwarder's URCap and use --port rtu+tcp://{host}:{FORWARDER}.",
        )
    return bad(
        message,
        "Install the URCap, enable its gripper in the installation, and allow the port under Settings, "
        "Security (inbound access).",
    )
