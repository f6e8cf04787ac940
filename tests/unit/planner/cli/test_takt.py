"""--takt of the planner's commands: the share of parts that the table's model of time has done within it."""

import json
from pathlib import Path

import pytest

from planner.cli import compile as compile_
from planner.cli import evaluate

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[4] / "trees" / "rectangle"
TABLE, JOB = str(FOLDER / "rectangle.msgpack"), str(FOLDER / "job.toml")
FEW = ["--trials", "400"]
SECONDS = [f"seconds_{name}" for name in ("mean", "p50", "p95", "p99", "max")]


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The rectangle in a cell that is not doubted, with a rough search."""
    path = tmp_path_factory.mktemp("takt") / "quick.toml"
    text = (FOLDER / "job.toml").read_text().replace("chance = 0.8", "chance = 0.0")
    path.write_text(text + "\n[search]\nparticles = 1500\nsearch_particles = 60\n")
    return str(path)


def test_evaluate_tells_the_share_within_the_takt(capsys: pytest.CaptureFixture[str]) -> None:
    def figures(*more: str) -> dict[str, float]:
        assert evaluate.main([TABLE, *FEW, "--json", *more]) == 0
        return json.loads(capsys.readouterr().out)

    plain = figures()
    assert [plain[name] for name in SECONDS[1:]] == sorted(plain[name] for name in SECONDS[1:])
    assert "takt_probability" not in plain
    for name, least, most in (("p50", 0.5, 1.0), ("max", 1.0, 1.0)):
        takt = plain[f"seconds_{name}"]
        timed = figures("--takt", f"{takt!r}s")
        assert timed["takt_s"] == takt
        assert least <= timed["takt_probability"] <= most
        assert [timed[each] for each in SECONDS] == [plain[each] for each in SECONDS]
    assert figures("--takt", "0.01s")["takt_probability"] == 0.0


def test_compile_tells_the_share_within_the_takt(
    quick: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [quick, *FEW, "--no-advice", "--takt", "3600s"]
    assert compile_.main([*words, "-o", str(tmp_path), "--vary", "seed=5", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["jobs"]
    assert (row["takt_s"], row["takt_probability"]) == (3600.0, 1.0)
    assert set(SECONDS) <= row.keys()


@pytest.mark.parametrize(
    ("main", "words", "reason"),
    [
        (evaluate.main, [TABLE, "--ppm"], "--ppm"),
        (compile_.main, [JOB, "--baseline", "sensorless"], "--baseline"),
    ],
)
def test_takt_where_no_part_is_timed_is_refused(
    main, words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--takt", "6s"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert reason in err
