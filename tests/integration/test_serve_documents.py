"""tools/docs/serve.md says what the server says, and the programs beside it speak its words."""

import re
import shutil
from pathlib import Path

import pytest
from asking_robots import CLIENTS, Line, Served
from programs import ROOT, TABLE

from runtime.execution import asked

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


def test_the_session_is_what_the_server_says(tmp_path: Path) -> None:
    shutil.copy(TABLE, tmp_path / "t.msgpack")
    (session,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    pairs = re.findall(r"^> (.*)\n< (.*)$", session, re.MULTILINE)
    assert len(pairs) == session.count("\n") // 2 > 10
    with Served(tmp_path / "t.msgpack") as served, Line(served) as line:
        for request, answer in pairs:
            assert line.ask(request) == answer, request
    assert {request.split()[0] for request, _ in pairs} <= REQUESTS


def test_the_errors_and_words_are_those_of_the_protocol() -> None:
    record = dict(re.findall(r"^\| (\d+) \| (.*) \|$", PAGE, re.MULTILINE))
    assert record == {str(number): sentence for number, sentence in asked.ERRORS.items()}
    first = re.findall(r"^\| `([A-Z]+)", PAGE, re.MULTILINE)
    assert set(first) == REQUESTS | ANSWERS
    assert f"`VERSION {asked.VERSION} squeezetree`" in PAGE
    assert f"at most {asked.MAX_LINE} characters" in PAGE


@pytest.mark.parametrize("name", ["robot.py", "robot.mod", "robot.script", "robot.st"])
def test_a_program_speaks_the_protocol_s_words(name: str) -> None:
    text = (CLIENTS / name).read_text()
    quoted = " ".join(re.findall(r"'([^'\n]*)'" if name.endswith("st") else r'"([^"\n]*)"', text))
    words = set(re.findall(r"\b[A-Z]{4,}\b", quoted))
    assert words >= USED - ({"COUNTS"} if name == "robot.py" else set())
    assert words <= REQUESTS | ANSWERS | FLAGS


@pytest.mark.parametrize("name", BLOCKS)
def test_the_blocks_of_a_program_are_closed(name: str) -> None:
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
