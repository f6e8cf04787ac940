"""`squeezetree try --gripper all`: one line for each gripper, as text or JSON; no files are written."""

from types import SimpleNamespace

import pytest
from programs import document

from planner.cli import first_look, first_plan, gripper_comparison
from planner.errors import NoPlanError
from planner.job.drafts import GRIPPERS

FIGURES = {"success_rate": 0.975, "mean_squeezes": 2.25, "seconds_mean": 5.5}
FIGURES["error_mm"] = {"median": 0.2, "p95": 0.9}


@pytest.fixture(autouse=True)
def _planned(monkeypatch):
    """Replaces planning: it fails with a Hand-E, and gives the same figures with all other grippers."""

    def planned(job, *_):
        if job.gripper.model == "hand-e":
            raise NoPlanError(f"no leaf comes within 3 mm; {'add actions, or ' * 9}ask for less")
        return SimpleNamespace(evaluation=SimpleNamespace(summary=lambda: FIGURES))

    monkeypatch.setattr(first_plan, "planned_within", planned)


def test_compare_prints_a_line_for_each_gripper_and_writes_nothing(plate, capsys):
    assert first_look.main([str(plate), "--units", "mm", "--gripper", "all"]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = lines[lines.index(gripper_comparison.HEAD) + 1 :]
    assert all(len(line) <= 80 for line in table)
    assert "ask for less" in " ".join(" ".join(table).split())
    table = [line for line in table if not line.startswith(" ")]
    assert [line.split()[0] for line in table] == [*GRIPPERS]
    for line in table:
        wanted = "no leaf comes within" if line.startswith("hand-e") else "97.50%"
        assert wanted in line
    assert [path.name for path in plate.parent.iterdir()] == ["plate.csv"]


def test_compare_large_part_names_each_gripper_too_small_for_it(plate):
    plate.write_text("0,0\n60,0\n60,40\n0,40\n")
    words = [plate, "--units", "mm", "--gripper", "all", "--json"]
    rows = document(first_look.main, *words)["grippers"]
    assert [row["gripper"] for row in rows] == [*GRIPPERS]
    small = [row["gripper"] for row in rows if "too little for the part" in row.get("reason", "")]
    assert {"hand-e", "dh-pgc140-50", "schunk-egk"} <= set(small) < set(GRIPPERS)
