"""Reads the job inside a table: its sections, numbers and outlines, any of which may be missing.

All functions raise `TableError` for a value of a wrong type.
"""

import hashlib
from collections.abc import Mapping
from typing import Any

from runtime.errors import TableError
from runtime.shell import strict_json
from runtime.shell.plain_text import unprintable
from runtime.table.geometry import Outline
from runtime.table.model import Table

Section = Mapping[str, Any]


def job_of(table: Table) -> dict[str, Any] | None:
    """The job inside a table, None where it was stripped.

    Raises:
        TableError: the text does not match the job's digest, or is not a valid JSON object.
    """
    if table.job is None:
        return None
    try:
        if hashlib.sha256(table.job.encode()).digest() != table.job_digest:
            raise TableError(
                "the embedded job is not the one the table was made from; recompile it"
            )
        job = strict_json.parse(table.job)
    except ValueError as error:
        raise TableError(f"the embedded job is {error}; recompile it") from None
    if not isinstance(job, dict):
        raise TableError("the embedded job is no JSON object; recompile it")
    if (text := unprintable(job)) is not None:
        raise TableError(f"the embedded job holds {text}, which does not print; recompile it")
    return job


def section(job: Section, name: str) -> Section:
    """Returns a section of a job; empty if the job lacks the section."""
    result = job.get(name, {})
    if not isinstance(result, dict):
        raise _refusal(name, "is no section")
    return result


def parts_of(job: Section) -> list[Section]:
    """The parts that a job states, each as a dictionary with the sections of that part.

    These are the job's hypotheses or, for a single part, the job itself. Empty where the job states no part.
    """
    listed = job.get("hypothesis") or ([job] if "part" in job else [])
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise _refusal("hypothesis", "is no list of parts")
    return listed


def number(table: Section, key: str) -> float | None:
    """Returns the number under a key of a section; None if it is missing."""
    value = table.get(key)
    return None if value is None else _number(value, key)


def numbers(table: Section, *keys: str) -> list[float]:
    """All numbers under the given keys of a section; a key has one number or a list, or is missing."""
    results: list[float] = []
    for key in keys:
        value = table.get(key)
        values = value if isinstance(value, list) else [] if value is None else [value]
        results += [_number(item, key) for item in values]
    return results


def points(table: Section, key: str) -> Outline:
    """Returns the points [x, y] under a key of a section; empty if it is missing."""
    rows = table.get(key)
    if rows is None:
        return []
    if not isinstance(rows, list) or not all(
        isinstance(row, list) and len(row) == 2 for row in rows
    ):
        raise _refusal(key, "is no list of points")
    return [(_number(x, key), _number(y, key)) for x, y in rows]


def _number(value: object, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _refusal(key, "is no number")
    return float(value)


def _refusal(name: str, problem: str) -> TableError:
    return TableError(f"{name} of the embedded job {problem}; recompile it")
