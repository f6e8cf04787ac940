"""Folders named like our packages, where a command is started, are not taken for them."""

import subprocess
import sys
from pathlib import Path

import pytest
from sample_tables import small_table

from runtime.table import dump

WORLD = "from runtime.shell.worlds import find_factory; find_factory('planner.world:make')"
COMMANDS = ("plan-init", "grasp-runtime", "grasp-cell", "grasp-audit")
SIM = (
    "--port",
    "sim",
    "--world",
    "runtime.devices.rehearsal:make",
    "--count",
    "1",
    "--time-scale",
    "5",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for package in ("planner", "runtime", "drivers"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text(
            "raise SystemExit('a foreign module was imported')\n"
        )
    return tmp_path


def run(folder: Path, command: str, *words: str) -> None:
    program = Path(sys.executable).with_name(command)
    done = subprocess.run(
        [program, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_start(folder: Path, command: str) -> None:
    run(folder, command, "--help")


def test_a_world_is_the_installed_one(folder: Path) -> None:
    run(folder, Path(sys.executable).name, "-P", "-c", WORLD)


def test_the_simulated_cell_starts_as_well(folder: Path) -> None:
    dump(small_table(), folder / "small.msgpack")
    run(folder, "grasp-runtime", "--tree", "small.msgpack", "--journal", "journal.jsonl", *SIM)
