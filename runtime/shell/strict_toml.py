"""A strict parser for TOML of unknown origin: limited size and nesting.

`tomllib` takes time and memory quadratic in the depth of a key, and stack linear in the depth of a value.
Both depths are bounded before parsing.
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
    """Parses TOML text of limited size and nesting.

    Raises:
        ValueError: the text is not such TOML; errors of `tomllib` have line and column.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 20} MiB")
    if _levels(text) > MOST_LEVELS:
        raise ValueError("nested too deeply")
    return tomllib.loads(text)


def _levels(text: str) -> int:
    """The largest number of open brackets, or of dots within one key."""
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
