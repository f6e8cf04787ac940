"""Lost output, wrong arguments and malformed files end without a traceback or a false exit code 0."""

import hashlib
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from command_parsers import parsers, subcommands
from programs import REHEARSAL, ROOT, TABLE, Ended, called, ended
from run_logs import chained
from sample_tables import small_table
from written_journals import write_run

from runtime.journal.chain import verify
from runtime.table import dump

RUNTIME = ("runtime.cli", "main")
JOURNAL = ("runtime.commands.journal", "main")
REPORT = ("runtime.spc.command", "main")
EVALUATE = ("planner.cli.evaluate", "main")

Execute = Callable[..., Ended]


@pytest.fixture
def execute(tmp_path: Path, monkeypatch) -> Execute:
    """A function that runs a command in `tmp_path` and checks its exit code and standard error.

    Without `shell` the command is called in this process. With it, bash runs the command as a process, and
    `shell` is what follows the command in the line, such as a redirection.
    """
    monkeypatch.chdir(tmp_path)

    def run(entry: tuple[str, str], *words: object, code: int | None = None, shell="") -> Ended:
        module, function = entry
        if shell:
            call = f"import sys; from {module} import {function}; sys.exit({function}())"
            line = ["bash", "-o", "pipefail", "-c", f'"$@" {shell}', "bash"]
            environment = {**os.environ, "PYTHONPATH": str(ROOT)}
            words = (sys.executable, "-c", call, *words)
            seen = ended([*line, *words], cwd=tmp_path, env=environment)
        else:
            seen = called(getattr(import_module(module), function), *words)
        assert "Traceback" not in seen.err, seen.err
        assert code is None or seen.code == code, seen
        return seen

    return run


def refused(execute: Execute, entry: tuple[str, str], *words: object, **how: object) -> str:
    """Checks that a command prints one line of error and nothing else; returns the line."""
    seen = execute(entry, *words, **how)
    assert (seen.out, seen.one_line) == ("", True), seen
    return seen.err


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return write_run(tmp_path / "j.jsonl")


def simulated(tmp_path: Path, *words: str) -> list[object]:
    dump(small_table(), tmp_path / "t.msgpack")
    given = ("--port", "sim", *REHEARSAL, "--time-scale", "100", "--count", "2")
    return ["--tree", "t.msgpack", *given, *words]


NO_SPACE = "grasp-runtime: output cannot be written: No space left on device"
CLOSED = "grasp-runtime: standard output is closed; send it to a file, or to /dev/null"


@pytest.mark.parametrize(
    ("shell", "code", "message"),
    [(">/dev/full", 2, NO_SPACE), ("| head -1", 0, ""), (">&-", 2, CLOSED)],
)
def test_grasp_runtime_lost_output_closes_journal_or_starts_no_run(
    execute: Execute, tmp_path: Path, shell: str, code: int, message: str
) -> None:
    _, _, err = execute(RUNTIME, *simulated(tmp_path), code=code, shell=shell)
    assert "".join(err.splitlines()[-1:]).startswith(message)
    assert bool(err) == bool(message)
    journal = tmp_path / "squeezetree-journal.jsonl"
    assert not journal.exists() if message == CLOSED else verify(journal).closed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--journal", ""), "'' is no name of a file"),
        (("--journal", "/"), "'/' is no name of a file"),
        (("--tips=57.15,inf",), "--tips 57.15,inf: write"),
        (("--tips=nan,0",), "--tips nan,0: write"),
        (("--tips=57.15,68",), "--tips 57.15,68: write"),
    ],
)
def test_grasp_runtime_word_without_a_meaning_is_refused_before_a_run(
    execute: Execute, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    assert message in refused(execute, RUNTIME, *simulated(tmp_path, *words), code=2)
    assert not (tmp_path / "squeezetree-journal.jsonl").exists()


@pytest.mark.parametrize("stream", ["<&- 2>&-", "2>/dev/full"])
def test_grasp_journal_closed_stdin_or_stderr_keeps_exit_code(
    execute: Execute, journal: Path, stream: str
) -> None:
    before = journal.read_bytes()
    execute(JOURNAL, "verify", journal, code=0, shell=stream)
    execute(JOURNAL, "show", "none", code=24, shell=stream)
    assert journal.read_bytes() == before


@pytest.mark.parametrize(
    "words", [["verify", "j.jsonl"], ["show", "--help"], ["replay", "j.jsonl", "--json"]]
)
def test_grasp_journal_lost_output_exits_2(
    execute: Execute, journal: Path, words: list[str]
) -> None:
    err = refused(execute, JOURNAL, *words, code=2, shell=">/dev/full")
    assert "output cannot be written: No space left" in err


def test_grasp_audit_report_closed_pipe_keeps_exit_code_and_is_silent(execute, journal) -> None:
    code, _, err = execute(REPORT, journal, shell="| head -c 1 >/dev/null")
    assert err == ""
    assert code in (0, 11)
    assert execute(REPORT, journal)[0] == code


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--outcome", "zzz"], "invalid choice: 'zzz'"),
        (["--since", "never"], "'never' is no date"),
        (["--part", "-1"], "'-1' is less than 0"),
        (["--node", "x"], "'x' is not a whole number"),
    ],
)
def test_grasp_journal_show_invalid_filter_is_usage_error(execute, journal, words, message) -> None:
    assert message in refused(execute, JOURNAL, "show", journal, *words, code=2)


