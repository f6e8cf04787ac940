"""A wrong word: answers that are lost, arguments and files that are odd: no traceback, no false 0."""

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

Tell = Callable[..., Ended]


@pytest.fixture
def tell(tmp_path: Path, monkeypatch) -> Tell:
    """Runs a command in `tmp_path`, as a process where `shell` redirects, and checks what holds then."""
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


def refused(tell: Tell, entry: tuple[str, str], *words: object, **how: object) -> str:
    """The one line that a command says, which answers nothing."""
    seen = tell(entry, *words, **how)
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
def test_a_run_whose_answers_are_lost_ends_in_order_or_does_not_begin(
    tell: Tell, tmp_path: Path, shell: str, code: int, message: str
) -> None:
    _, _, err = tell(RUNTIME, *simulated(tmp_path), code=code, shell=shell)
    assert "".join(err.splitlines()[-1:]).startswith(message)
    assert bool(err) == bool(message)
    journal = tmp_path / "squeezetree-journal.jsonl"
    assert not journal.exists() if message == CLOSED else verify(journal).closed


@pytest.mark.parametrize("stream", ["<&- 2>&-", "2>/dev/full"])
def test_other_streams_may_be_closed(tell: Tell, journal: Path, stream: str) -> None:
    before = journal.read_bytes()
    tell(JOURNAL, "verify", journal, code=0, shell=stream)
    tell(JOURNAL, "show", "none", code=24, shell=stream)
    assert journal.read_bytes() == before


@pytest.mark.parametrize(
    "words", [["verify", "j.jsonl"], ["show", "--help"], ["replay", "j.jsonl", "--json"]]
)
def test_an_answer_that_is_lost_is_no_success(tell: Tell, journal: Path, words: list[str]) -> None:
    err = refused(tell, JOURNAL, *words, code=2, shell=">/dev/full")
    assert "output cannot be written: No space left" in err


def test_report_keeps_its_code_and_its_peace_when_the_reader_goes(tell, journal) -> None:
    code, _, err = tell(REPORT, journal, shell="| head -c 1 >/dev/null")
    assert err == ""
    assert code in (0, 11)
    assert tell(REPORT, journal)[0] == code


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--outcome", "zzz"], "invalid choice: 'zzz'"),
        (["--since", "never"], "'never' is no date"),
        (["--part", "-1"], "'-1' is less than 0"),
        (["--node", "x"], "'x' is not a whole number"),
    ],
)
def test_show_of_filters_that_no_record_could_pass_is_usage(tell, journal, words, message) -> None:
    assert message in refused(tell, JOURNAL, "show", journal, *words, code=2)


def test_every_command_tells_wrong_arguments_in_one_line(capsys) -> None:
    every = [*parsers().values()]
    for result in every:  # grows while it is walked
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


def test_an_odd_delivery_is_refused_before_a_part(tell: Tell, tmp_path: Path) -> None:
    (tmp_path / "d.toml").write_text("delivery = 3")
    _, _, err = tell(RUNTIME, *simulated(tmp_path, "--deliver", "d.toml"), code=3)
    assert err.splitlines()[-1].startswith("grasp-runtime: --deliver d.toml")
    assert not (tmp_path / "squeezetree-journal.jsonl").exists()


def sealed(fields: dict[str, object], text: str = "") -> bytes:
    """A journal line whose digest is right, whatever stands in it."""
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
def test_odd_journals_do_not_verify(tell: Tell, tmp_path: Path, line: bytes) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(line)
    for entry, words in ((JOURNAL, ["show", path]), (JOURNAL, ["replay", path]), (REPORT, [path])):
        refused(tell, entry, *words, code=24)
    assert path.read_bytes() == line


@pytest.mark.parametrize("world", ["os:getcwd", "sys:exit", "this.is.no:module", "antigravity.:x"])
def test_a_world_that_is_none_is_a_sentence(tell: Tell, world: str) -> None:
    _, _, err = tell(EVALUATE, TABLE, "--trials", "10", "--world", world, code=2)
    assert err.count("\n") == 1
    assert world.partition(":")[0] in err


@pytest.mark.parametrize("missing", ["tree", "calibration", "tag"])
def test_a_judge_without_its_files_ends_with_what_is_missing(tell: Tell, tmp_path, missing) -> None:
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
    assert missing in refused(tell, audit, *words, code=3, shell="</dev/null")


def test_the_unforeseen_is_one_broad_sentence(monkeypatch, tell: Tell) -> None:
    from runtime import cli
    from runtime.commands import recipe

    def broken(path: Path) -> None:
        raise ZeroDivisionError("of\nnothing")

    monkeypatch.setattr(recipe, "load", broken)
    err = refused(tell, RUNTIME, "--tree", "t", "--check", code=1)
    assert "internal error, please report it: ZeroDivisionError: of nothing" in err
    assert "Traceback" in called(cli.main, "--tree", "t", "--check", "--debug").err
