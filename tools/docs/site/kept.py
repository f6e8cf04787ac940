"""Writes the tables of tools/docs/performance.md and README.md from the results in tests/bench/results.

    python tools/docs/site/kept.py                  write both pages
    python tools/docs/site/kept.py bound worlds     print these tables

A table, or a list of sentences, stands between `<!-- table NAME -->` and `<!-- end -->`. The macro NAME of
`kept.jinja` writes it from the results in NAME.json. A NAME may have a suffix: for `squeeze-speed`, the macro
is `squeeze_speed` and the file squeeze.json. If there is a file NAME.txt, its text is the table. A test fails
if a page is not what this script writes. In tools/docs/results.md a table has only the first marker, and is
filled in when the site is built (conf.py).
"""

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "performance.md"
LISTING = HERE.parent / "results.md"
README = HERE.parents[2] / "README.md"
RESULTS = HERE.parents[2] / "tests" / "bench" / "results"
PLACE = re.compile(
    r"(?<=^<!-- table )(\S+) -->\n(?:.*?^(?=<!-- end -->$))?", re.MULTILINE | re.DOTALL
)


def figures(name: str) -> object:
    """Returns the content of the file `name`.json of results."""
    return json.loads((RESULTS / f"{name}.json").read_text())


TABLES = Environment(loader=FileSystemLoader(HERE), undefined=StrictUndefined, autoescape=False)
MACROS = TABLES.get_template("kept.jinja", globals={"figures": figures}).module


def table_of(name: str) -> str:
    """Returns the Markdown table of a name, the content of a .txt file, or a note that there are no results.

    Raises:
        AttributeError: there is no table of that name.
    """
    text = RESULTS / f"{name}.txt"
    if text.exists():
        return f"```text\n{text.read_text().rstrip()}\n```"
    macro = getattr(MACROS, name.replace("-", "_"))
    try:
        table = macro(figures(name.partition("-")[0])) if macro.arguments else macro()
    except FileNotFoundError:
        return "Not measured in this version."
    return re.sub(r" +$", "", str(table), flags=re.MULTILINE).strip()


def filled(page: str) -> str:
    """Returns a page with all its tables updated."""
    return PLACE.sub(lambda match: f"{match[1]} -->\n\n{table_of(match[1])}\n\n", page)


def main(names: Sequence[str]) -> int:
    """Prints the tables of these names, or writes the pages; returns the exit code."""
    if names:
        print("\n\n".join(table_of(name) for name in names))
        return 0
    for page in (PAGE, README):
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
