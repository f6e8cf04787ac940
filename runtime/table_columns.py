"""The building blocks of the table's bytes: strict msgpack, and columns of small integers as LEB128 bytes.

Format 2 packs a column by Huffman's code (`packed`, `unpacked`), format 1 keeps its bytes as they are.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TypeVar

import msgpack  # type: ignore[import-untyped]

from runtime.errors import TableError
from runtime.table_deflate import deflate, inflate

MAX_TEXT_BYTES = 2 << 20
MAX_BINARY_BYTES = 4 << 20
MAX_ARRAY_LENGTH = 64
# Five groups of seven bits: more than any field needs, and nothing a hostile file could grow.
MAX_VALUE = (1 << 35) - 1
MAX_VALUE_BYTES = 5
NEEDLESS = re.compile(rb"[\x80-\xff]\x00")  # a last group of zeros

Kind = TypeVar("Kind")


def unpack(data: bytes, name: str) -> object:
    """Decode one msgpack value without maps and extensions, arrays as tuples.

    Args:
        data: the bytes, nothing before or after the value.
        name: what they are, for the error.

    Raises:
        TableError: cut short, followed by more, or larger than a table's parts may be.
    """
    try:
        value: object = msgpack.unpackb(
            data,
            use_list=False,
            max_str_len=MAX_TEXT_BYTES,
            max_bin_len=MAX_BINARY_BYTES,
            max_array_len=MAX_ARRAY_LENGTH,
            max_map_len=0,
            max_ext_len=0,
        )
    except msgpack.ExtraData:
        raise TableError(f"bytes follow the end of {name}; copy the file again or recompile it") from None
    except (ValueError, msgpack.UnpackException) as error:
        reason = f"{name} is damaged or cut short ({error}); copy the file again or recompile it"
        raise TableError(reason) from None
    return value


def array(value: object, name: str, length: int) -> tuple[object, ...]:
    """`value` as a tuple of the given length.

    Raises:
        TableError: it is none.
    """
    if not isinstance(value, tuple) or len(value) != length:
        raise TableError(f"{name} is not an array of {length}")
    return value


def integers(value: object, name: str, length: int) -> tuple[int, ...]:
    """`value` as a tuple of that many integers; a truth value is none.

    Raises:
        TableError: it is none.
    """
    return tuple(typed(item, int, name) for item in array(value, name, length))


def typed(value: object, kind: type[Kind], name: str) -> Kind:
    """`value`, which must be exactly of the given type.

    Raises:
        TableError: it is not.
    """
    if type(value) is not kind:
        raise TableError(f"{name} holds {type(value).__name__} where {kind.__name__} belongs")
    return value


def column(values: Iterable[int]) -> bytes:
    """Non-negative integers as LEB128: seven bits a byte, lowest first, the top bit set where more follow.

    Raises:
        TableError: a value is negative or above `MAX_VALUE`.
    """
    values = list(values)
    if not values or (min(values) >= 0 and max(values) < 0x80):
        return bytes(values)
    out = bytearray()
    for value in values:
        if not 0 <= value <= MAX_VALUE:
            raise TableError(f"{value} does not fit a table's column, which holds 0..{MAX_VALUE}")
        while value > 0x7F:
            out.append(value & 0x7F | 0x80)
            value >>= 7
        out.append(value)
    return bytes(out)


def values(data: object, name: str, most: int) -> list[int]:
    """The integers of a column.

    Args:
        data: what stands in the payload.
        name: the column's name, for the error.
        most: how many integers it may hold; refused before they are decoded.

    Raises:
        TableError: not bytes, too many, or a last integer that is cut short or too long.
    """
    raw = typed(data, bytes, name)
    if len(raw) > MAX_VALUE_BYTES * most:
        raise TableError(f"the column {name} is longer than any table needs")
    out = list(raw) if raw.isascii() else _long_values(raw, name)
    if len(out) > most:
        raise TableError(f"the column {name} holds {len(out)} integers, allowed are {most}")
    return out


def _long_values(raw: bytes, name: str) -> list[int]:
    out: list[int] = []
    value = shift = 0
    for byte in raw:
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            out.append(value)
            value = shift = 0
        elif (shift := shift + 7) > 28:
            raise TableError(f"the column {name} holds an integer of more than 35 bits")
    if shift:
        raise TableError(f"the column {name} ends in the middle of an integer")
    return out


def packed(values: list[int]) -> bytes:
    """A column's bytes in one deflate stream; nothing at all for zeros only.

    Raises:
        TableError: a value is negative or above `MAX_VALUE`.
    """
    return deflate(column(values)) if any(values) else b""


def unpacked(data: object, name: str, most: int) -> list[int]:
    """The integers of a packed column that are not all zero.

    Args:
        data: what stands in the payload.
        name: the column's name, for the error.
        most: how many integers it may hold; not much more is ever unpacked.

    Raises:
        TableError: not bytes, not what `packed` writes, or more than so many integers.
    """
    stream = typed(data, bytes, name)
    raw = inflate(stream, name, MAX_VALUE_BYTES * most)
    integers = values(raw, name, most)
    if NEEDLESS.search(raw) or not any(integers) or deflate(raw) != stream:
        raise TableError(f"the column {name} is not in the one form it is written in; recompile it")
    return integers


def exactly(data: object, name: str, count: int) -> list[int]:
    """The integers of a packed column whose number is known.

    Raises:
        TableError: as `unpacked`, or there are fewer.
    """
    if data == b"":
        return [0] * count
    column = unpacked(data, name, count)
    if len(column) != count:
        raise TableError(f"the column {name} holds {len(column)} integers where {count} belong")
    return column


def records(kind: type[Kind], rows: Iterable[tuple[object, ...]]) -> Iterator[Kind]:
    """Named tuples of complete rows, past their constructors, which would take longest in reading a table."""
    new: Callable[..., Kind] = tuple.__new__
    return map(partial(new, kind), rows)


def rows(flat: list[int], width: int, name: str) -> list[list[int]]:
    """A column cut into rows.

    Raises:
        TableError: the last row is incomplete.
    """
    if len(flat) % width:
        raise TableError(f"the column {name} is not made of rows of {width}")
    return [flat[at : at + width] for at in range(0, len(flat), width)]


def zigzag(value: int) -> int:
    """0, -1, 1, -2, 2 ... as 0, 1, 2, 3, 4: small magnitudes stay short."""
    return value << 1 if value >= 0 else ~(value << 1)


def unzigzag(value: int) -> int:
    """The inverse of `zigzag`."""
    return value >> 1 ^ -(value & 1)
