"""Styles of SVG elements: presentation attributes, style sheets and `style`, cascaded as in CSS.

Selectors are matched by cssselect2, declarations parsed by tinycss2.
"""

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as Tree

import cssselect2
import tinycss2

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
        """The properties of an element, some of them inherited from the style `parent`."""
        rules = self._matcher.match(self._wrappers[element]) if self._wrappers else ()
        sheet = [declaration for *_, content in rules for declaration in content]
        inline = _declarations(element.get("style", ""))
        last = [each for each in (*sheet, *inline) if each.important]
        stated = {name: value for name, value in element.attrib.items() if not name.startswith("{")}
        for each in (*(each for each in (*sheet, *inline) if not each.important), *last):
            stated[each.lower_name] = tinycss2.serialize(each.value).strip()
        computed = {name: parent[name] for name in INHERITED}
        sources = {"inherit": parent, "initial": INHERITED, "unset": computed, "revert": computed}
        for name, value in stated.items():
            source = sources.get(value.strip().lower())
            computed[name] = value if source is None else source.get(name, "")
        return computed

    def _add_for(self, media: str, rules: list[tinycss2.ast.Node]) -> None:
        """Adds style rules that apply to screens, and ignores rules for print or speech alone.

        Rules for any other media are noted as unread. `media` is the comma-separated list of the media to
        which the rules apply.
        """
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


def _declarations(content: str | Iterable[object]) -> list[tinycss2.ast.Declaration]:
    every = tinycss2.parse_blocks_contents(content, *SKIPPED)
    return [each for each in every if each.type == "declaration"]
