"""SVG files made smaller: the same picture, to a hundredth of a point, in about a third of the bytes.

Matplotlib writes every coordinate in full and every style in every element. Here recurring styles become
classes, ids become short, and paths go on from where they are, in steps of 0.01 pt that add up exactly.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

DIGITS = 2
"""Behind the point, of a coordinate."""
_NUMBER = r"-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?"
_TOKEN = re.compile(rf"[A-Za-z]|{_NUMBER}")
_ALIKE = re.compile(
    r'<g id="([^"]*)">((?:<path d="[^"]*" clip-path="([^"]*)" class="([^"]*)"/>)'
    r'(?:<path d="[^"]*" clip-path="\3" class="\4"/>)*)</g>'
)
"""A group of paths that are all clipped and styled alike."""


def lighter(svg: str) -> str:
    """The picture in fewer bytes.

    Args:
        svg: as matplotlib writes it; other paths than of M, L, Q, C and Z, all absolute, stay as they are.

    Returns:
        Equal input gives equal output. Comments, which say what a text drawn as outlines reads, are kept.
    """
    svg = _classed(svg)
    svg = re.sub(r' d="([^"]*)"', lambda match: f' d="{_relative(match[1])}"', svg)
    svg = re.sub(r'<use xlink:href="([^"]*)" transform="translate\((\S+) 0\)"/>', _used, svg)
    svg = _short_ids(svg)
    svg = re.sub(r">\s*\n\s*<", "><", svg)
    return _ALIKE.sub(_grouped, svg)


def _classed(svg: str) -> str:
    """Styles that recur become classes."""
    styles = Counter(re.findall(r'style="([^"]*)"', svg))
    names = {text: f"s{k}" for k, (text, count) in enumerate(styles.most_common()) if count > 1}

    def name(match: re.Match[str]) -> str:
        known = names.get(match[1])
        return f'class="{known}"' if known else match[0]

    rules = "".join(f".{known}{{{text}}}" for text, known in names.items())
    return re.sub(r'style="([^"]*)"', name, svg).replace("</style>", f"{rules}</style>", 1)


def _relative(path: str) -> str:
    """A path with relative coordinates; one with other commands than matplotlib's as it is."""
    tokens = _TOKEN.findall(path)
    starts = [k for k, token in enumerate(tokens) if token.isalpha()]
    if {tokens[k] for k in starts} - set("MLQCzZ") or not starts or tokens[0] != "M":
        return path
    written: list[str] = []
    here = begun = (0, 0)
    for start, end in pairwise([*starts, len(tokens)]):
        command = tokens[start]
        points = list(_points(tokens[start + 1 : end]))
        if command == "M":
            begun = points[0]
        written.append(command.lower())
        written.extend(_step(x - here[0], y - here[1]) for x, y in points)
        here = points[-1] if points else begun
    return _joined(written)


def _points(numbers: list[str]) -> Iterator[tuple[int, int]]:
    """Pairs of numbers, in units of the last digit kept."""
    whole = [round(float(number) * 10**DIGITS) for number in numbers]
    return zip(whole[::2], whole[1::2], strict=True)


def _step(x: int, y: int) -> str:
    second = _text(y)
    return _text(x) + ("" if second.startswith("-") else " ") + second


def _text(units: int) -> str:
    """A number without what need not be written: -0.50 as -.5."""
    sign, size = "-" * (units < 0), abs(units)
    fraction = f"{size % 10**DIGITS:0{DIGITS}}".rstrip("0")
    whole = str(size // 10**DIGITS) if size >= 10**DIGITS or not fraction else ""
    return sign + whole + f".{fraction}" * bool(fraction)


def _joined(written: list[str]) -> str:
    """Commands and pairs in a row, a repeated lineto unnamed."""
    text, last = "", ""
    for part in written:
        if part == "l" and last == "l":
            continue
        if not part.isalpha() and text and not text[-1].isalpha() and not part.startswith("-"):
            text += " "
        text += part
        last = part if part.isalpha() else last
    return text


def _used(match: re.Match[str]) -> str:
    return f'<use xlink:href="{match[1]}" x="{float(match[2]):.4g}"/>'


def _short_ids(svg: str) -> str:
    """Glyphs and clips under short names, in the order in which they appear; groups keep theirs."""
    long = re.compile(r'(id="|href="#|url\(#)((?:DejaVuSans[\w-]*-|p)[0-9a-f]{2,})(?=["\)])')
    names: dict[str, str] = {}

    def name(match: re.Match[str]) -> str:
        return match[1] + names.setdefault(match[2], f"u{len(names)}")

    return long.sub(name, svg)


def _grouped(match: re.Match[str]) -> str:
    """What all paths of a group share, said once."""
    name, paths, clip, style = match.groups()
    shared = f' clip-path="{clip}" class="{style}"'
    return f'<g id="{name}"{shared}>{paths.replace(shared, "")}</g>'