def test_parsers_wrong_arguments_are_refused_in_one_line(capsys) -> None:
    every = [*parsers().values()]
    for result in every:  # the list grows in this loop
        every += subcommands(result).values()
    for result in every:
        for words in (["--no\nsuch\x1b[2J"], ["--debug=3", "\udcff"]):
            with pytest.raises(SystemExit) as ended:
                result.parse_args(words)
            err = capsys.readouterr().err
            assert ended.value.code == 2
            assert err.count("\n") == 1, err
            assert err.startswith(f"{result.prog}: ")
            assert "\x1b" not in err


def test_grasp_runtime_invalid_delivery_is_refused_before_journal(
    execute: Execute, tmp_path: Path
) -> None:
    (tmp_path / "d.toml").write_text("delivery = 3")
    _, _, err = execute(RUNTIME, *simulated(tmp_path, "--deliver", "d.toml"), code=3)
    assert err.splitlines()[-1].startswith("grasp-runtime: --deliver d.toml")
    assert not (tmp_path / "squeezetree-journal.jsonl").exists()


def sealed(fields: dict[str, object], text: str = "") -> bytes:
    """A journal line with a correct digest and any content."""
    if not text:
        return chained([{"kind": "part", **fields}])
    body = text.encode()
    return body[:-1] + b',"digest":"' + hashlib.sha256(body).hexdigest().encode() + b'"}\n'


@pytest.mark.parametrize(
    "line",
    [
        sealed({"seq": "0"}),
        sealed({"seq": True}),
        sealed({"kind": ["header"]}),
        sealed({"kind": {"a": 1}}),
        sealed({"time": 7}),
        sealed({"kind": "header", "journal_version": 1, "calibration_um": [{}]}),
        sealed({}, '{"part":' + "[" * 20_000 + "]" * 20_000 + "}"),
        sealed({}, '{"part":' + "9" * 5000 + "}"),
    ],
    ids=["seq-text", "seq-true", "kind-list", "kind-object", "time", "widths", "deep", "digits"],
)
def test_journal_malformed_record_is_refused_in_one_line(
    execute: Execute, tmp_path: Path, line: bytes
) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(line)
    for entry, words in ((JOURNAL, ["show", path]), (JOURNAL, ["replay", path]), (REPORT, [path])):
        refused(execute, entry, *words, code=24)
    assert path.read_bytes() == line


@pytest.mark.parametrize("world", ["os:getcwd", "sys:exit", "this.is.no:module", "antigravity.:x"])
def test_plan_evaluate_invalid_world_is_refused_in_one_line(execute: Execute, world: str) -> None:
    _, _, err = execute(EVALUATE, TABLE, "--trials", "10", "--world", world, code=2)
    assert err.count("\n") == 1
    assert world.partition(":")[0] in err


@pytest.mark.parametrize("missing", ["tree", "calibration", "tag"])
def test_judge_missing_file_is_refused_by_name(execute: Execute, tmp_path, missing) -> None:
    pytest.importorskip("cv2")
    from cameras import camera, part_tag, true_calibration

    from drivers.camera.calibration import file as calibration
    from drivers.camera.vision import tag_file

    calibration.save(true_calibration(camera()), tmp_path / "calibration")
    tag_file.save(part_tag(), tmp_path / "tag", "2026-01-01T00:00:00+00:00")
    (tmp_path / "tree").write_bytes(TABLE.read_bytes())
    (tmp_path / missing).unlink()
    files = [word for name in ("tree", "calibration", "tag") for word in (f"--{name}", name)]
    words = ["judge", *files, "--camera", "/dev/video99"]
    audit = ("drivers.camera.commands", "audit")
    assert missing in refused(execute, audit, *words, code=3, shell="</dev/null")


def test_grasp_runtime_internal_error_is_one_line_unless_debug(
    monkeypatch, execute: Execute
) -> None:
    from runtime import cli
    from runtime.commands import recipe

    def broken(path: Path) -> None:
        raise ZeroDivisionError("of\nnothing")

    monkeypatch.setattr(recipe, "load", broken)
    err = refused(execute, RUNTIME, "--tree", "t", "--check", code=1)
    assert "internal error, please report it: ZeroDivisionError: of nothing" in err
    assert "Traceback" in called(cli.main, "--tree", "t", "--check", "--debug").err
