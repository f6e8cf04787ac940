"""Readable files with a checksum: JSON whose last key, `sha256`, is the digest of everything before it.

A file that was changed, truncated or written for another purpose is refused with a message that says so.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import write

VERSION = 1
T = TypeVar("T")


def save(path: Path, kind: str, body: Mapping[str, Any]) -> None:
    """Writes a file atomically.

    Args:
        path: path of the file.
        kind: kind of the file, which `read` checks.
        body: content for JSON.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {"kind": kind, "version": VERSION, **body}
    signed = {**document, "sha256": strict_json.digest(document)}
    write(path, json.dumps(signed, indent=1, allow_nan=False) + "\n")


def read(path: Path, kind: str, remedy: str, parse: Callable[[dict[str, Any]], T]) -> T:
    """Reads a file, and checks its kind, checksum and version.

    Args:
        path: path of the file.
        kind: expected kind.
        remedy: how to create such a file, for the message.
        parse: converts the body; raises KeyError, TypeError or ValueError for an invalid one.

    Returns:
        The result of `parse`.

    Raises:
        InputError: the file cannot be read, is of another kind or version, was changed, or is invalid.
    """

    def refused(problem: str) -> InputError:
        return InputError(f"{kind} {path}: {problem}; {remedy}")

    record = strict_json.load(path, refused)
    if not isinstance(record, dict) or record.get("kind") != kind:
        raise InputError(f"{path}: is no {kind}; {remedy}")
    if record.pop("sha256", None) != strict_json.digest(record):
        raise refused("damaged or changed, its checksum does not match")
    if record.get("version") != VERSION:
        raise refused(f"version {record.get('version')}, this program reads {VERSION}")
    try:
        return parse(record)
    except (KeyError, TypeError, ValueError) as error:
        raise refused(repr(error)) from error
