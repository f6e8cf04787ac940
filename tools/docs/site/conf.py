"""Configuration of Sphinx for tools/site. Its source folder is the repository: pages stay where they are."""

import sys
import tomllib
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(ROOT)]

from kept import filled  # noqa: E402

project = "squeezetree"
author = "the squeezetree maintainers"
copyright = "the squeezetree maintainers, Apache-2.0"  # noqa: A001
language = "en"

extensions = ["myst_nb", "sphinx_argparse_cli", "formulas"]
root_doc = "README"
include_patterns = [
    "README.md",
    "CHANGELOG.md",
    "tools/docs/*.md",
    "tools/docs/*.rst",
    "tools/docs/notebooks/*.ipynb",
    "tools/decisions/[0-9]*.md",
    "runtime/*.md",
    "runtime/*/*.md",
    "drivers/**/*.md",
]
exclude_patterns = ["out", ".*", "**/__pycache__", "build", "dist", "tests", "trees", "planner"]

myst_enable_extensions = ["dollarmath", "tasklist"]
myst_heading_anchors = 4
myst_enable_checkboxes = True
nb_execution_mode = "force"  # notebooks are stored without output
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nitpicky = True
# Addresses of devices in the help of commands.
linkcheck_ignore = [r"tcp://.*", "http://$"]
linkcheck_anchors = False
suppress_warnings: list[str] = []

html_theme = "furo"
html_title = "squeezetree"
html_math_renderer = "drawn"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
# A summary fetches pages; a browser forbids that to pages opened from a disk.
html_show_search_summary = False
html_last_updated_fmt = None
highlight_language = "none"
pygments_style = "default"
pygments_dark_style = "github-dark"
sphinx_argparse_cli_prefix_document = True

# Contents beside every page. They are not in README.md itself, which is also read outside the site.
CONTENTS = "\n\n" + (HERE / "contents.md").read_text()
# Links to folders, which a site cannot show.
FOLDERS = {
    "](tools/decisions)": "](tools/docs/decisions.md)",
    "](tools/systemd)": "](tools/systemd/squeezetree@.service)",
}


# Page of a command: the first whose prefix matches.
PLACES = {
    "tools/docs/commands-planner": ("plan-",),
    "tools/docs/commands-camera": ("grasp-audit",),
    "tools/docs/commands-cell": ("",),
}
COMMAND = """

.. sphinx_argparse_cli::
   :module: {module}
   :func: {function}
   :hook:
   :title: {name}
"""


def commands(page: str) -> str:
    """Returns Sphinx directives that show the --help of each command that belongs on a page."""
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    text = ""
    for name, target in scripts.items():
        module, _, function = target.partition(":")
        if page == next(place for place, begins in PLACES.items() if name.startswith(begins)):
            text += COMMAND.format(module=module, function=function, name=name)
    return text


def complete(_: Sphinx, page: str, source: list[str]) -> None:
    """Completes the source of a page, for Sphinx.

    The start page gets other links and its contents, pages of commands get the help, and the page of results
    gets the tables.
    """
    if page in PLACES:
        source[0] += commands(page)
    if page == "tools/docs/results":
        source[0] = filled(source[0])
    if page == root_doc:
        for folder, target in FOLDERS.items():
            source[0] = source[0].replace(folder, target)
        source[0] += CONTENTS


# Accessibility for readers without sight or without a mouse, which the theme lacks.
ACCESS = {
    'role="heading">': 'role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="Pages">',
    '<input class="task-list-item-checkbox"': '<input class="task-list-item-checkbox" aria-label="done"',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<div class="formula">': '<div tabindex="0" class="formula">',
    "<p><img ": '<p tabindex="0"><img ',
}


def finish(app: Sphinx, failed: Exception | None) -> None:
    """Makes the pages accessible, and writes an index.html that leads to the start page."""
    if failed is not None or app.builder.name != "html":
        return
    for path in app.outdir.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        for written, wanted in ACCESS.items():
            text = text.replace(written, wanted)
        path.write_text(text, encoding="utf-8")
    page = f"{root_doc}.html"
    (app.outdir / "index.html").write_text(
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{project}</title>'
        f'<meta http-equiv="refresh" content="0; url={page}"></head>'
        f'<body><p><a href="{page}">{project}</a></p></body></html>\n'
    )


def setup(app: Sphinx) -> None:
    app.connect("source-read", complete)
    app.connect("build-finished", finish)
