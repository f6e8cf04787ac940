"""The folders, packages, exported names and commands are the ones that pyproject.toml and the design list."""

import importlib
import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
from programs import ROOT

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
TOPS = ("planner", "runtime", "drivers")


def packages_of(files: str) -> set[str]:
    """The packages whose folder holds a file with a name like `files`."""
    modules = (module for top in TOPS for module in (ROOT / top).rglob(files))
    return {".".join(module.parent.relative_to(ROOT).parts) for module in modules}


PACKAGES = sorted(packages_of("__init__.py"))
RENAMED = {"try": "first_look"}  # `try` is a keyword
COMMANDS = PYPROJECT["project"]["scripts"]
TOP_LEVEL = {"planner", "runtime", "drivers", "trees", "tests", "tools", ".ci"}
TEST_KINDS = {
    *("unit", "property", "reference", "protocol", "contract"),
    *("golden", "integration", "hardware", "bench", "support"),
}
HEADINGS = ["Status", "Context", "Decision", "Consequences"]


def folders(path: Path) -> set[str]:
    """Names of the folders in `path`, without `.git` and those that git ignores."""
    lines = (ROOT / ".gitignore").read_text().splitlines()
    ignored = [line.strip("/") for line in lines if line.strip()]
    names = {entry.name for entry in path.iterdir() if entry.is_dir() and entry.name != ".git"}
    return {name for name in names if not any(fnmatch(name, pattern) for pattern in ignored)}


def test_repository_top_level_folders_are_those_of_design():
    assert folders(ROOT) == TOP_LEVEL


def test_tests_folders_are_known_kinds():
    assert folders(ROOT / "tests") <= TEST_KINDS


def test_packages_hold_every_module_and_are_installed():
    assert sorted(packages_of("*.py")) == PACKAGES
    included = PYPROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    assert all(any(fnmatch(package, pattern) for pattern in included) for package in PACKAGES)


def test_unit_tests_mirror_packages():
    unit = ROOT / "tests" / "unit"
    mirrored = {".".join(test.parent.relative_to(unit).parts) for test in unit.rglob("test_*.py")}
    assert mirrored - {""} <= set(PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_package_exports_only_names_that_exist(package):
    module = importlib.import_module(package)
    assert module.__file__ is not None, f"{package} has no __init__.py"
    exported = getattr(module, "__all__", [])
    assert len(exported) == len(set(exported))
    assert [name for name in exported if not hasattr(module, name)] == []


def test_packages_are_marked_as_typed():
    data = PYPROJECT["tool"]["setuptools"]["package-data"]
    named = [(top, name) for top, names in data.items() for name in names]
    missing = [f"{top}/{name}" for top, name in named if not list((ROOT / top).glob(name))]
    assert missing == []


@pytest.mark.parametrize("command", COMMANDS)
def test_command_has_entry_point_and_main(command):
    module, _, function = COMMANDS[command].partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    if module == "planner.commands":
        name = command.removeprefix("plan-")
        assert callable(importlib.import_module(f"planner.cli.{RENAMED.get(name, name)}").main)


def test_decision_records_have_different_numbers():
    numbers = [path.name[:4] for path in (ROOT / "tools" / "decisions").glob("[0-9]*.md")]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize(
    "record", sorted((ROOT / "tools" / "decisions").glob("*.md")), ids=lambda path: path.stem
)
def test_decision_record_has_four_headings(record):
    text = record.read_text()
    number = record.stem.partition("-")[0].replace("TEMPLATE", "NNNN")
    assert text.startswith(f"# {number}: ")
    assert re.findall(r"^## (.+)$", text, re.MULTILINE) == HEADINGS
