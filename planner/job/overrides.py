"""Overrides of a job's values on the command line: `uncertainty.radius_mm=15`."""

import re
from collections.abc import Iterable
from typing import Any

from planner.job.fields import shown
from runtime.shell import strict_toml
from runtime.shell.errors import UsageError

_WORD = re.compile(r"[A-Za-z][\w.-]*")


def changes_of(overrides: Iterable[str]) -> dict[str, Any]:
    """Parses texts "section.key=value" or "seed=value" to changes in the form of `Job.replaced`.

    If a key is given several times, its last value counts.

    Raises:
        UsageError: a text states no value, or is not of this form.
    """
    changes: dict[str, Any] = {}
    for override in overrides:
        name, equals, text = (part.strip() for part in override.partition("="))
        if not equals:
            raise UsageError(f"{shown(override)} states no value; write it as section.key=value")
        value = value_of(name, text)
        section, _, key = name.rpartition(".")
        table = changes.setdefault(section, {}) if section else changes
        if not isinstance(table, dict):
            raise UsageError(f"{name}: {section} is no section; write it as section.key=value")
        table.pop(key, None)  # a dict keeps the position of a key's first value
        table[key] = value
    return changes


def value_of(name: str, text: str) -> Any:
    """Parses the value of the key `name`: any TOML value, or a word without quotes.

    Raises:
        UsageError: the text is neither a value nor a word, or `name` is not a key.
    """
    if not re.fullmatch(r"(\w+\.)?\w+", name):
        raise UsageError(f"{shown(name)} is not a key of a job; write it as section.key=value")
    try:
        parsed = strict_toml.parse(f"value = {text}")
    except ValueError:
        parsed = {}
    if list(parsed) == ["value"]:
        return parsed["value"]
    if _WORD.fullmatch(text.strip()):
        return text.strip()
    remedy = "write it as in a job file, such as 12.5 or [0, 90]"
    raise UsageError(f"{name}: {shown(text)} is not a value; {remedy}")


def split(text: str) -> tuple[str, list[str]]:
    """Splits "name=value,value" into the name and the values, at commas outside brackets and quotes.

    Raises:
        UsageError: the name or a value is missing.
    """
    name, equals, rest = text.partition("=")
    name = name.strip()
    values, depth, quote = [""], 0, ""
    for letter in rest:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        else:
            depth += (letter in "[{") - (letter in "]}")
            if letter == "," and depth == 0:
                values.append("")
                continue
        values[-1] += letter
    values = [value.strip() for value in values]
    if not name or not equals or not all(values):
        raise UsageError(f"{shown(text)} states no values; write it as section.key=value,value")
    return name, values
