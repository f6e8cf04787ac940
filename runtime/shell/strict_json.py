"""A strict parser for JSON of unknown origin: limits size, nesting and digits, refuses infinite numbers."""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from runtime.shell.plain_text import nested, unprintable

MOST_LEVELS = 64
MOST_DIGITS = 19
MOST_BYTES = 4 << 20  # largest size of a file


def parse(text: str | bytes) -> Any:
    """Parses JSON; returns its value.

    Raises:
        ValueError: the text is not JSON in UTF-8, is nested too deeply, or holds half a character (a lone
            surrogate) or a number that is not finite or has too many digits. The message, such as "nested
            too deeply", completes a sentence that begins with "The text is".
    """
    try:
        text = text.decode() if isinstance(text, bytes) else text
        value = json.loads(text, parse_int=_integer, parse_float=_finite, parse_constant=_refused)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"not JSON: {error}") from None
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if any(level >= MOST_LEVELS and isinstance(item, dict | list) for level, item in nested(value)):
        raise ValueError("nested too deeply")
    if "\\u" in text:
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise ValueError("not usable: it holds half a character") from None
    return value


def load(path: Path, refused: Callable[[str], Exception], most_bytes: int = MOST_BYTES) -> Any:
    """Loads a JSON file, and returns its value.

    Args:
        path: the file.
        refused: builds the error from a message that begins with a verb, such as "cannot be read"; the
            subject is the file.
        most_bytes: size above which the file is refused.

    Raises:
        Exception: the error that `refused` builds: the file cannot be read, is too large, holds unprintable
            text, or is refused by `parse`.
    """
    return value_of(data_of(path, refused, most_bytes), refused)


def data_of(path: Path, refused: Callable[[str], Exception], most_bytes: int = MOST_BYTES) -> bytes:
    """Reads the bytes of a JSON file, for `value_of`; the arguments and the errors are those of `load`."""
    try:
        with path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise refused(f"cannot be read: {error.strerror}") from error
    if len(data) > most_bytes:
        raise refused(f"is larger than {most_bytes >> 20} MiB")
    return data


def value_of(data: bytes, refused: Callable[[str], Exception]) -> Any:
    """Parses the bytes of a JSON file, and returns its value; the errors are those of `load`."""
    try:
        value = parse(data)
    except ValueError as error:
        raise refused(f"is {error}") from error
    if (strange := unprintable(value)) is not None:
        raise refused(f"is not usable: it holds {strange}, which does not print")
    return value


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256, in hexadecimal, of a document's canonical JSON text: keys sorted, no spaces."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _integer(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise ValueError(f"not usable: it holds a number of {len(digits)} digits")
    return int(digits)


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        _refused(digits)
    return value


def _refused(word: str) -> NoReturn:
    raise ValueError(f"not usable: it holds {word}, which is no finite number")
