"""The option --takt of the planner's commands: the share of parts that are done within a stated time."""

import pytest
from programs import called, document
from rectangle import JOB_PATH, TABLE_PATH

from planner.cli import compile as compile_
from planner.cli import evaluate

pytestmark = pytest.mark.slow
TABLE, JOB = str(TABLE_PATH), str(JOB_PATH)
FEW = ["--trials", "400"]
SECONDS = [f"seconds_{name}" for name in ("mean", "p50", "p95", "p99", "max")]


def test_evaluate_takt_states_the_share_of_parts_within_it() -> None:
    def figures(*more: str) -> dict[str, float]:
        return document(evaluate.main, TABLE, *FEW, "--json", *more)

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


@pytest.mark.parametrize(
    ("main", "words", "reason"),
    [
        (evaluate.main, [TABLE, "--ppm"], "--ppm"),
        (compile_.main, [JOB, "--baseline", "sensorless"], "--baseline"),
    ],
)
def test_takt_where_no_part_is_timed_is_refused(main, words: list[str], reason: str) -> None:
    ended = called(main, *words, "--takt", "6s")
    assert (ended.code, ended.one_line) == (2, True)
    assert reason in ended.err
