"""Sources of pictures: a device, a network camera, a folder. Every picture has a deadline."""

import http.client
import threading
import time
import urllib.error
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from drivers.bounds import opener
from drivers.camera.vision.arrays import Picture
from drivers.errors import PictureError, shown
from runtime.shell.errors import UnreachableError

FRESH_FRAMES = 2  # `Stream.picture` returns the second frame from its call on
POLL_S = 0.005  # time between two looks into a folder
RETRY_S = 1.0  # time between two attempts to open a camera
MAX_PICTURE_BYTES = 64 << 20
KINDS = "name /dev/video0, rtsp://, http:// or a folder of pictures"
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"})


class Source:
    """Base class of sources of pictures."""

    def picture(self, until: float) -> Picture:
        """Returns the next picture (h, w); a camera takes it after this call.

        Raises:
            UnreachableError: no picture arrives by `until` (`time.monotonic`).
            PictureError: the data that arrives is no picture.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Releases the camera."""


def open_source(address: str, size: tuple[int, int] | None = None, after: str = "") -> Source:
    """Opens the source at an address.

    Args:
        address: `/dev/video0` or a device's number; `rtsp://...`; `http://...` (a JPEG, or a stream of them
            where the path ends in `.mjpg` or `.mjpeg`); a folder.
        size: width and height to set a device to.
        after: name of the last picture of a folder that was taken already; "" for none.

    Raises:
        UnreachableError: the source does not exist.
    """
    if address.startswith(("http://", "https://")):
        streams = address.partition("?")[0].endswith((".mjpg", ".mjpeg"))
        return Stream(address, cv2.CAP_FFMPEG) if streams else Still(address)
    if address.startswith("rtsp://"):
        return Stream(address, cv2.CAP_FFMPEG)
    if not address or "://" in address:
        raise UnreachableError(f"camera {address!r} is of no known kind; {KINDS}")
    path = Path(f"/dev/video{address}" if address.isdecimal() else address)
    if path.is_dir():
        return Folder(path, after)
    if not path.exists():
        raise UnreachableError(f"there is no camera or folder {path}; check the cable and the name")
    if not path.is_char_device():
        raise UnreachableError(f"{path} is neither a camera nor a folder of pictures; {KINDS}")
    return Stream(str(path), cv2.CAP_V4L2, size)


class Folder(Source):
    """Source that returns each picture of a folder once, sorted by name, and waits for new ones.

    Attributes:
        last: name of the picture that was returned last; pictures up to this name are not returned.
    """

    def __init__(self, path: Path, last: str = "") -> None:
        self._path = path
        self.last = last

    def picture(self, until: float) -> Picture:
        """Waits for the next picture until the deadline, and returns it."""
        while (name := self._next()) is None:
            if time.monotonic() >= until:
                raise UnreachableError(f"folder {self._path} has no further picture")
            time.sleep(POLL_S)
        self.last = name
        try:
            return self._whole(self._path / name, until)
        except OSError as error:
            raise UnreachableError(f"picture {self._path / name}: {error.strerror}") from error

    def _whole(self, path: Path, until: float) -> Picture:
        """Decodes a file, and waits while the file is still being written."""
        data = path.read_bytes()
        while True:
            try:
                return decoded(data, str(path))
            except PictureError:
                time.sleep(POLL_S)
                before, data = data, path.read_bytes()
                if data == before and (data or time.monotonic() >= until):
                    raise

    def _next(self) -> str | None:
        try:
            names = [one.name for one in self._path.iterdir() if one.suffix.lower() in SUFFIXES]
            # Hidden ones are drafts that are still being written.
            new = (name for name in names if name > self.last and name[0] != ".")
            return min(new, default=None)
        except OSError as error:
            raise UnreachableError(f"folder {self._path}: {error.strerror}") from error


class Still(Source):
    """Source for a camera that answers each request with one JPEG: a network camera, or the simulated one."""

    def __init__(self, address: str) -> None:
        self._address = address

    def picture(self, until: float) -> Picture:
        """Requests a picture and returns it."""
        left = max(until - time.monotonic(), 1e-3)
        try:
            within = opener(until, MAX_PICTURE_BYTES)
            with within.open(self._address, timeout=left) as answer:
                data = answer.read(MAX_PICTURE_BYTES)
        except urllib.error.HTTPError as error:
            error.close()
            raise UnreachableError(
                f"camera {self._address} answers {error.code} {shown(error.reason)}"
            ) from error
        except (OSError, ValueError, http.client.HTTPException) as error:
            reason = getattr(error, "reason", error)
            reason = shown(getattr(reason, "strerror", None) or reason)
            raise UnreachableError(
                f"camera {self._address}: {reason}; is it on, and in this network?"
            ) from error
        return decoded(data, self._address)


class Stream(Source):
    """Source for a device or a stream; a separate thread reads each frame at once, so that none queues up.

    Args:
        address: device or URL, as OpenCV takes it.
        backend: number of OpenCV's video backend.
        size: width and height to set a device to.
    """

    def __init__(self, address: str, backend: int, size: tuple[int, int] | None = None) -> None:
        self._address, self._backend, self._size = address, backend, size
        self._changed = threading.Condition()
        self._frame: Picture | None = None
        self._frames = 0
        self._trouble = "has not sent a picture yet"
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._read, name="camera", daemon=True)
        self._thread.start()

    def picture(self, until: float) -> Picture:
        """Returns the second frame from now, since the first may have been exposed before the call."""
        with self._changed:
            wanted = self._frames + FRESH_FRAMES
            while self._frame is None or self._frames < wanted:
                if not self._changed.wait(max(until - time.monotonic(), 0.0)):
                    raise UnreachableError(
                        f"camera {self._address} {self._trouble}; check power and cable"
                    )
            return self._frame

    def close(self) -> None:
        """Stops reading; a read that hangs goes on in its thread."""
        self._closed.set()
        self._thread.join(RETRY_S)

    def _read(self) -> None:
        while not self._closed.is_set():
            capture = self._opened()
            while capture.isOpened() and not self._closed.is_set():
                good, frame = capture.read()
                if not good:
                    self._trouble = "broke off"
                    break
                with self._changed:
                    self._frame = grey(np.asarray(frame, np.uint8))
                    self._frames += 1
                    self._changed.notify_all()
            capture.release()
            self._closed.wait(RETRY_S)

    def _opened(self) -> cv2.VideoCapture:
        limits: list[int] = []
        if self._backend == cv2.CAP_FFMPEG:
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 3000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 3000]
        capture = cv2.VideoCapture(self._address, self._backend, limits)
        if not capture.isOpened():
            self._trouble = "cannot be opened"
        elif self._size is not None:
            # USB 2 carries full resolution only as JPEG; autofocus would invalidate the calibrated
            # lens.
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
            capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
        return capture


def decoded(data: bytes, name: str) -> Picture:
    """Decodes a picture file to grey levels, (h, w); raises a PictureError if the data is no picture."""
    picture = None
    with suppress(cv2.error):  # more pixels than OpenCV takes
        picture = (
            cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
        )
    if picture is None:
        raise PictureError(f"{name}: what came is no picture ({len(data)} bytes)")
    return np.asarray(picture, np.uint8)


def grey(frame: Picture) -> Picture:
    """Converts a frame (h, w, 3), blue first, to grey levels; returns a frame (h, w) as it is."""
    if frame.ndim != 3:
        return frame
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.uint8)
