"""Single values of a job replaced from the command line: `uncertainty.radius_mm=15`.

The text of a job is changed before it is checked, so that an override is refused for the same reasons, and in
the same words, as the value in the file would be.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from copy import deepcopy
from pathlib import Path
from typing import Any

from planner.errors import UsageError
from planner.job import documents, schema
from planner.job import model as job_file
from planner.job.fields import check_names, shown
from planner.job.model import Job

INSTEAD = {
    ("uncertainty", "orientation"): "orientation_halfwidth_deg",
    ("uncertainty", "orientation_halfwidth_deg"): "orientation",
}
"""Keys that state the same thing in two ways: to set one drops the other."""
DRAWN = {"part.outline_mm", "pressure.surface_file"}
"""Overrides that make a canonical job one as people write it: a part anywhere, a reference to a file."""

_WORD = re.compile(r"[A-Za-z][\w.-]*")


def job_with(source: str | Path, overrides: Iterable[tuple[str, str]] = (), where: str | None = None) -> Job:
    """Read a job with some values replaced.

    Args:
        source: a path to a job file, TOML text, or the canonical text that a table carries.
        overrides: pairs of a name, "section.key" or "seed", and a value's text, applied in this order.
        where: what errors name as the place; the path, or "job text", if None.

    Raises:
        UsageError: a name or a value's text that cannot be read.
        JobError: the job with these values is refused, as by `planner.job.model.load`.
    """
    if isinstance(source, Path):
        where, text = where or str(source), documents.read(source)
    else:
        where, text = where or "job text", source
    canonical = text.startswith("{")  # no TOML does
    document = (documents.from_json if canonical else documents.from_toml)(text, where)
    drawn = not canonical
    for name, value_text in overrides:
        document = apply(document, name, value_text, where)
        drawn = drawn or name in DRAWN
    return job_file.of_document(document, where, drawn)


def apply(document: dict[str, Any], name: str, value_text: str, where: str = "job text") -> dict[str, Any]:
    """Return a document with one value replaced; types and ranges are checked with the job as a whole.

    A new `pressure.kind` drops the keys that only the old one takes.

    Args:
        document: sections and keys, as parsed; not modified.
        name: "section.key", or a key of the top level.
        value_text: as in a job file, but for the quotes, which a single word does without.
        where: what errors name as the place.

    Raises:
        UsageError: the name or the value's text cannot be read.
        KeyNameError: there is no such section, or no such key on the top level.
    """
    value = value_of(name, value_text)
    result = deepcopy(document)
    section, _, key = name.rpartition(".")
    check_names([section or key], (*schema.FIELDS, *schema.TOP_LEVEL) if section else schema.TOP_LEVEL,
                where, "")  # fmt: skip
    table = result.setdefault(section, {}) if section else result
    if not isinstance(table, dict):
        raise UsageError(f"{name}: {section} is no section of {where}; write it as section.key=value")
    if (section, key) == ("pressure", "kind"):
        kept = {*schema.FIELDS["pressure"], *schema.PRESSURE_FIELDS.get(str(value), {})}
        table = result["pressure"] = {k: v for k, v in table.items() if k in kept}
    table.pop(INSTEAD.get((section, key), ""), None)
    table[key] = value
    return result


def value_of(name: str, text: str) -> Any:
    """Return a value from its text: anything that TOML takes, or a bare word.

    Raises:
        UsageError: it is neither; `name` says which one.
    """
    if not re.fullmatch(r"(\w+\.)?\w+", name):
        raise UsageError(f"{shown(name)} names no value of a job; write it as section.key=value")
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        parsed = {}
    if list(parsed) == ["value"]:
        return parsed["value"]
    if _WORD.fullmatch(text.strip()):
        return text.strip()
    raise UsageError(f"{name}: {shown(text)} is no value; write it as in a job file, such as 12.5 or [0, 90]")


def split(text: str) -> tuple[str, list[str]]:
    """Return the name and the values of "name=value,value": commas within brackets or quotes part nothing.

    Raises:
        UsageError: no name, or nothing where a value should be.
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
