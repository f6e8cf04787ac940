"""`grasp-runtime --serve` gives a robot the answers of a driven run, as tools/docs/serve.md says."""

import re
import shutil
import signal
import socket
import time
from collections.abc import Callable
from math import degrees
from pathlib import Path
from random import Random

import pytest
from asking_robots import CLIENTS, WAIT_S, Controller, Line, Served, SimulatedRobot, client, driven
from programs import ROOT, TABLE
from sample_tables import every_field_table, small_table
from soaking import small_setting
from written_journals import assert_sound

from runtime.execution.asked import ERRORS, MAX_LINE, VERSION
from runtime.journal.chain import Journal
from runtime.table import dump

PARTS = 12
POSE = ("x_mm", "y_mm", "theta_rad")


def asked(locate: Callable[..., object], robot: SimulatedRobot, parts: int) -> list[object]:
    """The answers that `locate`, a client's function, gets for a number of parts."""
    lines = []
    for _ in range(parts):
        robot.cell.scene.next_part()
        lines.append(locate(robot))
    return lines


def asked_in_python(served: Served, robot: SimulatedRobot, parts: int) -> list[object]:
    """The answers of the documented client in Python; for a leaf, its number comes first."""
    module = client()
    connection = module.Connection("127.0.0.1", served.port)
    with connection.lines:
        return asked(lambda robot: module.locate(connection, robot), robot, parts)


def asked_in_structured_text(served: Served, robot: SimulatedRobot, parts: int) -> list[object]:
    """The answers of the documented client in structured text."""
    with Line(served) as line:
        return asked(Controller(line).locate, robot, parts)


@pytest.mark.parametrize(
    ("ask", "table", "outcomes"),
    [
        (asked_in_python, small_table(), {"leaf", "unresolved"}),
        (asked_in_structured_text, every_field_table(), {"leaf", "reject"}),
    ],
    ids=["in Python", "in structured text with drags"],
)
def test_serve_asking_robot_gets_answers_of_driven_run(ask, table, outcomes, tmp_path):
    tree = tmp_path / "t.msgpack"
    dump(table, tree)
    with Journal(tmp_path / "driven.jsonl", lambda: "") as journal:
        expected = driven(small_setting(), 5, table, PARTS, journal)
    with Served(tree, "--count", str(PARTS)) as served:
        result = ask(served, SimulatedRobot(small_setting(), 5, table), PARTS)
        code, parts, _ = served.ended()
    assert [{name: part[name] for name in expected[0]} for part in parts] == expected
    assert {part["outcome"] for part in parts} >= outcomes
    assert code == max(part["exit_code"] for part in parts)
    for part, answer in zip(parts, result, strict=True):
        if part["outcome"] != "leaf":
            assert answer is None
            continue
        x_mm, y_mm, theta_rad = (part["predicted_pose"][name] for name in POSE)
        located = (x_mm, y_mm, degrees(theta_rad), part["success_probability"])
        assert answer[-4:] == pytest.approx(located, abs=6e-6)
        assert ask is asked_in_structured_text or answer[0] == part["leaf"]
    assert_sound(tree.with_name("journal.jsonl"))


def half_line(line: Line, random: Random) -> None:
    line.send(random.choice((b"NE", b"COUNTS 17", b"\x00", b"WIDTH 3")))


def wrong_order(line: Line, random: Random) -> None:
    assert line.ask("WIDTH 21.0") == "ERROR 11 " + ERRORS[11]
    assert line.ask("NEXT").startswith("SQUEEZE 0 ")
    assert line.ask("NEXT") == "ERROR 12 " + ERRORS[12]
    assert line.ask("WIDTH 21.0 OBJECT 1") == "ERROR 22 " + ERRORS[22]


def two_at_once(line: Line, random: Random) -> None:
    line.send(b"NEXT\nCOUNTS 174 OBJECT\n")
    assert line.read() == "ERROR 13 " + ERRORS[13]
    assert line.read() == ""


def silence(line: Line, random: Random) -> None:
    assert line.ask("NEXT").startswith("SQUEEZE 0 ")


def noise(line: Line, random: Random) -> None:
    line.send(random.randbytes(random.randrange(1, 60)).replace(b"\n", b"?") + b"\n")
    assert line.read() == "ERROR 10 " + ERRORS[10]


