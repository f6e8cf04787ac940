"""Pictures from folders and networks: each comes within its deadline, and none is outdated."""

import contextlib
import socket
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest
from cameras import camera, rig

from drivers.camera.vision.sources import Folder, Still, Stream, open_source
from drivers.errors import PictureError
from drivers.sim.camera.render import jpeg
from drivers.sim.camera.server import CameraServer
from drivers.sim.physics.tabletop import Look
from runtime.shell.errors import UnreachableError


def soon(seconds=20.0):
    return time.monotonic() + seconds


class Counter:
    """A camera whose n-th picture has the brightness n."""

    taken = 0

    def __call__(self):
        self.taken += 1
        return jpeg(np.full((48, 64), self.taken % 250, np.uint8), 95)


@pytest.fixture
def counter():
    return Counter()


@pytest.fixture
def server(counter):
    with contextlib.closing(CameraServer(counter)) as running:
        yield running


class Streaming(BaseHTTPRequestHandler):
    """A network camera that sends one JPEG after another."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        with contextlib.suppress(ConnectionError):
            while not self.server.stopped.wait(0.02):
                self.server.flowing.wait()
                data = self.server.take()
                head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode("ascii") + data + b"\r\n")

    def log_message(self, *args):
        pass


@pytest.fixture
def flowing():
    """An event that is set at first; a test clears it to halt the pictures of the stream."""
    event = threading.Event()
    event.set()
    return event


@pytest.fixture
def stream_url(counter, flowing):
    with ThreadingHTTPServer(("127.0.0.1", 0), Streaming) as server:
        server.take, server.stopped, server.flowing = counter, threading.Event(), flowing
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/stream.mjpg"
        server.stopped.set()
        flowing.set()
        server.shutdown()


def test_folder_gives_each_picture_once_in_order_of_names(tmp_path):
    for name, level in (("b.png", 20), ("a.png", 10)):
        cv2.imwrite(str(tmp_path / name), np.full((4, 5), level, np.uint8))
    (tmp_path / "notes.txt").touch()
    source = open_source(str(tmp_path))
    assert [int(source.picture(soon())[0, 0]) for _ in range(2)] == [10, 20]
    with pytest.raises(UnreachableError, match="no further picture"):
        source.picture(time.monotonic())
    cv2.imwrite(str(tmp_path / "c.png"), np.full((4, 5), 30, np.uint8))
    assert source.picture(soon())[0, 0] == 30


def test_folder_after_a_picture_returns_only_later_ones(tmp_path):
    for name, grey in (("a", 10), ("b", 20)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((4, 5), grey, np.uint8))
    assert open_source(str(tmp_path), after="a.png").picture(soon())[0, 0] == 20


def test_folder_unfinished_picture_is_waited_for(tmp_path):
    path = tmp_path / "a.png"
    path.touch()
    later = threading.Timer(0.3, lambda: cv2.imwrite(str(path), np.full((4, 5), 7, np.uint8)))
    later.start()
    assert Folder(tmp_path).picture(soon())[0, 0] == 7
    later.join()


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("/dev/video99", "no camera or folder /dev/video99"),
        ("99", "no camera or folder /dev/video99"),
        (__file__, "neither a camera nor a folder"),
        ("", "camera '' is of no known kind; name /dev/video0"),
        ("ftp://127.0.0.1/table", "camera 'ftp://127.0.0.1/table' is of no known kind"),
    ],
)
def test_open_source_unknown_address_is_refused(address, sentence):
    with pytest.raises(UnreachableError, match=sentence):
        open_source(address)


def test_still_picture_is_requested_each_time(server):
    source = open_source(server.url)
    assert isinstance(source, Still)
    assert [int(source.picture(soon())[0, 0]) for _ in range(3)] == [1, 2, 3]


def test_still_camera_gone_or_silent_is_reported_in_time(server):
    server.close()
    with pytest.raises(UnreachableError, match="is it on, and in this network"):
        open_source(server.url).picture(soon())
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        address = f"http://127.0.0.1:{deaf.getsockname()[1]}/picture.jpg"
        with pytest.raises(UnreachableError, match="timed out"):
            Still(address).picture(soon(0.1))


@pytest.mark.parametrize("start", [b"HTTP/1.1 200 OK\r\nX: ", b"HTTP/1.1 200 OK\r\n\r\n"])
def test_still_dripping_answer_is_reported_in_time(start):
    """Each byte comes in time, but the picture is never complete."""

    def drip(listener, stopped):
        client = listener.accept()[0]
        with contextlib.suppress(OSError), client:
            client.sendall(start)
            while not stopped.wait(0.05):
                client.sendall(b"x")

    stopped = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=drip, args=(listener, stopped), daemon=True).start()
        with pytest.raises(UnreachableError, match="timed out"):
            Still(f"http://127.0.0.1:{listener.getsockname()[1]}/picture.jpg").picture(soon(0.3))
        stopped.set()


def test_stream_picture_is_taken_after_request(stream_url, counter, flowing):
    """FFmpeg buffers pictures while it probes the stream; the test first lets the source read these."""
    with contextlib.closing(open_source(stream_url)) as source:
        assert isinstance(source, Stream)
        source.picture(soon())
        flowing.clear()
        drained = soon()
        while int(source._frame[0, 0]) < counter.taken - 2 and time.monotonic() < drained:
            time.sleep(0.01)
        before = counter.taken
        threading.Timer(0.1, flowing.set).start()
        level = int(source.picture(soon())[0, 0])
        assert before - 2 <= level <= counter.taken + 2


def test_stream_that_cannot_be_opened_is_reported():
    stream = contextlib.closing(Stream("/dev/null", cv2.CAP_V4L2, (64, 48)))
    with stream as source, pytest.raises(UnreachableError, match="check power and cable"):
        source.picture(soon(0.2))


def test_stream_opened_keeps_log_level_that_the_environment_chose():
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_DEBUG)
    try:
        Stream("/dev/null", cv2.CAP_V4L2).close()
        assert cv2.utils.logging.getLogLevel() == cv2.utils.logging.LOG_LEVEL_DEBUG
    finally:
        cv2.utils.logging.setLogLevel(before)


def test_camera_server_shows_part_where_it_is_now(tmp_path):
    poses = iter([(0.0, 0.0, 0.0), (60.0, 0.0, 0.0), None])
    take = rig(camera()).watcher(lambda: Look(next(poses)), seed=1)
    with contextlib.closing(CameraServer(take)) as running:
        source = open_source(running.url)
        first, moved, empty = (source.picture(soon()).astype(int) for _ in range(3))
    assert first.shape == (540, 960)
    assert np.abs(first - empty).max() > 80
    assert np.abs(moved - empty).max() > 80
    assert np.abs(first - moved).max() > 80


def test_folder_that_vanishes_is_reported(tmp_path):
    gone = tmp_path / "pictures"
    gone.mkdir()
    source = open_source(str(gone))
    gone.rmdir()
    with pytest.raises(UnreachableError, match=r"folder .*pictures: No such file or directory"):
        source.picture(soon())


def test_folder_unreadable_picture_is_reported(tmp_path):
    (tmp_path / "0.jpg").write_bytes(b"not a picture")
    with pytest.raises(PictureError, match=r"what came is no picture \(13 bytes\)"):
        Folder(tmp_path).picture(soon())
    (tmp_path / "0.jpg").unlink()
    (tmp_path / "a.png").mkdir()
    with pytest.raises(UnreachableError, match=r"picture .*a\.png: Is a directory"):
        open_source(str(tmp_path)).picture(soon())
