"""The directive `kept`: what a file of tests/bench/results says, as tables, so that no page copies a figure.

    ```{kept} squeeze
    ```

A name with a dash, such as `squeeze-speed`, is one of several tables of a file; `others` lists the files that
no page shows otherwise. Without its file a table is left out, and the page says how to make it. `kept.jinja`
holds the tables.
"""

import json
from pathlib import Path

from docutils import nodes
from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

HERE = Path(__file__).resolve().parent
RESULTS = HERE.parents[2] / "tests" / "bench" / "results"
FEW_LINES = 40  # most lines of a file of which only names and values are known
MACROS = Environment(loader=FileSystemLoader(HERE), undefined=StrictUndefined, autoescape=False)
MACROS = MACROS.get_template("kept.jinja").module
TABLES = (
    *("table1", "zoo", "worlds", "squeeze-speed", "squeeze-convergence", "squeeze-goldberg", "kcde"),
    *("push_forward", "rollouts", "runtime", "mutation", "robustness", "camera"),
    *("audit-loop", "audit-drift", "bound", "pushes", "pushes-runs", "gym-speed", "gym-policies"),
    *("zoo500", "second_opinion", "push_first"),
)


def others() -> str:
    """Every file that has no table of its own, as names and values."""
    known = {name.partition("-")[0] for name in TABLES}
    parts = [
        f"**tests/bench/results/{path.name}**\n\n{listed(json.loads(path.read_text()))}"
        for path in sorted(RESULTS.glob("*.json"))
        if path.stem not in known
    ]
    return "\n\n".join(parts) or "None so far."


def listed(kept: object) -> str:
    """What is kept as names and values, the first of them."""
    return MACROS.listed(flat(kept), FEW_LINES)


def flat(value: object, name: str = "") -> list[tuple[str, object]]:
    """Names, with dots for depth, and values."""
    if isinstance(value, dict):
        return [pair for key, inner in value.items() for pair in flat(inner, f"{name}.{key}".lstrip("."))]
    if isinstance(value, list) and any(isinstance(inner, (dict, list)) for inner in value):
        return [pair for k, inner in enumerate(value, 1) for pair in flat(inner, f"{name}.{k}")]
    return [(name, f"{value:.4g}" if isinstance(value, float) else value)]


def table_of(name: str) -> str:
    """The Markdown that a name stands for.

    Raises:
        KeyError: there is no table of that name.
    """
    if name == "others":
        return others()
    if name not in TABLES:
        raise KeyError(name)
    stem, _, part = name.partition("-")
    path = RESULTS / f"{stem}.json"
    if not path.exists():
        return "Not measured in this version."
    kept = json.loads(path.read_text())
    try:
        return getattr(MACROS, name.replace("-", "_"))(kept)
    except (TemplateError, TypeError, AttributeError):  # a benchmark that keeps other figures than it did
        return listed(kept.get(part, kept))


class Kept(SphinxDirective):
    """See the module."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        try:
            text = table_of(name)
        except KeyError:
            raise self.error(f"no table {name}; there are {', '.join(TABLES)} and others") from None
        for path in RESULTS.glob("*.json"):
            self.env.note_dependency(str(path))
        return [nodes.container("", *self.parse_text_to_nodes(text), classes=["kept"])]


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("kept", Kept)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
