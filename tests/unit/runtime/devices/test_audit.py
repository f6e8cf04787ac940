"""The auditor's process: one answer per question; a late, broken or ended auditor never stops the cell."""

import sys

import pytest
from programs import WAIT_S

from runtime.devices.audit import AuditProcess
from runtime.shell.errors import UsageError

POSE = (1.0, 2.0, 0.5)
ANSWERS = {
    "pass": """
for line in sys.stdin:
    asked = json.loads(line)
    assert asked == {"part": asked["part"], "x_mm": 1.0, "y_mm": 2.0, "theta_rad": 0.5}
    print(json.dumps({"verdict": "pass" if asked["part"] % 2 else "fail"}), flush=True)
""",
    "of a table": """
for line in sys.stdin:
    asked = json.loads(line)
    run, own = asked.pop("table_sha256"), "ab" * 32
    assert run == own or asked == {"part": 0}
    print(json.dumps({"verdict": "pass", "reason": "\\x1b[2J", "table_sha256": own}), flush=True)
""",
    "twice": """
for line in sys.stdin:
    if json.loads(line)["part"]:
        print('{"verdict": "pass"}\\n{"verdict": "fail"}', flush=True)
    else:
        print('{"verdict": "pass"}', flush=True)
""",
    "flood": """
while True:
    print('{"verdict": "pass"}', flush=True)
""",
    "odd": """
for line in sys.stdin:
    print(json.dumps({"verdict": "maybe", "residual_x_mm": 0.25, "odd": [1], "no name": 1}), flush=True)
""",
    "no verdict": 'sys.stdin.readline(); print("{}", flush=True); sys.stdin.readline()',
    "endless number": 'print(\'{"verdict": "pass", "a": Infinity}\', flush=True); sys.stdin.readline()',
    "nonsense": 'sys.stdin.readline(); print("nonsense", flush=True); sys.stdin.readline()',
    "list": 'sys.stdin.readline(); print("[1]", flush=True); sys.stdin.readline()',
    "gone": "",
    "endless": 'sys.stdin.readline(); print("x" * 200_000, end="", flush=True); sys.stdin.readline()',
    "deaf": "import time; time.sleep(60)",
    "late": """
for line in sys.stdin:
    if json.loads(line)["part"] == 1:
        import time; time.sleep(0.6)
    print(json.dumps({"verdict": "fail" if json.loads(line)["part"] == 1 else "pass"}), flush=True)
""",
}


@pytest.fixture
def auditor(request, tmp_path, monkeypatch):
    monkeypatch.setattr("runtime.devices.child.END_S", 0.05)  # some never end by themselves
    program = tmp_path / "auditor.py"
    program.write_text(f"import json, sys\n{ANSWERS[request.param]}\n")
    with AuditProcess(f"{sys.executable} {program}") as result:
        result._answer_s = 5.0
        yield result


@pytest.mark.parametrize("auditor", ["twice"], indirect=True)
def test_judge_second_answer_to_a_part_is_not_taken_for_the_next_one(auditor):
    auditor.check()
    seen = [auditor.judge(part, POSE) for part in range(1, 5)]
    assert [each["verdict"] for each in seen] == ["pass", "unknown"] * 2
    assert "more than once" in seen[1]["reason"]


@pytest.mark.parametrize("auditor", ["flood"], indirect=True)
def test_judge_auditor_that_never_stops_talking_meets_its_deadline(auditor):
    auditor._answer_s = 0.1
    for part in range(1, 5):
        assert auditor.judge(part, POSE)["verdict"] in ("pass", "unknown")


@pytest.mark.parametrize("auditor", ["pass"], indirect=True)
def test_judge_answers_part_by_part(auditor):
    assert [auditor.judge(part, POSE)["verdict"] for part in (1, 2, 3)] == ["pass", "fail", "pass"]


NO_ANSWERS = ["nonsense", "no verdict", "endless number", "list", "gone", "endless"]


@pytest.mark.parametrize("auditor", NO_ANSWERS, indirect=True)
def test_judge_invalid_answer_is_unknown_before_deadline(auditor):
    auditor._answer_s = WAIT_S
    answer = auditor.judge(1, POSE)
    assert answer["verdict"] == "unknown"
    assert "did not answer" not in str(answer.get("reason"))


@pytest.mark.parametrize("auditor", ["odd"], indirect=True)
def test_judge_keeps_the_plain_fields_of_an_answer(auditor):
    assert auditor.judge(1, POSE) == {"verdict": "unknown", "residual_x_mm": 0.25}


@pytest.mark.parametrize("auditor", ["gone"], indirect=True)
def test_judge_of_ended_auditor_states_its_end(auditor):
    auditor._process.wait(10.0)
    for part in (1, 2):
        assert "auditor has ended" in str(auditor.judge(part, POSE)["reason"])


@pytest.mark.parametrize("auditor", ["late"], indirect=True)
def test_judge_late_answer_is_not_used_for_next_part(auditor):
    auditor._answer_s = 0.2
    assert auditor.judge(1, POSE)["verdict"] == "unknown"
    auditor._answer_s = 10.0
    assert auditor.judge(2, POSE)["verdict"] == "pass"


@pytest.mark.parametrize("auditor", ["deaf"], indirect=True)
def test_close_deaf_auditor_ends_by_signal(auditor):
    auditor.close()
    assert auditor._process.returncode in (-15, -9)


@pytest.mark.parametrize("command", ["/no/such/program", "", "'unclosed"])
def test_audit_process_that_cannot_start_is_usage_error(command):
    with pytest.raises(UsageError, match="cannot be started"):
        AuditProcess(command)


@pytest.mark.parametrize("auditor", ["of a table"], indirect=True)
def test_check_auditor_of_another_table_is_refused(auditor):
    auditor._common = {"table_sha256": "ab" * 32}
    auditor.check()
    assert auditor.judge(1, POSE)["verdict"] == "pass"
    assert "reason" not in auditor.judge(1, POSE)  # an escape sequence is no sentence
    auditor._common = {"table_sha256": "cd" * 32}
    with pytest.raises(UsageError, match=r"judges by another table, .* abab.*same --tree"):
        auditor.check()
