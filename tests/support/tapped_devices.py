"""A gripper on a pseudo-terminal and an open_abb server on a port, which record every byte that they receive.

They use no code of this project, so that tests compare the bytes on the wire with the manuals alone.
"""

import contextlib
import os
import select
import socket
import threading
import tty

READS, WRITES = {3, 4}, {5, 6, 15, 16, 22, 23}
ACTIVE_OPEN = bytes((0xF9, 0, 0, 0, 3, 0))  # active, at the requested position, gPR 0, gPO 3
POWERED_UP = bytes((0, 0, 0, 0, 3, 0))
PAYLOADS = {3: "10.00 20.00 60.00 0.000 1.000 0.000 0.000", 4: "0.00 0.00 0.00 0.00 90.00 180.00"}


def crc(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class TappedGripper:
    """A gripper with slave id 9: answers each read with the same input block, and ignores other requests."""

    unit = 9

    def __init__(self) -> None:
        self.block = ACTIVE_OPEN
        self.heard = bytearray()
        self.functions: list[int] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> "TappedGripper":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def hear(self, data: bytes) -> None:
        """Records bytes in the order in which they arrive."""
        self.heard += data

    def _serve(self) -> None:
        frame = b""
        while not self._closed.is_set():
            if not select.select([self._master], [], [], 0.05)[0]:
                frame = b""
                continue
            data = os.read(self._master, 256)
            self.hear(data)
            frame += data
            if len(frame) >= 8 and frame[-2:] == crc(frame[:-2]):
                self.functions.append(frame[1])
                if frame[0] == self.unit and frame[1] in READS:
                    payload = self.block[: 2 * frame[5]]
                    body = bytes((self.unit, frame[1], len(payload))) + payload
                    os.write(self._master, body + crc(body))
                frame = b""


class TappedArm:
    """An open_abb server that acknowledges every command, and records all commands."""

    def __init__(self) -> None:
        self.heard: list[str] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> "TappedArm":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join()

    @property
    def codes(self) -> list[int]:
        return [int(line.split()[0]) for line in self.heard]

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            with contextlib.suppress(OSError), client:
                while line := client.recv(256).decode("ascii"):
                    self.heard.append(line)
                    code = int(line.split()[0])
                    if code != 99:
                        client.sendall(f"{code} 1 {PAYLOADS.get(code, '')}".encode("ascii"))
