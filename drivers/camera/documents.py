"""Readable files with a checksum: JSON whose last key, `sha256`, is the digest of all before it.

A file changed by hand, cut short or written for something else is refused with a sentence that says so.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.files import writing

VERSION = 1
T = TypeVar("T")


def save(path: Path, kind: str, body: Mapping[str, Any]) -> None:
    """Write a file, whole or not at all.

    Args:
        path: where.
        kind: what it is about, `read`'s key.
        body: what JSON can hold.

    Raises:
        OutputError: it cannot be written.
    """
    document = {"kind": kind, "version": VERSION, **body}
    signed = {**document, "sha256": strict_json.digest(document)}
    with writing(path) as draft:
        draft.write_text(json.dumps(signed, indent=1, allow_nan=False) + "\n", encoding="ascii")


def read(path: Path, kind: str, remedy: str, parse: Callable[[dict[str, Any]], T]) -> T:
    """Read a file of the kind, its checksum and version verified.

    Args:
        path: where.
        kind: what it has to be about.
        remedy: how such a file is made, for the sentence.
        parse: makes of its body what it describes; KeyError, TypeError or ValueError where it cannot.

    Raises:
        InputError: it cannot be read, is of another kind, or was changed.
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
