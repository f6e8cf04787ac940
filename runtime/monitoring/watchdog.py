"""What systemd wants to hear: that the service is ready, alive and stopping (sd_notify(3)), and nothing else.

The loop tells that it is alive at each change of phase, from its own thread: a loop that hangs in a device
falls silent, and the service manager ends it. So `WatchdogSec` has to be longer than the longest phase.
"""

import contextlib
import os
import socket
from collections.abc import Mapping

from runtime.execution.phases import Phase

READY, STOPPING, ALIVE = "READY=1", "STOPPING=1", "WATCHDOG=1"


def notify(*lines: str, environment: Mapping[str, str] = os.environ) -> bool:
    """Send lines to the service manager; whether there is one that took them."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    # A leading @ stands for the zero byte of Linux' abstract names.
    name = "\0" + address[1:] if address.startswith("@") else address
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel,
    ):
        channel.connect(name)
        channel.sendall("\n".join(lines).encode())
        return True
    return False


def alive(part: int, phase: Phase, node: int | None) -> None:
    """The watcher that keeps the watchdog quiet, and the status line of `systemctl status` true."""
    where = "" if node is None else f", node {node}"
    notify(ALIVE, f"STATUS=part {part}: {phase.value}{where}")