def endless(line: Line, random: Random) -> None:
    line.send(b"COUNTS 1" + b"7" * random.randrange(MAX_LINE, 3 * MAX_LINE))
    assert line.read() == "ERROR 14 " + ERRORS[14]


def impossible(line: Line, random: Random) -> None:
    assert line.ask("NEXT").startswith("SQUEEZE 0 ")
    for word, number in (
        *(("COUNTS 256 OBJECT", 20), ("COUNTS -1 NONE", 10), ("WIDTH nan", 10), ("WIDTH 1e3", 20)),
        *(("WIDTH 300", 20), ("WIDTH -3", 20), ("WIDTH 84.9", 21), ("COUNTS 3 OBJECT", 21)),
        *(("COUNTS 150 NONE", 23), ("COUNTS 150", 10), ("WIDTH 2 1 OBJECT", 10), ("WIDTH", 10)),
        *(("WIDTH 21,0", 10), ("NEXT NEXT", 10), ("next", 10), ("", 10), ("COUNTS 1e2 OBJECT", 10)),
    ):
        assert line.ask(word) == f"ERROR {number} {ERRORS[number]}", word


def hung_up(line: Line, random: Random) -> None:
    assert line.ask("NEXT").startswith("SQUEEZE 0 ")
    line.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")


MISBEHAVIOURS = (half_line, wrong_order, two_at_once, silence, noise, endless, impossible, hung_up)


def test_serve_misbehaving_robots_get_errors_and_stop_ends_part(tree):
    random = Random(1)
    with Served(tree) as served:
        for number in range(2 * len(MISBEHAVIOURS)):
            with good(served) as line:
                if number % 5 == 0:
                    with Line(served) as second:  # gets an error, and is closed
                        second.send(b"NEXT\n")
                        assert second.read() == "ERROR 30 " + ERRORS[30]
                        assert second.read() == ""
                MISBEHAVIOURS[number % len(MISBEHAVIOURS)](line, random)
            # The next connection is not blocked by the last one and begins a new part.
            with good(served) as line:
                assert line.ask("NEXT").startswith("SQUEEZE 0 ")
                assert line.ask("WIDTH 30.0").startswith("SQUEEZE 1 1.000 -2.000 89.99998 ")
                assert line.ask("WIDTH 21.0 OBJECT 1") == "LEAF 1 -1.200 -2.000 90.01167 0.995000"
        with good(served) as line:
            assert line.ask("NEXT").startswith("SQUEEZE 0 ")
            served.process.send_signal(signal.SIGTERM)
            assert line.read() == "ERROR 40 " + ERRORS[40]
        code, parts, _ = served.ended()
    assert (code, parts[-1]["outcome"]) == (40, "stopped")
    leaves = [part["leaf"] for part in parts if part["outcome"] == "leaf"]
    assert leaves == [1] * 2 * len(MISBEHAVIOURS)
    assert {part["outcome"] for part in parts[:-1]} == {"leaf", "aborted"}
    assert_sound(tree.with_name("journal.jsonl"))


def good(served: Served) -> Line:
    """Opens a connection once the server has noticed the end of the previous one; returns it."""
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until:
        line = Line(served)
        result = line.ask("VERSION")
        if result == "VERSION 1 squeezetree":
            return line
        assert result == "ERROR 30 " + ERRORS[30]
        line.close()
    raise TimeoutError


def test_serve_held_part_is_dragged_before_answer(tmp_path: Path) -> None:
    table = every_field_table()
    dump(table, tmp_path / "t.msgpack")
    with Served(tmp_path / "t.msgpack", "--count", "1", "--on-unresolved", "restart") as served:
        with Line(served) as line:
            assert line.ask("NEXT").startswith("SQUEEZE 0 ")
            assert line.ask("WIDTH 30.0") == "DRAG 2.000 -0.500"
            assert line.ask("STATUS") == "STATUS DRAG 1 1 1"
            assert line.ask("WIDTH 30.0") == "ERROR 11 " + ERRORS[11]
            assert line.ask("NEXT").startswith("SQUEEZE 1 ")
            assert line.ask("WIDTH 36.0").startswith("SQUEEZE 0 "), "the policy"
            assert line.ask("WIDTH 21.0") == "DRAG 2.000 -0.500"
            assert line.ask("NEXT").startswith("LEAF 0 ")
            assert line.read() == "ERROR 40 " + ERRORS[40]
            assert line.read() == ""
        code, (part,), _ = served.ended()
    assert (code, part["outcome"], part["path"]) == (0, "leaf", [0, 1, 0])
    assert_sound(tmp_path / "journal.jsonl")


