"""Entry points of grasp-audit and grasp-calibrate, which say if the extra `audit` is missing."""

import os
import sys
from collections.abc import Sequence
from importlib import import_module

from runtime.shell.command import entry

AUDIT, CALIBRATE = "drivers.camera.audit.command", "drivers.camera.calibration.command"
FROM_JOURNALS = {"report": "runtime.spc.command", "study": "runtime.spc.study.command"}
# Read by OpenCV when it is imported. It and FFmpeg would report a missing camera once a second, although the
# verdict reports it.
QUIET = {"OPENCV_LOG_LEVEL": "OFF", "OPENCV_FFMPEG_LOGLEVEL": "-8"}


def audit(arguments: Sequence[str] | None = None) -> int:
    """Runs grasp-audit and returns its exit code; only `judge` needs the extra `audit`."""
    words = _words(arguments)
    if words and words[0] in FROM_JOURNALS:
        return int(import_module(FROM_JOURNALS[words[0]]).main(words[1:]))
    return _run("grasp-audit", AUDIT, words)


def calibrate(arguments: Sequence[str] | None = None) -> int:
    """Runs grasp-calibrate; returns its exit code."""
    return _run("grasp-calibrate", CALIBRATE, _words(arguments))


def _words(arguments: Sequence[str] | None) -> list[str]:
    return list(sys.argv[1:] if arguments is None else arguments)


def _run(command: str, module: str, words: Sequence[str]) -> int:
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    return entry(command, module, "audit", words)
