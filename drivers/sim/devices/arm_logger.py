"""The open_abb logger (`RAPID/LOGGER.mod`) on a TCP port: poses and joints in turn, without terminators.

The driver does not need it: it is here because the real controller has it, and some clients listen.
"""

import contextlib
import datetime
import select
import socket
import threading
from collections.abc import Callable

from drivers.abb.codec import Pose
from drivers.sim.devices import rapid

WAIT_S = 0.1  # loggerWaitTime as shipped
ACCEPT_S = 0.5


class ArmLogger:
    """Sends where the arm is, whether or not anybody reads it.

    Args:
        look: the hand's pose and the joints in degrees, now.
        now: simulated seconds.
        sleep: pause of simulated seconds; returns early when the cell stops.
        stopped: tells that the cell stops.
    """

    def __init__(
        self,
        look: Callable[[], tuple[Pose, tuple[float, ...]]],
        now: Callable[[], float],
        sleep: Callable[[float], None],
        stopped: threading.Event,
    ) -> None:
        self._look = look
        self._now = now
        self._sleep = sleep
        self._stopped = stopped
        # CDate and CTime are read once, when the program starts; nothing else here depends on the machine.
        self._stamp = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S")
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, name="logger", daemon=True)

    def start(self) -> None:
        """Serve until the cell stops."""
        self._thread.start()

    def close(self) -> None:
        """Wait for the end; the cell's stop event must be set."""
        if self._thread.is_alive():
            self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        while not self._stopped.is_set():
            if not select.select([self._listener], [], [], 0.1)[0]:
                continue
            client, _ = self._listener.accept()
            self._sleep(ACCEPT_S)
            with client, contextlib.suppress(OSError):
                client.settimeout(0.5)
                self._stream_to(client)

    def _stream_to(self, client: socket.socket) -> None:
        while not self._stopped.is_set():
            for kind in (0, 1):
                client.sendall(self._record(kind).encode("ascii"))
                self._sleep(WAIT_S)

    def _record(self, kind: int) -> str:
        pose, joints = self._look()
        if kind == 0:
            numbers = [rapid.to_string(value, 1) for value in pose[:3]]
            numbers += [rapid.to_string(part, 3) for part in pose.rotation]
        else:
            numbers = [rapid.to_string(angle, 2) for angle in joints]
        return " ".join(("#", str(kind), self._stamp, rapid.to_string(self._now(), 2), *numbers))
