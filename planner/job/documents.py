"""The text of a job as nested tables, nothing checked: TOML as people write it, JSON as tables carry it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from planner.errors import InputFileError, TomlError
from runtime.shell import strict_json


def read(path: str | Path) -> str:
    """Read a job file's text.

    Raises:
        InputFileError: the file is missing, unreadable, a directory or not UTF-8.
    """
    where = str(path)
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"not UTF-8 text (byte {error.start + 1}); save the file as UTF-8"
        raise InputFileError(problem, where=where) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputFileError(f"cannot be read: {reason}; check the path", where=where) from error


def from_toml(text: str, where: str) -> dict[str, Any]:
    """Read TOML text.

    Raises:
        TomlError: not valid TOML; line and column are attributes.
    """
    try:
        return tomllib.loads(text.replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise _toml_error(error, text, where) from error


def from_json(text: str, where: str) -> dict[str, Any]:
    """Read the canonical text of a job.

    Raises:
        TomlError: not a JSON object.
    """
    try:
        document = strict_json.parse(text)
    except ValueError as error:
        raise TomlError(f"{error}; compile the job again", where=where) from error
    if not isinstance(document, dict):
        raise TomlError("not a JSON object; compile the job again", where=where)
    return document


def _toml_error(error: Exception, text: str, where: str) -> TomlError:
    """Return the parser's complaint with its line and column."""
    if isinstance(error, RecursionError):
        return TomlError("not valid TOML: nested too deeply", where=where)
    reason, _, place = str(error).partition(" (at ")
    line, column = text.count("\n") + 1, len(text) - text.rfind("\n")
    if match := re.search(r"line (\d+), column (\d+)", place):
        line, column = int(match[1]), int(match[2])
    result = TomlError(f"not valid TOML at line {line}, column {column}: {reason}", where=where)
    result.line, result.column = line, column
    return result
