"""Builds HTML pages and their elements: cards with figures, tables, verdicts, folded sections.

The head of each page holds the stylesheet, and forbids the browser to load anything from a network.
"""

import json
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from pathlib import Path

FOLDER = Path(__file__).parent
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


@cache
def asset(name: str) -> str:
    """Reads a file of this folder that pages share: the head, a stylesheet or a script; returns its text."""
    return (FOLDER / name).read_text("utf-8")


def page(
    title: str,
    body: str,
    *,
    kind: str = "",
    style: str = "",
    data: object = None,
    script: str = "",
    policy: str = "",
) -> str:
    """Returns a complete HTML page.

    Args:
        title: title of the window.
        body: HTML of the page's content.
        kind: CSS class of the body; "sheet" is for pages to print in small type.
        style: further CSS, after the common stylesheet.
        data: object for the script, which finds it as JSON in the element `data`; None: no data.
        script: JavaScript of the page, which may use the functions of `elements.js`.
        policy: further directives of the Content-Security-Policy.
    """
    rules = [POLICY, *(["script-src 'unsafe-inline'"] if script else []), *filter(None, [policy])]
    head = asset("head.html").format(
        policy="; ".join(rules),
        title=escape(title),
        style=asset("style.css") + style,
        kind=f' class="{kind}"' if kind else "",
    )
    scripts = f"<script>\n{asset('elements.js')}{script}</script>\n" if script else ""
    if data is not None:  # within a script element only "<" could end it
        text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
        scripts = f'<script type="application/json" id="data">{text}</script>\n{scripts}'
    return f"{head}{body}\n{scripts}</body>\n</html>\n"


def verdict(grade: str, sentence: str, lead: str = "") -> str:
    """Returns the HTML of a sentence that judges something.

    Args:
        grade: "good", "fair" or "poor"; determines the colour.
        sentence: the sentence.
        lead: text in bold before the sentence.
    """
    strong = f"<strong>{escape(lead)}</strong> " if lead else ""
    return f'<p class="verdict {grade}">{strong}{escape(sentence)}</p>'


def cards(figures: Iterable[tuple[str, str, str]]) -> str:
    """Returns the HTML of key figures in large letters; each figure is a name, a value and a note."""
    items = (
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd>"
        f'<dd class="note">{escape(note)}</dd></div>'
        for name, value, note in figures
    )
    return "\n".join(['<dl class="cards">', *items, "</dl>"])


def table(
    label: str, heads: Sequence[str], rows: Iterable[Iterable[str]], kind: str = "wide"
) -> str:
    """Returns the HTML of a table.

    Args:
        label: description for screen readers.
        heads: heads of the columns.
        rows: for each row the texts of its cells; the first is the head of the row.
        kind: CSS class of the surrounding element. A "wide" element has a scrollbar if the table is wider
            than the page.
    """
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in heads)
    return "\n".join(
        [
            f'<div class="{kind}" tabindex="0" role="region" aria-label="{escape(label)}"><table>',
            f"<thead><tr>{head}</tr></thead>",
            *("<tbody>", *map(_row, rows), "</tbody></table></div>"),
        ]
    )


def _row(cells: Iterable[str]) -> str:
    head, *others = map(escape, cells)
    inner = "".join(f"<td>{cell}</td>" for cell in others)
    return f'<tr><th scope="row">{head}</th>{inner}</tr>'


def folded(summary: str, *content: str) -> str:
    """Returns HTML that shows only a summary until the reader unfolds the content.

    Args:
        summary: text of the summary.
        content: pieces of HTML.
    """
    inner = "\n".join(content)
    return f"<details><summary>{escape(summary)}</summary>\n{inner}\n</details>"
