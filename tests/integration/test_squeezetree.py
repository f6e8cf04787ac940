"""`squeezetree COMMAND` starts the program of that name, and `squeezetree try` answers unattended."""

import json
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_parsers import parsers
from documents import COMMANDS
from programs import ROOT, called, ended

from planner.cli import first_look, first_plan
from planner.job import model as job_file
from planner.report.answer import Answer
from planner.report.verdict import Verdict
from runtime import VERSION
from runtime.commands import squeezetree
from runtime.commands.squeezetree import PROGRAMS
from runtime.table import load

WITHOUT_NUMPY = """
import sys
sys.modules["numpy"] = None
from runtime.commands.squeezetree import main
sys.argv[0] = "squeezetree"
sys.exit(main())
"""
ORDER = "try studio init plan evaluate report doctor calibrate run cell serve journal audit"
Calls = list[list[str]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """Replaces the installed programs by stand-ins; a list collects the arguments of the calls."""
    result: Calls = []

    entry = SimpleNamespace(load=lambda: lambda: result.append(sys.argv) or 7)
    installed = SimpleNamespace(
        entry_points=SimpleNamespace(select=lambda **_: dict.fromkeys(COMMANDS, entry))
    )
    monkeypatch.setattr(squeezetree.metadata, "distribution", lambda _: installed)
    monkeypatch.setattr(sys, "argv", ["squeezetree"])
    return result


def test_squeezetree_programs_equal_installed_commands() -> None:
    assert {"squeezetree", *(program.name for program in PROGRAMS.values())} == set(COMMANDS)
    assert parsers().keys() == COMMANDS.keys()


def test_squeezetree_help_lists_programs_in_order_of_use() -> None:
    assert " ".join(PROGRAMS).startswith(ORDER)
    result = called(squeezetree.main, "--help").out
    places = [result.index(f"\n  {word} ") for word in PROGRAMS]
    assert places == sorted(places)


def test_squeezetree_passes_arguments_and_returns_exit_code(calls: Calls) -> None:
    assert squeezetree.main(["journal", "show", "--json", "J"]) == 7
    assert squeezetree.main(["serve", "tcp://127.0.0.1:0", "--tree", "T"]) == 7
    assert squeezetree.main(["serve", "--help"]) == 7
    assert calls == [
        ["grasp-journal", "show", "--json", "J"],
        ["grasp-runtime", "--serve", "tcp://127.0.0.1:0", "--tree", "T"],
        ["grasp-runtime", "--help"],
    ]


def test_squeezetree_version_equals_distribution() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == VERSION
    assert called(squeezetree.main, "--version").out == f"squeezetree {VERSION}\n"


def test_squeezetree_without_numpy_refuses_in_one_line_with_code() -> None:
    for words, code, said in (
        (("journal", "show", "none.jsonl"), 24, "none.jsonl"),
        (("try", "part.dxf"), 2, "squeezetree[planner]"),
        (("evalute", "part.dxf"), 2, "is evaluate meant?"),
    ):
        done = ended([sys.executable, "-c", WITHOUT_NUMPY, *words])
        assert (done.code, done.out, done.one_line) == (code, "", True)
        assert said in done.err


QUICK = ["--radius", "2", "--turn", "8", "--budget", "2s"]


@pytest.mark.slow
def test_try_answers_and_writes_files_even_if_extras_fail(plate, monkeypatch):
    code, out, _ = called(first_look.main, plate, *QUICK, "--json")
    assert code == 0
    record = json.loads(out)
    assert record["locatable"] is True
    assert record["size_mm"] == pytest.approx([30.0, 21.0])
    assert any("1 mm" in line for line in record["assumed"])  # the file names no unit
    assert 0.0 <= record["error_mm"]["median"] <= record["error_mm"]["p95"]
    assert record["weakest"]["wrong"] >= 0.0
    assert Path(record["picture"]).read_text().count("<svg") == 1
    job = job_file.load(Path(record["job"]))
    assert (job.uncertainty.radius_mm, job.gripper.model) == (2.0, "robotiq-2f-85")
    quick = job.replaced(search=first_plan.QUICK)
    assert load(Path(record["table"])).table.job_digest == quick.digest()
    rates = [record[f"{how}_rate"] for how in ("success", "wrong", "unresolved", "reject")]
    assert sum(rates) + record["crashes"] / record["trials"] == pytest.approx(1.0)
    assert record["notes"] == []
    # Neither a picture nor advice nor a sweep that fails prevents the answer; another job is not overwritten.

    def fail(*_: object, **__: object) -> None:
        raise ValueError("no path of 1, 2, 3 squeezes")

    monkeypatch.setattr(first_look.paper_figures, "sequence", fail)
    for name in ("tried", "advise"):
        monkeypatch.setattr(first_look, name, fail)
    code, out, err = called(first_look.main, plate, *QUICK, "--fingers", "steel")
    assert code == 0
    assert "Can it be located by squeezing? Yes" in out
    assert "internal error" not in out + err
    assert out.index("located ") < out.index("no picture: ValueError: no path of 1, 2, 3 squeezes")
    assert "note       no other worlds" in out
    assert "plate-2.look.svg" not in out
    assert "wrote plate-2.toml" in out
    assert Path("plate.toml").read_text() != Path("plate-2.toml").read_text()


def test_try_part_too_large_for_grippers_answers_no(plate: Path) -> None:
    plate.write_text("0,0\n300,0\n300,200\n0,200\n")
    code, out, _ = called(first_look.main, plate, "--units", "mm")
    assert code == 0
    assert "Can it be located by squeezing? No:" in out


LARGER = "with a robotiq-2f-140"


@pytest.mark.parametrize(
    ("length", "width", "restrictions"),
    [
        (30, 20, []),
        (60, 20, ["within 8 mm of the expected place"]),
        (80, 60, [LARGER]),
        (110, 60, [LARGER, "within 5 mm of the expected place"]),
        (140, 110, [LARGER, "within 1 mm of the expected place"]),
    ],
)
def test_setting_of_large_part_restricts_gripper_and_radius_in_answer(
    length: int, width: int, restrictions: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "plate.csv"
    path.write_text(f"0,0\n{length},0\n{length},{width}\n0,{width}\n")
    arguments = first_look.parser().parse_args([str(path), "--units", "mm"])
    setting = first_plan.setting_of(arguments, first_plan.imported_of(arguments)[0])
    assert setting.answers.gripper == f"robotiq-2f-{140 if LARGER in restrictions else 85}"
    assert setting.restrictions == restrictions
    rates = {"success_rate": 0.995, "wrong_rate": 0.001, "unresolved_rate": 0.004}
    figures = {"trials": 4000, "crashes": 0, "reject_rate": 0.0, **rates}
    result = Verdict("fair", "", "", ["friction stays below 1.35"], [])
    answer = Answer("fair", result, figures, 4, None, [], setting.restrictions, 0.99)
    limits = "".join(f"{', ' if not k else ' and '}{text}" for k, text in enumerate(restrictions))
    assert answer.short_text() == f"Yes{limits}, if friction stays below 1.35."
    assert "for 99.5 % of the parts" in answer._replace(confidence=0.999).short_text()
    assert answer._replace(short="unknown").short_text().startswith("Not known yet")


def test_try_sheet_too_thin_for_finger_tips_answers_no(plate, monkeypatch) -> None:
    read = first_plan.read_outline
    thin = lambda *words: read(*words)._replace(height_mm=0.5)  # noqa: E731
    monkeypatch.setattr(first_plan, "read_outline", thin)
    code, out, _ = called(first_look.main, plate, "--units", "mm")
    assert code == 0
    assert "squeezing? No: it is 0.5 mm thin" in out
