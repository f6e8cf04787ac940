"""Control characters in text from files: every reader refuses them, and no output prints them."""

import contextlib
import io
import json
import unicodedata
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import programs
import pytest
from asked import asked_parts
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_tables import several_table, small_table, with_job

from planner.export.write import FORMS, PREFIX, _text
from planner.job import model as job_file
from runtime.commands.journal import _line
from runtime.execution.asked import MAX_LINE
from runtime.monitoring.console import Lines, Objects
from runtime.shell import strict_json
from runtime.shell.command import say, tell
from runtime.shell.errors import InputError
from runtime.shell.plain_text import cleaned
from runtime.table import Table, TableError, TableFile, dumps, loads
from runtime.table.codec import encode
from runtime.traversal.results import Outcome, PartResult

ODD = "\n\r\t\x00\x07\x1b\x7f\x85\x9b\u2028\u2029\u202e\u2066\ufeff"
odd = st.builds(
    lambda before, strange, after: f"{before}{strange}{after}"[:60],
    st.text(st.characters(exclude_categories=("Cs",)), max_size=8),
    st.sampled_from([*ODD, "\x1b[2J", "\nLEAF 0 0 0 0 1"]),
    st.text(st.characters(exclude_categories=("Cs",)), max_size=8),
)
JOB = programs.JOB.read_text()


def prints(text: str) -> bool:
    """Whether a text is safe to print: it moves no cursor, breaks no line and turns no reading direction."""
    hidden = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
    return not any(unicodedata.category(letter) in hidden for letter in text)


def named(name: str) -> Table:
    one, two = several_table().hypotheses
    return replace(several_table(), hypotheses=(one._replace(name=name), two))


TABLES: list[Callable[[str], Table]] = [
    named,
    lambda text: replace(small_table(), tool=text),
    lambda text: replace(small_table(), gripper=replace(small_table().gripper, model=text)),
    lambda text: with_job(small_table(), json.dumps({"part": {"name": text}})),
    lambda text: with_job(small_table(), json.dumps({"part": {"picks": {text: [0, 0, 0]}}})),
]


@given(odd)
@settings(max_examples=20)
def test_table_and_job_control_characters_are_refused_in_a_line(text: str) -> None:
    for table in TABLES:
        for refuse in (lambda result: loads(encode(result)), dumps):
            with pytest.raises(TableError) as refused:
                refuse(table(text))
            assert prints(str(refused.value))
    for name in ("name", "picks"):
        value = json.dumps(text) if name == "name" else f"{{ {json.dumps(text)} = [0, 0, 0] }}"
        stated = JOB.replace('name = "rectangle"', f"{name} = {value}".replace("\x7f", "\\u007f"))
        with pytest.raises(InputError) as refused_job:
            job_file.parse(stated)
        assert prints(str(refused_job.value))


@given(odd)
@settings(max_examples=20)
def test_strict_json_load_control_characters_are_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.mktemp("json") / "tag.json"
    for document in ({"part": text}, {text: 1}, [[{"a": [text]}]]):
        path.write_text(json.dumps(document))
        with pytest.raises(ValueError, match="which does not print") as refused:
            strict_json.load(path, ValueError)
        assert prints(str(refused.value))


def printed(written: Callable[[], object]) -> str:
    """What is printed on standard output and on standard error."""
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        written()
    return stream.getvalue()


@given(odd)
@settings(max_examples=15)
def test_output_control_characters_are_escaped(text: str) -> None:
    """The text comes unchecked from an error, a device or a journal."""
    table = named(text)
    answers: list[str] = []
    parts = asked_parts(table)
    lines = ("NEXT", "COUNTS 174 OBJECT", "TABLE", "STATUS")  # to leaf 0, which names the part
    printed(lambda: answers.extend(map(parts.answer, lines)))
    assert answers[1].startswith("LEAF 0 ")
    for answer in answers:
        assert answer.isascii()
        assert prints(answer)
        assert len(answer) < MAX_LINE
    result = replace(PartResult.of(1, Outcome.FAULT, [], text), leaf=0)
    for written in (
        lambda: Lines(table).part(result, None),
        lambda: Lines(table).note(text),
        lambda: Objects(table, Path("j")).part(result, None),
        lambda: say(text),
        lambda: tell("grasp-runtime", text),
        lambda: print(cleaned(_line({"seq": 1, "time": text, "kind": text, text: text}))),
    ):
        said = printed(written)
        assert said.count("\n") == 1
        assert prints(said.removesuffix("\n"))
    unknown = replace(small_table().gripper, model="unknown")
    plain = replace(small_table(), tool=text, gripper=replace(unknown, model=text))
    for forms in FORMS.values():
        for name in forms:
            exported = _text(name, TableFile(plain, b"", "ab" * 32), PREFIX)
            assert prints(exported.replace("\n", ""))
            usual = TableFile(replace(small_table(), gripper=unknown), b"", "ab" * 32)
            assert exported.count("\n") == _text(name, usual, PREFIX).count("\n")
