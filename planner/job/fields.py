"""Fields of a job file as data: each has a type, a range and a default.

`read_section` turns one TOML table into checked values. The method `read` of a field returns a valid value
and raises `InputError` for any other; the error states what is wrong, and the caller adds the place.
"""

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from planner.arrays import Array
from planner.errors import KeyNameError
from runtime.shell.errors import InputError
from runtime.shell.plain_text import is_plain

MOST_POSES = 100
REQUIRED: Final = object()  # Default of a required field


@dataclass(frozen=True, slots=True)
class Number:
    """A finite number from `low` to `high`, but not `low` itself if `above` is set, nor `high` if `below`."""

    low: float
    high: float
    default: Any = REQUIRED
    above: bool = False
    below: bool = False

    def read(self, value: Any) -> float:
        """Returns the value as float if it is valid; raises `InputError` otherwise."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"must be a number, not {shown(value)}")
        fits_low = value > self.low if self.above else value >= self.low
        fits_high = value < self.high if self.below else value <= self.high
        if not (fits_low and fits_high):  # negated, so that nan is refused
            low = f"{'above' if self.above else 'at least'} {self.low:g}"
            high = f"{'below' if self.below else 'at most'} {self.high:g}"
            raise InputError(f"must be {low} and {high}, not {shown(value)}")
        return float(value) + 0.0  # no -0.0


@dataclass(frozen=True, slots=True)
class Integer:
    """A whole number from `low` to `high`; the text `word`, unless empty, is also valid."""

    low: int
    high: int
    default: Any = REQUIRED
    word: str = ""

    def read(self, value: Any) -> Any:
        """Returns the value if it is valid; raises `InputError` otherwise."""
        advice = f'; or write "{self.word}"' if self.word else ""
        if self.word and value == self.word:
            return value
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"must be a whole number, not {shown(value)}{advice}")
        if not self.low <= value <= self.high:
            raise InputError(f"must be from {self.low} to {self.high}, not {shown(value)}{advice}")
        return value


@dataclass(frozen=True, slots=True)
class Flag:
    """A boolean."""

    default: Any = REQUIRED

    def read(self, value: Any) -> bool:
        """Returns the value if it is valid; raises `InputError` otherwise."""
        if not isinstance(value, bool):
            raise InputError(f"must be true or false, not {shown(value)}")
        return value


@dataclass(frozen=True, slots=True)
class Text:
    """A short printable line, or one of `choices` if given."""

    choices: tuple[str, ...] = ()
    default: Any = REQUIRED
    longest: int = 80

    def read(self, value: Any) -> str:
        """Returns the value if it is valid; raises `InputError` otherwise."""
        if not isinstance(value, str):
            raise InputError(f"must be a text in quotes, not {shown(value)}")
        if self.choices and value not in self.choices:
            wanted = f"must be {one_of(self.choices)}, not {shown(value)}"
            raise InputError(wanted + _meant(value, self.choices))
        if not is_plain(value, self.longest):
            wanted = f"one line of 1 to {self.longest} printable characters"
            raise InputError(f"must be {wanted}, not {shown(value)}")
        return value


@dataclass(frozen=True, slots=True)
class Numbers:
    """A list of `least` to `most` entries.

    An entry is a number in the range of `item`. If `columns` is not 0, an entry is a row of `columns` such
    numbers.
    """

    item: Number
    columns: int = 0
    least: int = 1
    most: int = 10_000
    default: Any = REQUIRED
    plain: bool = False  # whether the list is read as a tuple, instead of an array

    def read(self, value: Any) -> Array | tuple[Any, ...]:
        """Returns a valid list as a read-only array, (K,) or (K, columns); if `plain` is set, as a tuple.

        Raises:
            InputError: the list, or an entry, is not valid.
        """
        if not isinstance(value, list | tuple):
            raise InputError(f"must be a list {self._shape()}, not {shown(value)}")
        if not self.least <= len(value) <= self.most:
            count = str(self.least) if self.least == self.most else f"{self.least} to {self.most}"
            raise InputError(f"must have {count} entries, not {len(value)}")
        rows = tuple(self._entry(index, entry) for index, entry in enumerate(value))
        if self.plain:
            return rows
        array = np.array(rows, dtype=np.float64)
        array.setflags(write=False)
        return array

    def _entry(self, index: int, entry: Any) -> float | tuple[float, ...]:
        if self.columns and (not isinstance(entry, list | tuple) or len(entry) != self.columns):
            raise InputError(f"must be a list {self._shape()}; entry {index + 1} is {shown(entry)}")
        try:
            if self.columns:
                return tuple(self.item.read(number) for number in entry)
            return self.item.read(entry)
        except InputError as error:
            raise InputError(f"entry {index + 1} {error}") from None

    def _shape(self) -> str:
        if not self.columns:
            return "of numbers"
        return "of [x, y] pairs" if self.columns == 2 else f"of rows of {self.columns} numbers"


@dataclass(frozen=True, slots=True)
class Poses:
    """Poses [x, y, angle] by name [mm, mm, deg]; each number is in the range of `item`."""

    item: Number
    default: Any = REQUIRED

    def read(self, value: Any) -> dict[str, list[float]]:
        """Returns the poses, sorted by name, if all are valid; raises `InputError` otherwise."""
        if not isinstance(value, dict) or not 1 <= len(value) <= MOST_POSES:
            wanted = f"1 to {MOST_POSES} lines name = [x, y, angle]"
            raise InputError(f"must be {wanted}, not {shown(value)}")
        row = Numbers(self.item, least=3, most=3, plain=True)
        result = {}
        for name in sorted(value):
            try:
                result[Text().read(name)] = list(row.read(value[name]))
            except InputError as error:
                raise InputError(f"{shown(name)} {error}") from None
        return result


Field: TypeAlias = Number | Integer | Flag | Text | Numbers | Poses


def read_section(table: Any, fields: Mapping[str, Field], section: str) -> dict[str, Any]:
    """Checks the keys and values of one section, or of the top level if `section` is "".

    Returns:
        The values by key, with defaults; a default of None is not checked.

    Raises:
        InputError: the table is not a section, or a value is of the wrong type or out of range.
        KeyNameError: a key is unknown or missing.
    """
    if not isinstance(table, dict):
        problem = f"must be a section of keys and values, not {shown(table)}"
        raise InputError(problem, section=section)
    check_names(table, fields, section)
    required = [key for key, field in fields.items() if field.default is REQUIRED]
    missing = [key for key in required if key not in table]
    if missing:
        raise missing_names(missing, section)
    return {key: _read_field(table, key, field, section) for key, field in fields.items()}


def check_names(names: Iterable[str], valid: Iterable[str], section: str) -> None:
    """Checks the names of keys, or of keys and sections if `section` is "".

    Raises:
        KeyNameError: a name is not valid; the message proposes the nearest valid name.
    """
    valid = tuple(valid)
    for name in names:
        if name not in valid:
            advice = _meant(name, valid) or f"; valid are {', '.join(valid)}"
            what = "key" if section else "key or section"
            raise KeyNameError(f"unknown {what} {shown(name)}{advice}", section=section)


def missing_names(names: list[str], section: str) -> KeyNameError:
    """The error about missing required keys, or missing sections where `section` is ""."""
    plural = len(names) > 1
    what = ("key" if section else "section") + ("s" if plural else "")
    problem = f"missing {what} {', '.join(names)}; add {'them' if plural else 'it'}"
    return KeyNameError(problem, section=section)


def shown(value: Any) -> str:
    """Abbreviates a value to one short line for an error message."""
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
    """Joins words as in 'a, b or c', each in double quotes."""
    quoted = [f'"{word}"' for word in words]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _read_field(table: Mapping[str, Any], key: str, field: Field, section: str) -> Any:
    value = table.get(key, field.default)
    if value is None and key not in table:
        return None
    try:
        return field.read(value)
    except InputError as error:
        raise error.at(section=section, key=key) from None


def _meant(name: str, valid: Iterable[str]) -> str:
    nearest = difflib.get_close_matches(name.lower(), tuple(valid), n=1, cutoff=0.5)
    return f'; did you mean "{nearest[0]}"?' if nearest else ""
