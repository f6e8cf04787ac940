"""The open_abb motion server on a TCP port: one client, no framing, silence after a motion fault."""

import datetime
import math
import select
import socket
import struct
from collections.abc import Callable

from drivers.abb.codec import Pose
from drivers.sim.devices import rapid
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.wire.serving import Lock, SimulatedTime, TcpServer

ACCEPT_S = 0.5  # simulated: WaitTime after SocketAccept in ServerCreateAndConnect
LOGGER_WAIT_S = 0.1  # loggerWaitTime as shipped
MAX_STRING = 80  # SocketReceive \Str accepts so much at once


class ArmServer(TcpServer):
    """Serves an arm model like SERVER.mod.

    Args:
        model: the arm.
        lock: held while the model is used.
        time: simulated time.
        executed: called after each finished instruction, under the lock.
    """

    def __init__(
        self,
        model: ArmModel,
        lock: Lock,
        time: SimulatedTime,
        executed: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__("arm", time.stopped)
        self._model = model
        self._lock = lock
        self._time = time
        self._executed = executed
        self._stale: str | None = None
        self._waiting: list[socket.socket] = []

    def close(self) -> None:
        """Stops serving; waiting clients are reset."""
        super().close()
        self._left()

    def _serve(self, client: socket.socket) -> None:
        self._time.sleep(ACCEPT_S)
        if self._stale is not None:
            # The failed instruction was the send of an acknowledgement: RAPID retries it first.
            client.sendall(self._stale.encode("latin-1"))
            self._stale = None
        while not self._stopped.is_set():
            ready = self._readable([client, self._listener])
            if client not in ready:
                self._waiting += [self._listener.accept()[0] for _ in ready]
                continue
            data = client.recv(MAX_STRING)
            if not data:
                return
            try:
                with self._lock:
                    answer = self._model.execute(data.decode("latin-1"), self._time.now())
            except rapid.RapidError:
                return
            if answer.closing or not self._deliver(client, answer):
                return

    def _left(self) -> None:
        """SERVER.mod recreates its sockets after each client: queued clients are reset, unserved."""
        for waiting in self._waiting:
            waiting.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            waiting.close()
        self._waiting.clear()

    def _deliver(self, client: socket.socket, answer: Answer) -> bool:
        """Sends the acknowledgement at the end of the instruction; False ends this client."""
        if math.isinf(answer.ready_s):
            self._stopped.wait()  # RAPID execution stopped: the connection stays open without answers
            return False
        if answer.broken:
            client.shutdown(socket.SHUT_RDWR)
        elif answer.before:
            client.sendall(answer.before.encode("latin-1"))
        while (left := answer.ready_s - self._time.now()) > 0.0 and not self._stopped.is_set():
            self._time.sleep(left)
        with self._lock:
            self._executed()
        if answer.text is None or self._stopped.is_set():
            return answer.text is not None
        self._stale = answer.text
        if answer.broken or _gone(client):
            return False
        client.sendall(answer.text.encode("latin-1"))
        self._stale = None
        return True


def _gone(client: socket.socket) -> bool:
    """Whether the client has disconnected and all its data was read."""
    if not select.select([client], [], [], 0.0)[0]:
        return False
    try:
        return client.recv(1, socket.MSG_PEEK) == b""
    except OSError:
        return True


class ArmLogger(TcpServer):
    """Sends poses and joints in turn, without terminators (`RAPID/LOGGER.mod`).

    Args:
        look: the hand's pose and the joints in degrees, now.
        time: simulated time.
    """

    def __init__(
        self, look: Callable[[], tuple[Pose, tuple[float, ...]]], time: SimulatedTime
    ) -> None:
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
                self._time.sleep(LOGGER_WAIT_S)

    def _record(self, kind: int) -> str:
        pose, joints = self._look()
        angles = " ".join(rapid.to_string(angle, 2) for angle in joints)
        numbers = rapid.pose_string(pose, 1) if kind == 0 else angles
        return f"# {kind} {self._stamp} {rapid.to_string(self._time.now(), 2)} {numbers}"