def test_serve_after_kill_is_refused_once_and_then_starts_new_part(tree: Path) -> None:
    with Served(tree) as served, Line(served) as line:
        assert line.ask("NEXT").startswith("SQUEEZE 0 ")
        served.process.kill()
        served.process.communicate(timeout=WAIT_S)
    with pytest.raises(AssertionError, match="24"):
        Served(tree)
    with Served(tree, "--count", "1") as served:
        with Line(served) as line:
            assert line.ask("NEXT").startswith("SQUEEZE 0 ")
            assert line.ask("WIDTH 21").startswith("LEAF 0 ")
        assert served.ended()[0] == 0
    assert_sound(tree.with_name("journal.jsonl"))


PAGE = (ROOT / "tools" / "docs" / "serve.md").read_text()
REQUESTS = {"NEXT", "COUNTS", "WIDTH", "RESET", "STATUS", "TABLE", "VERSION"}
ANSWERS = {"SQUEEZE", "DRAG", "LEAF", "UNRESOLVED", "REJECT", "ERROR"}
USED = {"NEXT", "COUNTS", "SQUEEZE", "DRAG", "LEAF"}
FLAGS = {"OBJECT", "NONE"}
# What opens a block and what closes it; a RAPID `IF ... THEN` stands for the one that is closed.
BLOCKS = {
    "robot.mod": {"MODULE": "ENDMODULE", "PROC": "ENDPROC", "FUNC": "ENDFUNC", "WHILE": "ENDWHILE"},
    "robot.script": {"def": "end", "while": "end", "if": "end"},
}


def test_serve_page_session_equals_answers_of_server(tmp_path: Path) -> None:
    shutil.copy(TABLE, tmp_path / "t.msgpack")
    (session,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    pairs = re.findall(r"^> (.*)\n< (.*)$", session, re.MULTILINE)
    assert len(pairs) == session.count("\n") // 2 > 10
    with Served(tmp_path / "t.msgpack") as served, Line(served) as line:
        for request, answer in pairs:
            assert line.ask(request) == answer, request
    assert {request.split()[0] for request, _ in pairs} <= REQUESTS


def test_serve_page_errors_and_words_equal_protocol() -> None:
    record = dict(re.findall(r"^\| (\d+) \| (.*) \|$", PAGE, re.MULTILINE))
    assert record == {str(number): sentence for number, sentence in ERRORS.items()}
    first = re.findall(r"^\| `([A-Z]+)", PAGE, re.MULTILINE)
    assert set(first) == REQUESTS | ANSWERS
    assert f"`VERSION {VERSION} squeezetree`" in PAGE
    assert f"at most {MAX_LINE} characters" in PAGE


@pytest.mark.parametrize("name", ["robot.py", "robot.mod", "robot.script", "robot.st"])
def test_client_program_uses_only_words_of_protocol(name: str) -> None:
    text = (CLIENTS / name).read_text()
    quoted = " ".join(re.findall(r"'([^'\n]*)'" if name.endswith("st") else r'"([^"\n]*)"', text))
    words = set(re.findall(r"\b[A-Z]{4,}\b", quoted))
    assert words >= USED - ({"COUNTS"} if name == "robot.py" else set())
    assert words <= REQUESTS | ANSWERS | FLAGS


@pytest.mark.parametrize("name", BLOCKS)
def test_client_program_blocks_are_closed(name: str) -> None:
    pairs, closed = BLOCKS[name], []
    for line in (CLIENTS / name).read_text().splitlines():
        words = re.findall(r"[A-Za-z_]+", re.split(r"[!#]", line)[0])
        first = words[0] if words else ""
        if first in pairs:
            closed.append(pairs[first])
        elif first == "IF" and words[-1] == "THEN":
            closed.append("ENDIF")
        elif closed and first in {*pairs.values(), "ENDIF"}:
            assert closed.pop() == first, line
    assert closed == []
