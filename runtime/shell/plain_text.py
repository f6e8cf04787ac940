"""Keeps unprintable characters of files and devices out of answers, terminals, pages and programs.

A line break in a name would add a line to an answer, an escape sequence would move a terminal's cursor, and a
direction mark would reverse the rest of a line. So such characters are refused in tables (`runtime.table`),
jobs (`planner.job`) and files of JSON (`runtime.shell.strict_json`). Messages of devices, errors and journals
cannot be refused; in them `cleaned` escapes the characters when they are printed.
"""

from collections.abc import Iterator
from typing import Any

LONGEST = 80  # characters of a name
SHOWN = 40  # characters of a refused text that a message shows


def is_plain(text: str, longest: int = LONGEST) -> bool:
    """Whether a text is one line of 1 to `longest` printable characters, not all of them blank."""
    return 0 < len(text) <= longest and text.isprintable() and not text.isspace()


def unprintable(value: Any) -> str | None:
    """Finds a key or a text in parsed JSON or TOML that is not printable on one line.

    Returns:
        The first such text, as `shortened` shows it; None if all texts are printable.
    """
    texts = (item for _, item in nested(value) if isinstance(item, str))
    return next((shortened(text) for text in texts if not text.isprintable()), None)


def nested(value: Any) -> Iterator[tuple[int, Any]]:
    """Yields a value of parsed JSON or TOML and everything inside it, keys too, as pairs (level, value).

    The level is the depth of nesting; the outermost value has level 0. No nesting is too deep, since the
    function uses no recursion.
    """
    waiting = [(0, value)]
    while waiting:
        level, item = waiting.pop()
        yield level, item
        if isinstance(item, dict):
            waiting += [(level + 1, inner) for inner in (*item.values(), *item)]
        elif isinstance(item, list | tuple):
            waiting += [(level + 1, inner) for inner in item]


def cleaned(text: str) -> str:
    """Makes a text one printable line: escapes line breaks and other unprintable characters."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def capital(sentence: str) -> str:
    """Returns a sentence with a capital first letter."""
    return sentence[:1].upper() + sentence[1:]


def shortened(text: str) -> str:
    """Writes a text in quotes and in ASCII, for an error message; cuts a text longer than `SHOWN`."""
    shown = ascii(text[:SHOWN])
    return shown if len(text) <= SHOWN and len(shown) <= SHOWN + 2 else f"{shown[:SHOWN]}..."
