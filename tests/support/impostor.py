"""A TCP server that answers, but is not the device that a driver expects."""

import contextlib
import socket
import threading


class Impostor:
    """Sends each client a greeting, then `answer` after each message; hangs up after `answers` messages."""

    def __init__(self, answer=b"", answers=1000, greeting=b""):
        self._answer, self._answers, self._greeting = answer, answers, greeting
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                self._meet(self._listener.accept()[0])

    def _meet(self, client):
        with contextlib.suppress(ConnectionError), client:
            client.sendall(self._greeting)
            for _ in range(self._answers):
                if not client.recv(4096):
                    break
                client.sendall(self._answer)
