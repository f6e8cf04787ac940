"""Entry points of the commands: plain mistakes in the arguments are refused before anything is loaded."""

import subprocess
import sys

import pytest

from runtime.commands.arguments import parser as runtime_arguments
from runtime.commands.doctor import parser as doctor_arguments
from runtime.commands.squeezetree import PROGRAMS

BLOCK = "import sys; from planner import commands; code = getattr(commands, {0!r})(); "
LOADED = "print('numba' in sys.modules); sys.exit(code)"
CALLS = {
    "compile_job": ["nope.toml", "-o", "t.msgpack"],
    "simulate": ["there.toml", "--poses", "nope.csv", "-o", "o.csv"],
}


@pytest.mark.parametrize("name", CALLS)
def test_commands_missing_file_exits_before_numba_is_loaded(name, tmp_path):
    (tmp_path / "there.toml").touch()
    code = BLOCK.format(name) + LOADED
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *CALLS[name]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout.strip()) == (3, "False")
    assert done.stderr.startswith("plan-")
    assert "nope." in done.stderr
    assert "No such file" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("word", ["simm", "Sim", "siim", "manuel"])
@pytest.mark.parametrize("arguments", [runtime_arguments, doctor_arguments])
def test_parser_misspelt_port_exits_and_suggests_the_right_one(word, arguments, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        arguments().parse_args(["--tree", "t.msgpack", "--port", word])
    assert ended.value.code == 2
    err = capsys.readouterr().err
    assert f"is {'manual' if word == 'manuel' else 'sim'} meant?" in err
    assert err.count("\n") == 1
    assert PROGRAMS["run"].name in err or PROGRAMS["doctor"].name in err
