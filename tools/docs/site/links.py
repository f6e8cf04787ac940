"""Checks the links of a built site."""

import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

LOADED = {"src", "srcset", "poster", "data"}  # attributes whose target a browser fetches by itself
LOADED_STYLE = re.compile(r"(?:url\(|@import)\s*[\"']?(https?:[^\"')\s]+)")
OUTSIDE = ("http://", "https://", "//")


class Found(NamedTuple):
    """The faults of a site, a sentence for each, and the external addresses that the site links to."""

    faults: list[str]
    outside: list[str]


class Page(HTMLParser):
    """A page: its anchors, the targets of its links, and the files that a browser loads with it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: Counter[str] = Counter()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.ids[value] += 1
            elif name in LOADED and value:
                self.loads.append(value)
            elif name == "href" and value:
                (self.loads if tag == "link" else self.links).append(value)


def check(site: Path) -> Found:
    """Checks that all links within a site lead to a page or file, and that no page loads external files.

    Args:
        site: the folder with the built pages.
    """
    pages = {path.resolve(): Page(path) for path in sorted(site.rglob("*.html"))}
    faults, outside = [], set()
    for path, page in pages.items():
        name = path.relative_to(site.resolve())
        for anchor, count in page.ids.items():
            if count > 1:
                faults.append(f"{name}: the anchor {anchor} is there {count} times")
        for target in page.loads:
            if target.startswith(OUTSIDE):
                faults.append(f"{name}: loads {target} from elsewhere")
        outside |= {target for target in page.links if re.match("https?://[^/]", target)}
        for target in (*page.links, *page.loads):
            if not target.startswith(OUTSIDE):
                faults += [f"{name}: {fault}" for fault in _faults(path, target, pages)]
    for style in sorted(site.rglob("*.css")):
        for target in LOADED_STYLE.findall(style.read_text(encoding="utf-8")):
            faults.append(f"{style.relative_to(site)}: loads {target} from elsewhere")
    return Found(faults, sorted(outside))


def _faults(path: Path, target: str, pages: dict[Path, Page]) -> list[str]:
    """Returns why a link from the page at `path` leads nowhere in the site; an empty list if it is valid."""
    parts = urlsplit(target)
    if parts.scheme in ("data", "mailto"):
        return []
    file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if not file.exists():
        return [f"{target} leads to no file"]
    anchor = unquote(parts.fragment)
    if anchor and file in pages and anchor not in pages[file].ids:
        return [f"{target} leads to no anchor"]
    return []
