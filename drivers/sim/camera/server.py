"""HTTP server of the simulated camera: `GET /picture.jpg` returns a JPEG of the table as it is now."""

import contextlib
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from drivers.sim.wire.serving import HOST, LibraryServer


class CameraServer(LibraryServer):
    """Serves the JPEG files that `take` returns; several threads call `take`, but only one at a time."""

    def __init__(self, take: Callable[[], bytes]) -> None:
        lock = threading.Lock()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                with contextlib.suppress(ConnectionError):
                    if self.path != "/picture.jpg":
                        self.send_error(404, "there is /picture.jpg")
                        return
                    with lock:
                        data = take()
                    self.send_response(200)
                    self.send_header("Content-Type", "image/jpeg")
                    self.send_header("Content-Length", str(len(data)))
                    self.end_headers()
                    self.wfile.write(data)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
                """Logs nothing."""

        server = ThreadingHTTPServer((HOST, 0), Handler)
        super().__init__(server)
        self.url = f"http://{HOST}:{server.server_port}/picture.jpg"
