"""The open_abb logger (`RAPID/LOGGER.mod`) on a TCP port: poses and joints in turn, without terminators."""

import datetime
import socket
from collections.abc import Callable

from drivers.abb.codec import Pose
from drivers.sim.devices import rapid
from drivers.sim.wire.serving import SimulatedTime, TcpServer

WAIT_S = 0.1  # loggerWaitTime as shipped
ACCEPT_S = 0.5


class ArmLogger(TcpServer):
    """Sends where the arm is, whether or not anybody reads it.

    Args:
        look: the hand's pose and the joints in degrees, now.
        time: simulated time.
    """

    def __init__(self, look: Callable[[], tuple[Pose, tuple[float, ...]]], time: SimulatedTime) -> None:
        super().__init__("logger", time.stopped)
        self._look = look
        self._time = time
        # CDate and CTime are read once, when the program starts; nothing else here depends on the machine.
        self._stamp = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S")

    def _serve(self, client: socket.socket) -> None:
        self._time.sleep(ACCEPT_S)
        client.settimeout(0.5)
        while not self._stopped.is_set():
            for kind in (0, 1):
                client.sendall(self._record(kind).encode("ascii"))
                self._time.sleep(WAIT_S)

    def _record(self, kind: int) -> str:
        pose, joints = self._look()
        angles = " ".join(rapid.to_string(angle, 2) for angle in joints)
        numbers = rapid.pose_string(pose, 1) if kind == 0 else angles
        return f"# {kind} {self._stamp} {rapid.to_string(self._time.now(), 2)} {numbers}"
