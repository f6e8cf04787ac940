"""Readable files with a checksum: JSON whose last key, `sha256`, is the digest of all before it.

A file changed by hand, cut short or written for something else is refused with a sentence that says so.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from drivers.camera.errors import CameraFileError
from runtime.shell import strict_json
from runtime.shell.files import writing

MAX_FILE_BYTES = 4 << 20
VERSION = 1
T = TypeVar("T")


def save(path: Path, kind: str, body: Mapping[str, Any]) -> None:
    """Write a file, whole or not at all.

    Args:
        path: where.
        kind: what it is about, `read`'s key.
        body: what JSON can hold.

    Raises:
        CameraFileError: it cannot be written.
    """
    document = {"kind": kind, "version": VERSION, **body}
    text = json.dumps({**document, "sha256": _digest(document)}, indent=1, allow_nan=False) + "\n"
    try:
        with writing(path) as draft:
            draft.write_text(text, encoding="ascii")
    except OSError as error:
        raise CameraFileError(str(error)) from error


def read(path: Path, kind: str, remedy: str, parse: Callable[[dict[str, Any]], T]) -> T:
    """Read a file of the kind, its checksum and version verified.

    Args:
        path: where.
        kind: what it has to be about.
        remedy: how such a file is made, for the sentence.
        parse: makes of its body what it describes; KeyError, TypeError or ValueError where it cannot.

    Raises:
        CameraFileError: it cannot be read, is of another kind, or was changed.
    """
    try:
        with path.open("rb") as file:
            told = strict_json.parse(file.read(MAX_FILE_BYTES))
    except OSError as error:
        raise CameraFileError(f"{kind} {path}: {error.strerror}; {remedy}") from error
    except ValueError as error:
        raise CameraFileError(f"{kind} {path}: damaged, it is {error}; {remedy}") from error
    if not isinstance(told, dict) or told.get("kind") != kind:
        raise CameraFileError(f"{path}: is no {kind}; {remedy}")
    if told.pop("sha256", None) != _digest(told):
        raise CameraFileError(f"{kind} {path}: damaged or changed, its checksum does not match; {remedy}")
    if told.get("version") != VERSION:
        raise CameraFileError(
            f"{kind} {path}: version {told.get('version')}, this program reads {VERSION}; {remedy}"
        )
    try:
        return parse(told)
    except (KeyError, TypeError, ValueError) as error:
        raise CameraFileError(f"{kind} {path}: {error!r}; {remedy}") from error


def _digest(document: Mapping[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
