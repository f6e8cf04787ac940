"""Folders named like our packages, where a command is started, are not taken for them."""

import subprocess
import sys
from pathlib import Path

import pytest
from sample_tables import small_table

from runtime.table import dump

WORLD = "from runtime.shell.worlds import find_factory; find_factory('planner.world:make')"
RUN = "--tree small.msgpack --journal journal.jsonl --port sim --time-scale 20"


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("plan-init", ["--help"]),
        ("grasp-audit", ["--help"]),
        (Path(sys.executable).name, ["-P", "-c", WORLD]),
        # It starts a cell, too.
        ("grasp-runtime", [*RUN.split(), "--world", "runtime.devices.rehearsal:make"]),
    ],
)
def test_command_beside_foreign_folders_starts(
    program: str, words: list[str], tmp_path: Path
) -> None:
    for package in ("planner", "runtime", "drivers"):
        (tmp_path / package).mkdir()
        foreign = "raise SystemExit('a foreign module was imported')\n"
        (tmp_path / package / "__init__.py").write_text(foreign)
    dump(small_table(), tmp_path / "small.msgpack")
    command = [Path(sys.executable).with_name(program), *words]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
