"""What keeps the camera from judging, each with its own sentence.

::

    CameraError                      the verdict is "unknown"
     +- SourceError              23  no picture: no camera, no file, no answer in time
     +- PictureError             27  a picture that shows nothing: black, overexposed, of another size
     +- TagError                 27  the tag: none, two, of another family, another number, half covered
     +- MovedError               27  the reference tags are not where they were: the camera moved
     +- CameraFileError          33  a calibration or tag file that is damaged, changed, or of another camera
     +- RefusedError             33  a calibration that must not be made of these pictures

`exit_code` is what a command returns that ends with one; the audit itself goes on.
"""


class CameraError(Exception):
    """The camera cannot say where the part is."""

    exit_code = 27


class SourceError(CameraError):
    """There is no picture: camera unplugged, address wrong, nothing came in time."""

    exit_code = 23


class PictureError(CameraError):
    """The picture shows nothing that could be measured."""


class TagError(CameraError):
    """The part's tag is not seen once, whole and alone."""


class MovedError(CameraError):
    """The camera stands elsewhere than where it was calibrated."""


class CameraFileError(CameraError):
    """A file about the camera cannot be used."""

    exit_code = 33


class RefusedError(CameraError):
    """These pictures do not make a calibration that could be trusted."""

    exit_code = 33
