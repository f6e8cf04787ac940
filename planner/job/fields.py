"""Fields of a job file as data: what each may hold, read and checked in one place.

A field object knows its type, range and default; `read_section` turns one TOML table into checked values.
Arrays come out as read-only float arrays.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from planner.arrays import Array
from planner.errors import KeyNameError, ValueRangeError

REQUIRED: Final = object()
"""Default of a field that must be stated."""


class RefusedError(ValueError):
    """A value does not fit its field; the text says why, the caller knows where."""


class Field(Protocol):
    """What `read_section` needs of a field."""

    @property
    def default(self) -> Any:
        """The value in the form of the file, or `REQUIRED`."""

    def read(self, value: Any) -> Any:
        """Return the checked value.

        Raises:
            RefusedError: wrong type or out of range.
        """


@dataclass(frozen=True, slots=True)
class Number:
    """A finite number from `low` to `high`; `above` and `below` exclude the bound itself."""

    low: float
    high: float
    default: Any = REQUIRED
    above: bool = False
    below: bool = False

    def read(self, value: Any) -> float:
        """Return the value as float."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise RefusedError(f"must be a number, not {shown(value)}")
        if not (self._fits_low(value) and self._fits_high(value)):  # so that nan does not fit
            raise RefusedError(f"must be {self._range()}, not {shown(value)}")
        return float(value) + 0.0  # no -0.0

    def _fits_low(self, value: float) -> bool:
        return value > self.low if self.above else value >= self.low

    def _fits_high(self, value: float) -> bool:
        return value < self.high if self.below else value <= self.high

    def _range(self) -> str:
        low = f"{'above' if self.above else 'at least'} {self.low:g}"
        return f"{low} and {'below' if self.below else 'at most'} {self.high:g}"


@dataclass(frozen=True, slots=True)
class Integer:
    """A whole number from `low` to `high`."""

    low: int
    high: int
    default: Any = REQUIRED

    def read(self, value: Any) -> int:
        """Return the value."""
        if isinstance(value, bool) or not isinstance(value, int):
            raise RefusedError(f"must be a whole number, not {shown(value)}")
        if not self.low <= value <= self.high:
            raise RefusedError(f"must be from {self.low} to {self.high}, not {shown(value)}")
        return value


@dataclass(frozen=True, slots=True)
class Text:
    """A short printable line, or one of a few words if `choices` are given."""

    choices: tuple[str, ...] = ()
    default: Any = REQUIRED
    longest = 80

    def read(self, value: Any) -> str:
        """Return the value."""
        if not isinstance(value, str):
            raise RefusedError(f"must be a text in quotes, not {shown(value)}")
        if self.choices and value not in self.choices:
            raise RefusedError(
                f"must be {one_of(self.choices)}, not {shown(value)}{_meant(value, self.choices)}"
            )
        if not value.strip() or not value.isprintable() or len(value) > self.longest:
            raise RefusedError(
                f"must be one line of 1 to {self.longest} printable characters, not {shown(value)}"
            )
        return value


@dataclass(frozen=True, slots=True)
class Either:
    """A word, or else whatever another field takes."""

    word: str
    other: Field
    default: Any = REQUIRED

    def read(self, value: Any) -> Any:
        """Return the word or the other field's value."""
        if value == self.word:
            return value
        try:
            return self.other.read(value)
        except RefusedError as error:
            raise RefusedError(f'{error}; or write "{self.word}"') from None


