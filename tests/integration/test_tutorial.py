"""The commands of the tutorial, run in order in an empty folder, print what it shows; links are alive."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from planner.statistics import wilson_interval

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "tools" / "docs"
PAGES = [DOCS / "tutorial.md", DOCS / "commissioning.md"]
COMMANDS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
BLOCK = re.compile(r"^```console\n(.*?)^```", re.MULTILINE | re.DOTALL)
MARK = "==== next block ===="


def blocks(page):
    """Each block of a page as its commands and the lines that they are said to print."""
    found = []
    for text in BLOCK.findall(page.read_text()):
        lines = text.splitlines()
        found.append(
            (
                [line[2:] for line in lines if line.startswith("$ ")],
                [line for line in lines if not line.startswith("$ ")],
            )
        )
    return found


def shims(folder):
    """The project's commands as programs, whether or not it is installed."""
    folder.mkdir()
    for name, target in COMMANDS.items():
        module, _, function = target.partition(":")
        body = f"import sys; from {module} import {function}; sys.exit({function}())"
        program = folder / name
        program.write_text(f"#!/bin/sh\nexec '{sys.executable}' -c '{body}' \"$@\"\n")
        program.chmod(0o755)
    return folder


def matches(shown, printed):
    """Whether lines are printed in this order; "..." stands for any lines, or for the rest of one."""
    rest = iter(printed)
    for line in shown:
        if line == "...":
            continue
        start = line.removesuffix("...").rstrip()
        whole = not line.endswith("...")
        assert any(p == line if whole else p.startswith(start) for p in rest), f"{line!r} is not printed"
    return True


def test_the_tutorial_runs_as_written(tmp_path):
    found = blocks(DOCS / "tutorial.md")
    assert len(found) >= 7
    script = "\n".join("\n".join([*commands, f"echo '{MARK}'"]) for commands, _ in found)
    work = tmp_path / "work"
    work.mkdir()
    shutil.copy(DOCS / "lever.dxf", work)
    environment = {
        **os.environ, "PATH": f"{shims(tmp_path / 'bin')}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)
    }  # fmt: skip
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script], cwd=work, env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    printed = [part.strip().splitlines() for part in done.stdout.split(MARK)]
    for (_, shown), lines in zip(found, printed, strict=False):
        assert matches(shown, lines)
    assert (work / "lever.html").stat().st_size < 3_000_000


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text())
    assert links
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_and_options_that_are_named_exist(page):
    known = {
        option
        for source in (
            *ROOT.glob("runtime/*.py"),
            *ROOT.glob("planner/cli/*.py"),
            *ROOT.glob("drivers/sim/*.py"),
        )
        for option in re.findall(r"[\"'](--[a-z-]+)[\"']", source.read_text())
    }
    text = page.read_text()
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)) <= known
    assert set(re.findall(r"\b(?:plan|grasp)-[a-z]+\b", text)) <= set(COMMANDS) | {"grasp-runtime"}


def test_a_hundred_good_parts_say_what_the_page_says():
    assert 0.96 < wilson_interval(100, 100)[0] < 0.97
