"""A strict parser for JSON of unknown origin: finite numbers, short integers, limited nesting."""

import json
import math
from typing import Any, NoReturn

MOST_LEVELS = 64
MOST_DIGITS = 19


def parse(text: str | bytes) -> Any:
    """Read JSON (UTF-8) whose numbers are finite, its integers short, and which is not nested deeply.

    Raises:
        ValueError: it is no such JSON; the sentence says why, and reads on after "is ".
    """
    try:
        text = text.decode() if isinstance(text, bytes) else text
        value = json.loads(text, parse_int=_integer, parse_float=_finite, parse_constant=_refused)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"not JSON: {error}") from None
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if _is_deep(value):
        raise ValueError("nested too deeply")
    if "\\u" in text:
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise ValueError("not usable: it holds half a character") from None
    return value


def _is_deep(value: Any) -> bool:
    """Whether it has more than `MOST_LEVELS` levels, found without recursion."""
    level = [value]
    for _ in range(MOST_LEVELS):
        inner = [list(item.values()) if isinstance(item, dict) else item for item in level]
        level = [item for items in inner if isinstance(items, list) for item in items]
    return any(isinstance(item, dict | list) for item in level)


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
