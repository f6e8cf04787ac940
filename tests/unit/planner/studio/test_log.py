"""What a page shows of a plan's log, even if other programs wrote into the log."""

import json

import pytest

from planner.studio.log import log_of

ANSWER = {
    "verdict": "fair",
    "answer": "Yes.",
    "sentence": "finds it",
    "assumed": ["gripper"],
    "success_rate": 0.99,
    "wrong_rate": 0.004,
    "unresolved_rate": 0.006,
    "reject_rate": 0.0,
    "crashes": 0,
    "trials": 5000,
    "error_mm": {"median": 0.25, "p95": 1.5},
    "seconds_mean": 6.04,
    "mean_squeezes": 2.125,
    "max_squeezes": 4,
}
STEP = {"drawing": "a.dxf", "step": "try", "command": "squeezetree try a.dxf"}


def read(*lines):
    return log_of("\n".join(x if isinstance(x, str) else json.dumps(x) for x in lines).encode())


def progressed(stage, share):
    return {"stage": stage, "share": share, "seconds": 3.0, "left": "left: unknown", "detail": ""}


def test_log_of_progress_is_that_of_the_last_line():
    log = read(STEP, progressed("search", 0.2), progressed("search", 0.4))
    assert (log.step, log.drawing, log.progress["share"], log.exit) == ("try", "a.dxf", 0.4, None)


def test_log_of_answer_becomes_three_numbers():
    numbers = read(STEP, ANSWER).answer["numbers"]
    assert [number["value"] for number in numbers] == ["99 %", "6.0 s", "0.25 mm"]
    assert "0.4 % wrong" in numbers[0]["more"]
    assert "1.50 mm" in numbers[2]["more"]


def test_log_of_messages_are_kept_only_where_a_command_failed():
    line = "plan-try: a.dxf: is no DXF file"
    assert read(STEP, line, {"exit": 3}).lines == [line]
    assert read(STEP, line, {"exit": 0}).lines == []
    assert read(STEP, line, {**STEP, "step": "report"}).lines == []


@pytest.mark.parametrize(
    "line",
    [
        '{"verdict": {}}',
        '{"part": 1, "outcome": 2}',
        "[1, 2]",
        "\x00",
        '{"exit": "x"}',
        '{"exit": 1e999}',
        '{"exit": NaN}',
        f'{{"stage": "s", "share": 0.5, "left": "", "detail": "", "seconds": 1{"0" * 400}}}',
        "[" * 100_000,
        '{"stage": "s", "share": "x", "seconds": []}',
    ],
)
def test_log_of_malformed_line_keeps_the_other_lines(line):
    log = read(STEP, line, progressed("search", 0.5))
    assert log.progress["share"] == 0.5
    json.dumps(log._asdict(), allow_nan=False)


def test_log_of_part_has_the_squeezes_before_its_outcome_once():
    part = {"part": 1, "outcome": "leaf", "path": [0, 1], "widths_mm": [21.0, 30.0]}
    part |= {"predicted_pose": None, "error_mm": None, "within_goal": True}
    first, again, other = (
        {"squeezed": {"before": {"x_mm": x}, "after": {"x_mm": 0.0}, "width_mm": width}}
        for x, width in ((1.0, 21.1), (1.0, 21.0), (2.0, 30.0))
    )
    warm = {"squeezed": {"before": {"x_mm": 0.0}, "after": {"x_mm": 0.0}, "width_mm": 21.0}}
    (shown,) = read(warm, first, again, other, part).parts
    assert [squeeze["width_mm"] for squeeze in shown["squeezes"]] == [21.0, 30.0]
    (lacking,) = read(first, part).parts
    assert lacking["squeezes"] == [first["squeezed"]]  # too few, which `film` refuses
