"""Folders named like our packages, where a command is started, are not taken for them."""

import sys
from pathlib import Path

import pytest
from programs import REHEARSAL, ended

WORLD = "from runtime.shell.worlds import find_factory; find_factory('planner.world:make')"
RUN = "--tree small.msgpack --journal journal.jsonl --port sim --time-scale 20"


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("plan-init", ["--help"]),
        ("grasp-audit", ["--help"]),
        (Path(sys.executable).name, ["-P", "-c", WORLD]),
        # It starts a cell, too.
        ("grasp-runtime", [*RUN.split(), *REHEARSAL]),
    ],
)
def test_command_beside_foreign_folders_starts(
    program: str, words: list[str], tree: Path, tmp_path: Path
) -> None:
    for package in ("planner", "runtime", "drivers"):
        (tmp_path / package).mkdir()
        foreign = "raise SystemExit('a foreign module was imported')\n"
        (tmp_path / package / "__init__.py").write_text(foreign)
    done = ended([Path(sys.executable).with_name(program), *words], cwd=tmp_path)
    assert done.code == 0, done.err
