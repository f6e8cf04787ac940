"""Styles of SVG elements: presentation attributes, style sheets and `style`, cascaded as in CSS.

Selectors are matched by cssselect2, declarations and colours parsed by tinycss2.
"""

import re
from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as Tree

import cssselect2
import tinycss2
from tinycss2.color4 import parse_color

from runtime.shell.errors import InputError

INHERITED = {
    "color": "black",
    "visibility": "visible",
    "fill": "black",
    "stroke": "none",
    "fill-opacity": "1",
    "stroke-opacity": "1",
    "stroke-width": "1",
}
"""Inherited properties with their initial values."""
SKIPPED = (True, True)  # comments and white space, for tinycss2
SHARE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(%?)\s*")
SCREEN = {"", "all", "screen"}  # media whose style sheets count
ELSEWHERE = {"print", "speech"}  # media whose style sheets do not count
# at-rules that hide no shape
HARMLESS = {"charset", "font-face", "keyframes", "namespace", "page", "property"}

Style = Mapping[str, str]
"""The properties of one element by name, including all of `INHERITED`."""


class Sheets:
    """The style sheets of a drawing."""

    def __init__(self, root: Tree.Element) -> None:
        self.unread: list[str] = []  # rules that are not read and may change what is visible
        self._matcher = cssselect2.Matcher()
        self._empty = True
        for element in root.iter():
            is_sheet = isinstance(element.tag, str) and element.tag.rpartition("}")[2] == "style"
            if is_sheet and element.get("type", "text/css").strip().lower() in ("", "text/css"):
                rules = tinycss2.parse_stylesheet("".join(element.itertext()), *SKIPPED)
                self._add_for(element.get("media", ""), rules)
        every = () if self._empty else cssselect2.ElementWrapper.from_xml_root(root).iter_subtree()
        self._wrappers = {wrapper.etree_element: wrapper for wrapper in every}

    def style(self, element: Tree.Element, parent: Style) -> Style:
        """The properties of an element, with those that it inherits from the style `parent`."""
        rules = self._matcher.match(self._wrappers[element]) if self._wrappers else ()
        sheet = [declaration for *_, content in rules for declaration in content]
        inline = _declarations(element.get("style", ""))
        last = [each for each in (*sheet, *inline) if each.important]
        stated = {name: value for name, value in element.attrib.items() if not name.startswith("{")}
        for each in (*(each for each in (*sheet, *inline) if not each.important), *last):
            stated[each.lower_name] = tinycss2.serialize(each.value).strip()
        computed = {name: parent[name] for name in INHERITED}
        for name, value in stated.items():
            word = value.strip().lower()
            if word == "inherit":
                computed[name] = parent.get(name, "")
            elif word in ("initial", "unset", "revert"):
                computed[name] = (
                    INHERITED.get(name, "") if word == "initial" else computed.get(name, "")
                )
            else:
                computed[name] = value
        return computed

    def _add_for(self, media: str, rules: list[tinycss2.ast.Node]) -> None:
        """Adds the rules for the comma-separated `media` if a screen is one of them."""
        kinds = {kind.strip().lower() for kind in media.split(",")}
        if kinds & SCREEN:
            for rule in rules:
                self._add(rule)
        elif kinds - ELSEWHERE:
            self.unread.append(f"@media {media.strip()}")

    def _add(self, rule: tinycss2.ast.Node) -> None:
        if rule.type == "at-rule":
            prelude = tinycss2.serialize(rule.prelude).strip()
            if rule.lower_at_keyword == "media" and rule.content is not None:
                self._add_for(prelude, tinycss2.parse_rule_list(rule.content, *SKIPPED))
            elif rule.lower_at_keyword not in HARMLESS:
                self.unread.append(f"@{rule.at_keyword} {prelude}".strip())
        if rule.type != "qualified-rule":
            return
        try:
            selectors = cssselect2.compile_selector_list(rule.prelude)
        except cssselect2.SelectorError:  # CSS ignores such a rule
            return
        content = tinycss2.parse_blocks_contents(rule.content, *SKIPPED)
        if any(part.type == "qualified-rule" for part in content):
            self.unread.append(f"rules in that of {tinycss2.serialize(rule.prelude).strip()}")
        self._empty = False
        for selector in selectors:
            self._matcher.add_selector(selector, _declarations(rule.content))


def shows(style: Style, where: str) -> bool:
    """Whether an element and its content are displayed."""
    return _word(style, "display", where) != "none" and _share(style, "opacity", where) > 0.0


def paints(style: Style, stroke_width: float, where: str) -> bool:
    """Whether a shape is visible, and filled or stroked with some colour."""
    filled = _inks(style, "fill", where)
    return _word(style, "visibility", where) == "visible" and (
        filled or strokes(style, stroke_width, where)
    )


def strokes(style: Style, stroke_width: float, where: str) -> bool:
    """Whether a shape, if it is visible, is stroked with some colour."""
    return stroke_width > 0.0 and _inks(style, "stroke", where)


def _inks(style: Style, what: str, where: str) -> bool:
    paint = _word(style, what, where)
    if paint == "currentcolor":
        paint = _word(style, "color", where)
    colour = parse_color(paint)
    clear = getattr(colour, "alpha", 1.0) == 0.0
    return paint != "none" and not clear and _share(style, f"{what}-opacity", where) > 0.0


def _word(style: Style, name: str, where: str) -> str:
    """The value of a property in lower case; raises `InputError` for a CSS variable."""
    text = style.get(name, "").strip()
    if "var(" in text:
        problem = (
            f"{name}={text[:40]!r} is a variable, which is not read; correct it in the drawing"
        )
        raise InputError(problem, where=where)
    return text.lower()


def _share(style: Style, name: str, where: str) -> float:
    text = style.get(name) or "1"
    share = SHARE.fullmatch(text)
    if share is None:
        problem = f"{name}={text[:40]!r} is no number; correct it in the drawing"
        raise InputError(problem, where=where)
    return float(share[1])


def _declarations(content: str | Iterable[object]) -> list[tinycss2.ast.Declaration]:
    every = tinycss2.parse_blocks_contents(content, *SKIPPED)
    return [each for each in every if each.type == "declaration"]
