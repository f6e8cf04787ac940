"""Which module may import which: the contracts of pyproject.toml accept and refuse what they should."""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest
from programs import ROOT, Ended, ended

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONTRACTS = PYPROJECT["tool"]["importlinter"]["contracts"]
LAYERS = re.findall(r"[\w.]+", " ".join(line for c in CONTRACTS for line in c.get("layers", ())))
LINT = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"

CLOCKS = {"time", "datetime", "sched", "timeit"}

# The smallest tree that the contracts accept, module -> source, with every kind of allowed import.
CLEAN = {f"{layer.replace('.', '/')}.py": "" for layer in LAYERS} | {
    "planner/__init__.py": "",
    "planner/compile.py": (
        "import numpy\nimport runtime.pages.charts\nimport runtime.shell.command\nimport runtime.table\n"
    ),
    "runtime/__init__.py": "",
    "runtime/pages/__init__.py": "",
    "runtime/pages/charts.py": "",
    "runtime/shell/__init__.py": "",
    "runtime/shell/command.py": "",
    "runtime/shell/host_names.py": "",
    "runtime/shell/errors.py": "",
    "runtime/table/__init__.py": "import runtime.table.codec\n",
    "runtime/table/codec.py": "",
    "runtime/execution/__init__.py": "",
    "runtime/execution/executor.py": "import drivers.ports\nimport runtime.table\n",
    "runtime/cli.py": (
        "import drivers.camera.commands\nimport drivers.connect\nimport runtime.execution.executor\n"
    ),
    "drivers/__init__.py": "",
    "drivers/camera/__init__.py": "",
    "drivers/camera/commands.py": "import runtime.shell.command\n",
    "drivers/camera/audit.py": "import runtime.table\n",
    "drivers/connect.py": "import drivers.robotiq\n",
    "drivers/errors.py": "import runtime.shell.errors\n",
    "drivers/ports.py": "",
    "drivers/robotiq.py": "",
    "drivers/stream.py": "import runtime.shell.host_names\n",
    "drivers/sim/__init__.py": "",
    "drivers/sim/cli.py": "import runtime.shell.command\n",
    "drivers/sim/physics.py": "import runtime.table\n",
}

# An import that is forbidden, and how the contract that it breaks begins.
BROKEN = [
    ("planner.compile", "runtime.execution.executor", "planner knows only"),
    ("planner.compile", "runtime.table.codec", "planner knows only"),
    ("planner.compile", "drivers.robotiq", "planner knows only"),
    ("planner.mechanics", "planner.belief", "the planner's rooms"),
    ("planner.learned", "planner.search", "the planner's rooms"),
    ("runtime.execution.executor", "planner.compile", "runtime is numpy-free"),
    ("runtime.journal", "runtime.execution.executor", "the runtime's rooms"),
    ("drivers.ports", "drivers.robotiq", "drivers.ports imports"),
    ("runtime.table.codec", "numpy", "runtime is numpy-free"),
    ("drivers.robotiq", "numpy", "runtime is numpy-free"),
    ("runtime.execution.executor", "drivers.connect", "only runtime.cli"),
    ("runtime.cli", "drivers.robotiq", "only runtime.cli"),
    ("drivers.robotiq", "runtime.execution", "drivers know neither"),
    ("drivers.robotiq", "runtime.shell.command", "drivers know neither"),
    ("drivers.robotiq", "planner.compile", "drivers know neither"),
    ("drivers.camera.audit", "runtime.execution.executor", "drivers know"),
    ("drivers.sim.wire", "drivers.sim.cell", "the drivers' rooms"),
]


def imported(path: Path) -> set[str]:
    """The modules that a file imports."""
    nodes = [*ast.walk(ast.parse(path.read_text()))]
    aliases = (alias for node in nodes if isinstance(node, ast.Import) for alias in node.names)
    names = {alias.name for alias in aliases}
    return names | {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}


def lint(folder: Path) -> Ended:
    """Runs import-linter in a folder, with the contracts of this project; returns how it ended."""
    options = ["--config", ROOT / "pyproject.toml", "--no-cache"]
    return ended([sys.executable, "-c", LINT, *options], cwd=folder)


def plant(folder: Path, modules: dict[str, str]) -> None:
    """Writes the source of modules, by path, into a folder."""
    for name, source in modules.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)


@pytest.mark.parametrize(
    "path", [*(ROOT / "runtime" / "shell").glob("*.py")], ids=lambda path: path.stem
)
def test_shell_module_imports_only_standard_library(path):
    for name in imported(path):
        package = name.partition(".")[0]
        assert (
            name.startswith("runtime.shell")
            or package in sys.stdlib_module_names
            or (package == "shtab" and path.stem == "command")  # for --print-completion alone
        )


@pytest.mark.parametrize(
    "path", sorted((ROOT / "runtime").rglob("*.py")), ids=lambda path: path.stem
)
def test_runtime_module_reads_time_only_in_clock(path):
    """Waits, dates and deadlines go through the Clock port, which may be a virtual one."""
    packages = {name.partition(".")[0] for name in imported(path)}
    assert bool(packages & CLOCKS) == (path.name == "clock.py")


@pytest.mark.slow
def test_contracts_allowed_imports_are_accepted(tmp_path):
    plant(tmp_path, CLEAN)
    result = lint(tmp_path)
    assert result.code == 0, result


@pytest.mark.slow
def test_contracts_each_forbidden_import_is_reported(tmp_path):
    """The modules contain all forbidden imports; each is reported under the contract that it breaks."""
    modules = dict(CLEAN)
    for module, imported, _ in BROKEN:
        modules[f"{module.replace('.', '/')}.py"] += f"import {imported}\n"
    plant(tmp_path, modules)
    result = lint(tmp_path)
    assert result.code == 1, result
    sections = re.split(r"\n(?=\S[^\n]*\n-+\n)", result.out)
    for module, imported, contract in BROKEN:
        (broken,) = [text for text in sections if text.startswith(contract)]
        assert f"{module} -> {imported} (l." in broken, (module, imported)


@pytest.mark.parametrize(
    "contract", [c for c in CONTRACTS if "layers" in c], ids=lambda c: c["name"]
)
def test_rooms_picture_shows_layers_of_contract(contract):
    package = contract["layers"][0].partition(".")[0]
    layers: list[set[str]] = []
    for layer in contract["layers"]:  # the layers within a room are one row
        rooms = set(re.findall(rf"{package}\.(\w+)", layer)) - set().union(*layers)
        layers += [rooms] if rooms else []
    picture = (ROOT / "tools" / "docs" / "pictures" / "rooms.svg").read_text()
    after = picture.partition(f">{package}</text>")[2]
    drawn = re.split(r">(?:planner|runtime|drivers)</text>", after)[0]
    rows: dict[str, set[str]] = {}
    for height, name in re.findall(r' y="([\d.]+)" font-size="22"[^>]*>(\w+)<', drawn):
        rows.setdefault(height, set()).add(name)
    assert list(rows.values()) == layers
