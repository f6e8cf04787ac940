"""The simulated camera on the network: each request is answered with a JPEG of the table as it is now.

`GET /picture.jpg` is one picture, `GET /stream.mjpg` a stream of them, as network cameras offer both.
"""

import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

BOUNDARY = "picture"


class CameraServer:
    """Serves what a camera sees.

    Args:
        take: takes a picture, as the bytes of a JPEG; called by several threads, one at a time.
        period_s: between the pictures of a stream.
        port: of localhost; 0: any that is free.
    """

    def __init__(self, take: Callable[[], bytes], period_s: float = 0.1, port: int = 0) -> None:
        self._stopped = threading.Event()
        self._server = ThreadingHTTPServer(("127.0.0.1", port), _handler(take, period_s, self._stopped))
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    @property
    def url(self) -> str:
        """Address of a single picture."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/picture.jpg"

    @property
    def stream_url(self) -> str:
        """Address of the stream."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/stream.mjpg"

    def start(self) -> None:
        """Serve until closed."""
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._stopped.set()
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()

    def __enter__(self) -> "CameraServer":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _handler(
    take: Callable[[], bytes], period_s: float, stopped: threading.Event
) -> type[BaseHTTPRequestHandler]:
    lock = threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        """One request."""

        def do_GET(self) -> None:
            """Answer with a picture or with a stream of them."""
            try:
                if self.path == "/picture.jpg":
                    self._still()
                elif self.path == "/stream.mjpg":
                    self._stream()
                else:
                    self.send_error(404, "there are /picture.jpg and /stream.mjpg")
            except ConnectionError:
                self.close_connection = True

        def _still(self) -> None:
            with lock:
                data = take()
            self.send_response(200)
            self.send_header("Content-Type", "image/jpeg")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def _stream(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
            self.end_headers()
            while not stopped.wait(period_s):
                with lock:
                    data = take()
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode("ascii") + data + b"\r\n")

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
            """Keep quiet."""

    return Handler
