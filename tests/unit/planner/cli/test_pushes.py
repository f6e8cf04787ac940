"""`plan-simulate --push` turns a file of pushes into a file of motions; errors are one line."""

import math

import pytest
from push_commands import HEADER, JOB, NOMINAL, OUTPUTS, STRAIGHT, run

from planner.errors import KeyNameError
from runtime.shell.errors import InputError


def test_simulate_push_straight_moves_the_part_in_the_outline_frame(tmp_path):
    """The part is wider than the opening of 85 mm, which does not matter to a push."""
    text = f"run,{HEADER},fingers_mm,moved_x_mm\nr1,{STRAIGHT},50,99\n"
    code, rows, out, err = run(tmp_path, text, *NOMINAL)
    assert (code, err) == (0, "")
    assert "1 push: 1 stuck" in out
    assert list(rows[0]) == [*HEADER.split(","), "fingers_mm", "shift_x_mm", "shift_y_mm", *OUTPUTS]
    angle = math.radians(0.4)  # of the centroid (50, 50) about (-5000, 0)
    expected = [
        5050 * (math.cos(angle) - 1) - 50 * math.sin(angle),
        5050 * math.sin(angle) + 50 * (math.cos(angle) - 1),
        0.4,
    ]
    assert [float(rows[0][name]) for name in OUTPUTS[:3]] == pytest.approx(expected, abs=1e-3)
    assert rows[0]["status"] == "stuck"


def test_simulate_push_shifted_outline_and_pushes_give_equal_motion(tmp_path):
    text = f"{HEADER}\n30,0,0,1,160,40,-20\n0,100,1,0,40,200,15\n"
    _, rows, _, _ = run(tmp_path, text, *NOMINAL, "--fingers-mm", "50")
    moved_job = JOB.replace(
        "[[0, 0], [150, 0], [0, 150]]", "[[-7, 20], [-7, 170], [143, 20]]"
    ).replace("[[30, 30], [90, 30], [30, 90]]", "[[23, 50], [83, 50], [23, 110]]")
    moved = f"{HEADER}\n23,20,0,1,153,60,-20\n-7,120,1,0,33,220,15\n"
    _, others, _, _ = run(tmp_path, moved, *NOMINAL, "--fingers-mm", "50", job=moved_job)
    for name in OUTPUTS[:3]:
        wanted = [float(row[name]) for row in rows]
        assert [float(row[name]) for row in others] == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        (f"{HEADER}\n{STRAIGHT}\n", KeyNameError, "fingers_mm is missing"),
        ("push_x_mm\n1\n", KeyNameError, "push_y_mm, approach_x"),
        (f"{HEADER},fingers_mm\n{STRAIGHT},x\n", InputError, "line 2: 'x' is not a finite number"),
        (f"{HEADER},fingers_mm\n{STRAIGHT},-1\n", InputError, "fingers_mm: push 1: -1 is no"),
        (f"{HEADER},fingers_mm\n50,0,0,0,1,1,1,50\n", InputError, "push 1: both are 0"),
        (f"{HEADER},fingers_mm\n50,0,0,1,1e9,1,1,50\n", InputError, "cor_x_mm: push 1: 1e+09 is"),
        (
            f"{HEADER},fingers_mm\n{STRAIGHT},50\n50,20,0,1,1,1,1,0\n",
            InputError,
            "push 2: a finger",
        ),
        (f"{HEADER},fingers_mm\n{STRAIGHT}," + "5" * 200_000, InputError, "not a CSV file"),
    ],
)
def test_simulate_push_invalid_file_is_refused_in_one_line(tmp_path, text, error, words):
    code, rows, _, err = run(tmp_path, text, *NOMINAL)
    assert code == error.exit_code
    assert words in err
    assert "in.csv" in err
    assert err.count("\n") == 1
    assert rows == []
