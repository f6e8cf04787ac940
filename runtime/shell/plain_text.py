"""Text that came from a file or a device: what may stand in an answer, on a terminal, in a page or a program.

A name with a line break puts a second line into an answer, an escape sequence moves a terminal's cursor, a
mark of direction turns the rest of a line round. So every border refuses them: `runtime.table` in a table and
the job inside it, `planner.job` in a job, `runtime.shell.strict_json` in files of JSON. What devices, errors
and journals say cannot be refused: whatever prints a line prints it `cleaned`.
"""

from typing import Any

LONGEST = 80  # of a name


def is_plain(text: str, longest: int = LONGEST) -> bool:
    """Whether a text is one line of 1 to `longest` printable characters, not all of them blank."""
    return 0 < len(text) <= longest and text.isprintable() and not text.isspace()


def unprintable(value: Any) -> str | None:
    """The first text of parsed JSON or TOML, key or value, that does not print within a line; None: all do.

    It comes as ASCII, its strange characters escaped.
    """
    waiting = [value]
    while waiting:
        item = waiting.pop()
        if isinstance(item, str):
            if not item.isprintable():
                return shortened(item)
        elif isinstance(item, dict):
            waiting += [*item.values(), *item]
        elif isinstance(item, list | tuple):
            waiting += item
    return None


def cleaned(text: str) -> str:
    """A text as one line: line breaks, escape sequences and all else that does not print, escaped."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def shortened(text: str, longest: int = 40) -> str:
    """A text in quotes as ASCII, for an error's sentence; cut where it is long."""
    shown = ascii(text[:longest])
    return shown if len(text) <= longest and len(shown) <= longest + 2 else f"{shown[:longest]}..."
