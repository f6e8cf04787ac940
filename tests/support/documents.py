"""Reads command blocks and tables of the documentation, and runs these commands."""

import re
import sys
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from programs import ROOT, ended

DOCS = ROOT / "tools" / "docs"
COMMANDS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
KINDS = ("*.md", "tools/d*s/*.md", "tools/docs/*.rst", "runtime/**/*.md", "drivers/*/*.md")
PAGES = sorted(path for kind in KINDS for path in ROOT.glob(kind))
BLOCK = re.compile(r"^( *)```(console|bash|sh)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
EMPTY: Mapping[str, str] = MappingProxyType({})
MARK = "==== next block ===="


class Block(NamedTuple):
    """A command block of a page: the lines of its commands, and the lines of output that it shows."""

    commands: list[str]
    printed: list[str]


def blocks(page: Path) -> list[Block]:
    """Returns the command blocks of a page, in order; blocks of bash or sh contain commands only."""
    results = []
    for match in BLOCK.finditer(page.read_text()):
        text = textwrap.dedent(match[3])
        if match[2] == "console":
            lines = text.splitlines()
            commands = [line[2:] for line in lines if line.startswith("$ ")]
            results.append(Block(commands, [line for line in lines if not line.startswith("$ ")]))
        else:
            results.append(Block(text.replace("\\\n", " ").splitlines(), []))
    return results


def section(page: str, title: str) -> str:
    """Returns the text of a page under the heading `## title`, up to the next heading of this level."""
    _, heading, rest = page.partition(f"## {title}\n")
    assert heading, f"there is no section {title}"
    return rest.partition("\n## ")[0]


def rows(text: str, first: str = "") -> list[list[str]]:
    """Returns the rows, without the head, of the only table in `text` whose head begins with `first`."""
    head = rf"^\| {re.escape(first)}.*\n\|---.*\n"
    (table,) = re.findall(rf"{head}((?:\|.*\n?)+)", text, re.MULTILINE)
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in table.splitlines()]


def shims(folder: Path, before: Mapping[str, str] = EMPTY) -> Path:
    """Writes the project's commands as programs into a new folder; returns the folder.

    `before` maps the name of a command to Python statements that the command executes first.
    """
    folder.mkdir()
    for name, target in COMMANDS.items():
        module, _, function = target.partition(":")
        body = f"import sys; {before.get(name, '')} from {module} import {function}; sys.exit({function}())"
        program = folder / name
        program.write_text(f"#!/bin/sh\nexec '{sys.executable}' -c '{body}' \"$@\"\n")
        program.chmod(0o755)
    return folder


def run(blocks: list[Block], work: Path, environment: dict[str, str]) -> list[list[str]]:
    """Runs `blocks` in one shell in the folder `work`; returns the lines that each block prints.

    The result has a list of lines for each block, and an empty list at the end.
    """
    script = "\n".join("\n".join([*block.commands, f"echo '{MARK}'"]) for block in blocks)
    words = ("bash", "-euo", "pipefail", "-c", f"exec 2>&1\n{script}")
    code, out, _ = ended(words, cwd=work, env=environment, timeout=280)
    assert code == 0, out
    return [part.strip().splitlines() for part in out.split(MARK)]


def matches(shown: list[str], printed: list[str]) -> bool:
    """Asserts that the `shown` lines are among the `printed` lines, in this order; returns True.

    A line "..." stands for any lines, and "..." within a line for any text.
    """
    rest = iter(printed)
    for line in shown:
        if line == "...":
            continue
        like = re.compile(".*".join(re.escape(piece) for piece in line.split("...")))
        assert any(like.fullmatch(p) for p in rest), f"{line!r} is not printed"
    return True


def changed(block, changes):
    """Returns a copy of a block; in its commands, each key of `changes` is replaced by its value."""
    lines = block.commands
    for old, new in changes.items():
        lines = [line.replace(old, new) for line in lines]
    return block._replace(commands=lines)


def stated(job, **values):
    """Returns a sed command that sets values in a job file, even if their lines there are comments."""
    edits = [f"s/^\\(# \\)\\?{key} = .*/{key} = {value}/" for key, value in values.items()]
    return f"sed -i '{'; '.join(edits)}' {job}"