@dataclass(frozen=True, slots=True)
class Numbers:
    """A list of numbers, or of rows of `columns` numbers, each within `item`."""

    item: Number
    columns: int = 0
    least: int = 1
    most: int = 10_000
    default: Any = REQUIRED

    def read(self, value: Any) -> Array:
        """Return a read-only array, (K,) or (K, columns)."""
        if not isinstance(value, list | tuple):
            raise RefusedError(f"must be a list {self._shape()}, not {shown(value)}")
        if not self.least <= len(value) <= self.most:
            count = str(self.least) if self.least == self.most else f"{self.least} to {self.most}"
            raise RefusedError(f"must have {count} entries, not {len(value)}")
        array = np.array([self._entry(index, entry) for index, entry in enumerate(value)], dtype=np.float64)
        array.setflags(write=False)
        return array

    def _entry(self, index: int, entry: Any) -> float | list[float]:
        if self.columns and (not isinstance(entry, list | tuple) or len(entry) != self.columns):
            raise RefusedError(f"must be a list {self._shape()}; entry {index + 1} is {shown(entry)}")
        try:
            return [self.item.read(number) for number in entry] if self.columns else self.item.read(entry)
        except RefusedError as error:
            raise RefusedError(f"entry {index + 1} {error}") from None

    def _shape(self) -> str:
        if not self.columns:
            return "of numbers"
        return "of [x, y] pairs" if self.columns == 2 else f"of rows of {self.columns} numbers"


def read_section(table: Any, fields: Mapping[str, Field], where: str, section: str) -> dict[str, Any]:
    """Check one section against its fields.

    Args:
        table: what the file holds under the section's name.
        fields: the fields by key.
        where: the file, for errors.
        section: the section's name, for errors; "" is the top level.

    Returns:
        A value for each field, stated or default. A default of None stays None.

    Raises:
        ValueRangeError: not a section at all, or a value of the wrong type or out of range.
        KeyNameError: a key that is not known, or keys that are missing.
    """
    if not isinstance(table, dict):
        problem = f"must be a section of keys and values, not {shown(table)}"
        raise ValueRangeError(problem, where=where, section=section, value=table)
    check_names(table, fields, where, section)
    missing = [key for key, field in fields.items() if key not in table and field.default is REQUIRED]
    if missing:
        raise missing_names(missing, where, section)
    return {key: _read_field(table, key, field, where, section) for key, field in fields.items()}


def check_names(found: Iterable[str], valid: Iterable[str], where: str, section: str) -> None:
    """Refuse the first name that is not valid, with the nearest valid one.

    Raises:
        KeyNameError: a name is not known.
    """
    valid = tuple(valid)
    for name in found:
        if name not in valid:
            advice = _meant(name, valid) or f"; valid are {', '.join(valid)}"
            problem = f"unknown {'key' if section else 'key or section'} {shown(name)}{advice}"
            error = KeyNameError(problem, where=where, section=section, value=name)
            error.names = (name,)
            raise error


def missing_names(names: list[str], where: str, section: str) -> KeyNameError:
    """Return the error that asks for keys or sections which must be stated."""
    plural = len(names) > 1
    what = ("key" if section else "section") + ("s" if plural else "")
    problem = f"missing {what} {', '.join(names)}; add {'them' if plural else 'it'}"
    error = KeyNameError(problem, where=where, section=section)
    error.names = tuple(names)
    return error


def shown(value: Any) -> str:
    """Return a value as one short line for an error message."""
    if isinstance(value, dict):
        return "a section"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    try:
        text = ascii(value)
    except ValueError:  # an integer of thousands of digits
        return "a huge number"
    return text if len(text) <= 40 else text[:37] + "..."


def one_of(words: Iterable[str]) -> str:
    """Return words as in 'a, b or c', each in double quotes."""
    quoted = [f'"{word}"' for word in words]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _read_field(table: Mapping[str, Any], key: str, field: Field, where: str, section: str) -> Any:
    value = table.get(key, field.default)
    if value is None and key not in table:
        return None
    try:
        return field.read(value)
    except RefusedError as error:
        raise ValueRangeError(str(error), where=where, section=section, key=key, value=value) from None


def _meant(name: str, valid: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name.lower(), tuple(valid), n=1, cutoff=0.5)
    return f'; did you mean "{nearest[0]}"?' if nearest else ""
