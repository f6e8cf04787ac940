"""Finds the shapes that ezdxf removed from a damaged DXF file, or whose numbers it guessed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from ezdxf.audit import AuditError

from planner.part.importers.dxf_view import ANNOTATION
from planner.part.importers.pieces import Lost

if TYPE_CHECKING:
    from ezdxf.audit import Auditor

LISTED = 5
GEOMETRY = re.compile(
    "MISSING_(SECTION|ENDSEC)|FOUND_TAG|REMOVED_(INVALID_GRAPHIC|ENTITY)|UNDEFINED_BLOCK|BLOCK_REFERENCE_CYCLE|"
    "INVALID_(INTEGER|FLOATING|ENTITY|EXTRUSION|MAJOR|VERTEX|MLINE_VERTEX|SPLINE|ELLIPSE|HATCH|MESH)"
)
"""Names of ezdxf's error codes that concern shapes; all others concern styles, tables and objects."""
REMOVED = re.compile(r"(?:Removed|Deleted)(?: invalid| DXF| entity)* ([A-Z0-9_]+)\b")
LINE = re.compile(r"near line:? (\d+)")
SHAPE_SECTIONS = (b"BLOCKS", b"ENTITIES")


class Losses(NamedTuple):
    """Effects of ezdxf's repairs on the shapes of a file."""

    lost: list[Lost]  # shapes that were removed, or whose numbers were guessed
    repairs: list[str]  # repairs, one sentence each


def losses(auditor: Auditor, data: bytes) -> Losses:
    """Sorts the messages of ezdxf's auditor about shapes: a shape is lost, or the repair is harmless.

    A message is added if the file is cut short; `data` is the content of the file.
    """
    lost, repairs = list[str](), list[str]()
    for entry in (*auditor.errors, *auditor.fixes):
        code = AuditError(entry.code)
        if not GEOMETRY.search(code.name):
            continue
        words = entry.message.strip().rstrip(".")
        removed = REMOVED.match(words)
        gone = removed is not None and not ANNOTATION.fullmatch(removed[1])
        guessed = code is AuditError.INVALID_FLOATING_POINT_VALUE and _among_shapes(words, data)
        (lost if gone or guessed else repairs).append(f"ezdxf: {words}")
    if not data.rstrip().endswith(b"EOF"):
        ends = data.rfind(b"ENDSEC") > data.rfind(b"ENTITIES")
        (repairs if ends else lost).append(f"the file is cut short{' behind its shapes' * ends}")
    return Losses([Lost(words) for words in _listed(lost)], _listed(repairs))


def _among_shapes(words: str, data: bytes) -> bool:
    """Whether the line of the file that a message names lies in a section that holds shapes.

    True if the message names no line.
    """
    line = LINE.search(words)
    if line is None:
        return True
    before = b"\n".join(data.splitlines()[: int(line[1])])
    sections = re.findall(rb"SECTION\s+2\s+(\w+)", before)
    return bool(sections) and sections[-1] in SHAPE_SECTIONS


def _listed(words: list[str]) -> list[str]:
    distinct = list(dict.fromkeys(words))
    more = len(distinct) - LISTED
    return distinct[:LISTED] + ([f"ezdxf: {more} more of the kind"] if more > 0 else [])
