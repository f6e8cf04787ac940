"""Parses the text of a job to nested dictionaries: TOML from people, or JSON from a decision table."""

import math
import re
import tomllib
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

from planner.errors import KeyNameError
from planner.job import hypotheses, schema
from planner.job.fields import Field, check_names, missing_names, read_section, shown
from planner.job.schema import FIELDS, PRESSURE_FIELDS, TOP_LEVEL
from runtime.shell import strict_json, strict_toml
from runtime.shell.errors import InputError, UsageError

INSTEAD = {
    "orientation": "orientation_halfwidth_deg",
    "orientation_halfwidth_deg": "orientation",
}  # Keys that state the same value in two ways: setting one drops the other
MOST_BYTES = 64 << 20  # largest size of a file that a person wrote
PAPER_PARTICLES = 6_000  # default number of particles of the paper's methods (paper, VII)


def read(path: str | Path, advice: str = "check the path") -> str:
    """Returns the text of a job file, or of another UTF-8 file that a person wrote.

    Raises:
        InputError: the file is not UTF-8. Or it is missing, unreadable, a directory or too large; then the
            message ends with `advice`.
    """
    where = str(path)
    try:
        with Path(path).open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"not UTF-8 text (byte {error.start + 1}); save the file as UTF-8"
        raise InputError(problem, where=where) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(f"cannot be read: {reason}; {advice}", where=where) from error
    if len(data) > MOST_BYTES:
        raise InputError(f"larger than {MOST_BYTES >> 20} MiB; {advice}", where=where)
    return text


def from_toml(text: str, where: str) -> dict[str, Any]:
    """Parses TOML text; returns the document as nested dictionaries.

    Raises:
        InputError: the text is not valid TOML; the message names line and column.
    """
    try:
        return strict_toml.parse(text.replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).partition(" (at ")
        line, column = text.count("\n") + 1, len(text) - text.rfind("\n")
        if match := re.search(r"line (\d+), column (\d+)", place):
            line, column = int(match[1]), int(match[2])
        problem = f"not valid TOML at line {line}, column {column}: {reason}"
        raise InputError(problem, where=where) from error
    except ValueError as error:
        raise InputError(f"not valid TOML: {error}", where=where) from error


def from_json(text: str, where: str) -> dict[str, Any]:
    """Parses the canonical text of a job; returns the document as nested dictionaries.

    Raises:
        InputError: the text is not a JSON object.
    """
    try:
        document = strict_json.parse(text)
    except ValueError as error:
        raise InputError(f"{error}; compile the job again", where=where) from error
    if not isinstance(document, dict):
        raise InputError("not a JSON object; compile the job again", where=where)
    return document


def checked(document: Mapping[str, Any]) -> dict[str, Any]:
    """Checks each key of a parsed job file alone; `checks.conflicts` checks the values against each other.

    Returns:
        The values, with defaults, by section name and key. Section "" is the top level. A section of
        `schema.ABSENT_SECTIONS` that is missing is None.

    Raises:
        KeyNameError: a key or section is unknown or missing.
        InputError: a value is of the wrong type or out of its range.
    """
    _check_strays(document, (*FIELDS, *TOP_LEVEL), "")
    check_names(document, (*FIELDS, *TOP_LEVEL), "")
    required = [name for name in FIELDS if name not in schema.OPTIONAL_SECTIONS]
    missing = [name for name in required if name not in document]
    if missing:
        raise missing_names(missing, "")
    top = {key: value for key, value in document.items() if key in TOP_LEVEL}
    values: dict[str, Any] = {"": read_section(top, TOP_LEVEL, "")}
    for name, section_fields in FIELDS.items():
        if name in schema.ABSENT_SECTIONS and name not in document:
            values[name] = None
            continue
        table = document.get(name, {})
        if name == "pressure":
            section_fields = _pressure_fields(table)
        _check_strays(table, section_fields, name)
        values[name] = read_section(table, section_fields, name)
    _fill_orientation(values["uncertainty"])
    search = values["search"]
    if search["method"] != "closed-loop" and "particles" not in document.get("search", {}):
        search["particles"] = PAPER_PARTICLES
    return values


