"""Fields of a table's records: the meaning and the range of each value, as annotations in `model`.

A bound that is a text names another value of the table, such as `limits.max_depth`.
"""

from operator import attrgetter
from typing import Any, NamedTuple

MAX_NODES = 1 << 12
MAX_LEAVES = 1 << 14
MAX_BRANCHES = 32
MAX_BYTES = 2 << 20  # largest size of a file
FAR = 10**9  # bound of values that have no other

FLAG = "flag"  # 0 or 1, a bool in the records
LINE = "line"  # printable characters
TEXT = "text"
TYPES: dict[str, type] = {"int": int, FLAG: int, LINE: str, TEXT: str, "bytes": bytes}


class Field(NamedTuple):
    """Meaning and range of one value of a record."""

    meaning: str
    least: int | str = 0  # bounds of an int, or of the length of other types
    most: int | str = FAR
    type: str = "int"  # one of `TYPES`
    name: str = ""  # name of the attribute, dotted for nested records

    def bounds(self, table: Any) -> tuple[int, int]:
        """Returns the least and the greatest allowed value or, for text and bytes, the allowed lengths."""
        least, most = (
            bound if isinstance(bound, int) else attrgetter(bound)(table)
            for bound in (self.least, self.most)
        )
        return least, most


def fields_of(record: Any, *only: str) -> tuple[Field, ...]:
    """Lists the fields of a record, in order; the fields of a nested record have dotted names.

    Args:
        record: the class of the record, whose annotations contain the fields.
        only: names of the attributes whose fields are returned; without any name, all are.
    """
    result: list[Field] = []
    for name, annotation in record.__annotations__.items():
        if only and name not in only:
            continue
        if metadata := getattr(annotation, "__metadata__", ()):
            result.append(metadata[0]._replace(name=name))
        elif hasattr(annotation, "_fields"):
            inner = fields_of(annotation)
            result += [field._replace(name=f"{name}.{field.name}") for field in inner]
    return tuple(result)
