"""What keeps the camera from judging; `exit_code` is what a command returns that ends with it."""


class CameraError(Exception):
    """The camera cannot say where the part is."""

    exit_code = 27


class SourceError(CameraError):
    """There is no picture: camera unplugged, address wrong, nothing came in time."""

    exit_code = 23


class PictureError(CameraError):
    """The picture shows nothing that could be measured."""


class CameraFileError(CameraError):
    """A file about the camera cannot be used."""

    exit_code = 33


class CalibrationRefusedError(CameraError):
    """These pictures do not make a calibration that could be trusted."""

    exit_code = 33