def changed(document: Mapping[str, Any], changes: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Returns a copy of a job's document with values replaced; the new values still have to be `checked`.

    Args:
        document: the document, which stays unchanged.
        changes: maps a top-level key to its new value, and a section to its new values by key. The new
            values also replace those of each `[[hypothesis]]` or foreign part that states this section.
        where: name of the document in error messages.

    Raises:
        UsageError: `changes` treat a key of the top level as a section.
        KeyNameError: the section or the top-level key is unknown.
        InputError: a change concerns [part], but each hypothesis has its own part.
    """
    result = dict(document)
    for name, values in changes.items():
        is_section = isinstance(values, Mapping)
        try:
            check_names([name], (*FIELDS, *TOP_LEVEL) if is_section else TOP_LEVEL, "")
        except InputError as error:
            raise error.at(where) from None
        if is_section and name == "part" and hypotheses.KEY in result:
            problem = "is stated by each [[hypothesis]]; change it in these"
            raise InputError(problem, where=where, section="part")
        if is_section and name != "part":
            for key in {hypotheses.KEY, hypotheses.FOREIGN} & result.keys():
                result[key] = _entries_with(result[key], name, values)
        table = result.get(name, {})
        if is_section and not isinstance(table, dict):
            problem = f"{name} is no section of {where}, but one value"
            raise UsageError(f"{problem}; write it as {name}=value")
        result[name] = _with_values(table, name, values) if is_section else values
    return result


def _entries_with(entries: Any, section: str, values: Mapping[str, Any]) -> Any:
    """Replaces values of a section in the entries of a list; entries without this section stay the same."""
    if not isinstance(entries, list):
        return entries  # an invalid list is refused later
    return [
        {**entry, section: _with_values(entry[section], section, values)}
        if isinstance(entry, dict) and isinstance(entry.get(section), dict)
        else entry
        for entry in entries
    ]


def _with_values(table: dict[str, Any], section: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a copy of a section with values replaced, without the keys that contradict the new values."""
    table = dict(table)
    for key, value in values.items():
        if (section, key) == ("pressure", "kind"):
            kept = {*FIELDS["pressure"], *PRESSURE_FIELDS.get(str(value), {})}
            table = {k: v for k, v in table.items() if k in kept}
        table.pop(INSTEAD.get(key, ""), None)
        table[key] = value
    return table


def _pressure_fields(table: Any) -> Mapping[str, Field]:
    common = FIELDS["pressure"]
    kind_only = {"kind": table["kind"]} if isinstance(table, dict) and "kind" in table else {}
    kind = read_section(kind_only, common, "pressure")["kind"]
    return {**common, **PRESSURE_FIELDS.get(kind, {})}


def _check_strays(table: Any, valid: Container[str], section: str) -> None:
    """Raises `KeyNameError` for a key that is valid in another place only; the error names the place."""
    if not isinstance(table, dict):
        return
    homes: dict[str, str] = {}
    for name, home in FIELDS.items():
        homes |= dict.fromkeys(home, f"belongs in [{name}]; move it there")
    for kind, home in PRESSURE_FIELDS.items():
        goes = f'goes with kind = "{kind}" in [pressure]'
        homes |= dict.fromkeys(home, f"{goes}; change the kind or drop the key")
    homes |= dict.fromkeys(TOP_LEVEL, "belongs on top, before the first section; move it there")
    homes |= schema.FORMER.get(section, {})
    for key in table:
        if key in homes and key not in valid:
            raise KeyNameError(f"key {shown(key)} {homes[key]}", section=section)


def _fill_orientation(uncertainty: dict[str, Any]) -> None:
    """Converts an orientation that is "unknown" to a half-width of 180 deg (in place)."""
    unknown = uncertainty.pop("orientation") is not None
    stated = uncertainty["orientation_halfwidth_deg"] is not None
    choice = 'orientation = "unknown" or orientation_halfwidth_deg'
    if not unknown and not stated:
        raise KeyNameError(f"missing key orientation; state {choice}", section="uncertainty")
    if unknown and stated:
        raise InputError(f"state {choice}, not both", section="uncertainty", key="orientation")
    if unknown:
        uncertainty["orientation_halfwidth_deg"] = math.degrees(math.pi)
