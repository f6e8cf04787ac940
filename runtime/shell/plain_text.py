"""Text from files and devices: what is allowed in an answer, on a terminal, in a page or a program.

A line break in a name adds a line to an answer, an escape sequence moves a terminal's cursor, a direction
mark reverses the rest of a line. So every interface refuses them: `runtime.table` in a table and the job
inside it, `planner.job` in a job, `runtime.shell.strict_json` in files of JSON. Messages of devices, errors
and journals cannot be refused: every printed line is `cleaned`.
"""

from collections.abc import Iterator
from typing import Any

LONGEST = 80  # characters of a name
SHOWN = 40  # characters of a refused text that a message shows


def is_plain(text: str, longest: int = LONGEST) -> bool:
    """Whether a text is one line of 1 to `longest` printable characters, not all of them blank."""
    return 0 < len(text) <= longest and text.isprintable() and not text.isspace()


def unprintable(value: Any) -> str | None:
    """Finds a text in parsed JSON or TOML, key or value, that is not printable on one line.

    Returns:
        That text as `shortened` shows it; None if all texts are printable.
    """
    texts = (item for _, item in nested(value) if isinstance(item, str))
    return next((shortened(text) for text in texts if not text.isprintable()), None)


def nested(value: Any) -> Iterator[tuple[int, Any]]:
    """Yields parsed JSON or TOML and all that it holds, keys too, each with its level; without recursion."""
    waiting = [(0, value)]
    while waiting:
        level, item = waiting.pop()
        yield level, item
        if isinstance(item, dict):
            waiting += [(level + 1, inner) for inner in (*item.values(), *item)]
        elif isinstance(item, list | tuple):
            waiting += [(level + 1, inner) for inner in item]


def cleaned(text: str) -> str:
    """A text as one line, with line breaks, escape sequences and other unprintable characters escaped."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def capital(sentence: str) -> str:
    """A sentence with a capital letter at its beginning."""
    return sentence[:1].upper() + sentence[1:]


def shortened(text: str) -> str:
    """A text in quotes as ASCII, for an error's sentence; truncated if longer than `SHOWN`."""
    shown = ascii(text[:SHOWN])
    return shown if len(text) <= SHOWN and len(shown) <= SHOWN + 2 else f"{shown[:SHOWN]}..."
