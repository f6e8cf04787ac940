"""A strict parser for TOML of unknown origin: limits size and nesting.

`tomllib` needs time and memory quadratic in the number of dots of a key, and stack in proportion to the
nesting of a value. So both are limited before `tomllib` parses the text.
"""

import re
import tomllib
from typing import Any

MOST_BYTES = 1 << 20
MOST_LEVELS = 16

_TOKENS = re.compile(
    r"""
    \"{3} (?: [^\\] | \\. )*? \"{3} | '{3} .*? '{3}       # strings of several lines
    | " (?: [^"\\\n] | \\[^\n] )* " | ' [^'\n]* '  # strings
    | \# [^\n]*
    | [.,=\n\[\]{}]
    """,
    re.DOTALL | re.VERBOSE,
)


def parse(text: str) -> dict[str, Any]:
    """Parses TOML; returns its table.

    Raises:
        ValueError: the text is not TOML, is too large or is nested too deeply. An error of `tomllib` states
            line and column.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 20} MiB")
    if _levels(text) > MOST_LEVELS:
        raise ValueError("nested too deeply")
    return tomllib.loads(text)


def _levels(text: str) -> int:
    """The depth of a TOML text: the most brackets that are open at once, or the most dots in a key."""
    most = depth = dots = 0
    for match in _TOKENS.finditer(text):
        token = match[0]
        if token == ".":
            dots += 1
        elif token in "[{":
            depth += 1
        elif token in "]}":
            depth = max(depth - 1, 0)
        if token in ",=\n":
            dots = 0
        most = max(most, depth, dots)
    return most
