"""The open_abb motion server on a TCP port: one client, no framing, silence after a motion fault."""

import contextlib
import math
import select
import socket
import struct
import threading
from collections.abc import Callable

from drivers.sim.devices.arm import Answer, Controller
from drivers.sim.devices.rapid import RapidError

ACCEPT_S = 0.5  # simulated: WaitTime after SocketAccept in ServerCreateAndConnect
MAX_STRING = 80  # SocketReceive \Str takes so much at once


class ArmServer:
    """Serves an arm model as SERVER.mod does.

    Args:
        model: the arm.
        lock: held while the model is used.
        now: simulated seconds.
        sleep: pause of simulated seconds; returns early when the cell stops.
        stopped: tells that the cell stops.
        executed: called after each finished instruction.
    """

    def __init__(
        self,
        model: Controller,
        lock: "threading.RLock | threading.Lock",
        now: Callable[[], float],
        sleep: Callable[[float], None],
        stopped: threading.Event,
        executed: Callable[[], None] = lambda: None,
    ) -> None:
        self._model = model
        self._lock = lock
        self._now = now
        self._sleep = sleep
        self._stopped = stopped
        self._executed = executed
        self._stale: str | None = None
        self._waiting: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, name="arm", daemon=True)

    @property
    def url(self) -> str:
        """Where clients connect."""
        return f"tcp://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Serve until the cell stops."""
        self._thread.start()

    def close(self) -> None:
        """Wait for the end; the cell's stop event must be set."""
        if self._thread.is_alive():
            self._thread.join()
        self._cut_off()
        self._listener.close()

    def _serve(self) -> None:
        while not self._stopped.is_set():
            if self._listener not in self._readable([self._listener]):
                continue
            client, _ = self._listener.accept()
            with client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sleep(ACCEPT_S)
                with contextlib.suppress(OSError):
                    self._serve_client(client)
            self._cut_off()

    def _cut_off(self) -> None:
        """SERVER.mod makes its sockets anew after each client: who queued meanwhile is reset, unserved."""
        for waiting in self._waiting:
            waiting.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            waiting.close()
        self._waiting.clear()

    def _serve_client(self, client: socket.socket) -> None:
        if self._stale is not None:
            # The instruction that failed was the send of an acknowledgement: RAPID retries it first.
            stale, self._stale = self._stale, None
            client.sendall(stale.encode("latin-1"))
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
                    answer = self._model.execute(data.decode("latin-1"), self._now())
            except RapidError:
                return
            if answer.closing or not self._deliver(client, answer):
                return

    def _deliver(self, client: socket.socket, answer: Answer) -> bool:
        """Send the acknowledgement when the instruction is over; False ends this client."""
        if math.isinf(answer.ready_s):
            self._stopped.wait()  # RAPID execution stopped: connection open, nobody at home
            return False
        if answer.broken:
            client.shutdown(socket.SHUT_RDWR)
        elif answer.before:
            client.sendall(answer.before.encode("latin-1"))
        while (left := answer.ready_s - self._now()) > 0.0 and not self._stopped.is_set():
            self._sleep(left)
        self._executed()
        if answer.text is None or self._stopped.is_set():
            return answer.text is not None
        if answer.broken or _gone(client):
            self._stale = answer.text
            return False
        try:
            client.sendall(answer.text.encode("latin-1"))
        except OSError:
            self._stale = answer.text
            return False
        return True

    def _readable(self, sockets: list[socket.socket]) -> list[socket.socket]:
        return select.select(sockets, [], [], 0.1)[0]


def _gone(client: socket.socket) -> bool:
    """Whether the client has hung up and everything it sent was read."""
    if not select.select([client], [], [], 0.0)[0]:
        return False
    try:
        return client.recv(1, socket.MSG_PEEK) == b""
    except OSError:
        return True
