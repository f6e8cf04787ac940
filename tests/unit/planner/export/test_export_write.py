"""The files of an export: written whole or not at all, never over other files; JSON follows its schema."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from programs import called, document
from sample_tables import every_field_table, small_table

from planner.cli import export
from planner.export import write as writer
from planner.export.write import FORMS, VECTORS
from runtime.table import TableFile, dump, load


@pytest.fixture
def tree(tmp_path):
    dump(every_field_table(), tmp_path / "t.msgpack")
    return tmp_path / "t.msgpack"


def json_form(table, folder):
    """Writes a table as JSON; returns its content, checked by the schema beside it, and the validator."""
    writer.write(TableFile(table, b"", "0" * 64), "json", folder)
    record = json.loads((folder / "squeezetree_table.json").read_text())
    schema = json.loads((folder / "squeezetree_table.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(record)
    return record, validator


def test_write_json_holds_the_whole_table(tmp_path):
    table = every_field_table()
    result, validator = json_form(table, tmp_path)
    for index, (node, written) in enumerate(zip(table.nodes, result["nodes"], strict=True)):
        assert {name: written[name] for name in node.squeeze._fields} == node.squeeze._asdict()
        assert tuple(written["release_um"]) == node.let_go, index
        assert written["branches"] == [branch._asdict() for branch in node.branches]
    for leaf, written in zip(table.leaves, result["leaves"], strict=True):
        stated = leaf._asdict()
        del stated["hypothesis"]  # tables of several parts are not exported
        stated["alternatives"] = [pose[:3] for pose in leaf.alternatives]
        assert written == json.loads(json.dumps(stated))
    assert result["goal"]["kind"] == table.goal.kind
    assert result["limits"]["work_area_um"] == list(table.limits.work_area_um)
    result["nodes"][0]["runs"][0]["first"] = 256
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(result)


@pytest.mark.parametrize("form", ["c99", "st"])
def test_write_hostile_texts_cannot_end_a_comment(form, tmp_path):
    hostile = "*/ int a; /* (* *) ??/\n\\ \u00e9"
    gripper = replace(small_table().gripper, model=hostile)
    table = replace(small_table(), tool=hostile, gripper=gripper)
    writer.write(TableFile(table, b"", "0" * 64), form, tmp_path)
    text = (tmp_path / FORMS[form][0]).read_text()
    assert "int a" in text
    assert "*/ int a" not in text
    assert "??" not in text
    assert "\\" not in text
    assert text.count("(*") == text.count("*)")


def test_export_wrong_input_is_refused_in_one_line(tree, tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    (full / VECTORS).write_text("mine\n")
    damaged = tmp_path / "damaged.msgpack"
    damaged.write_bytes(tree.read_bytes()[:-1])
    wrong = {
        2: [(tree, full), (tree, tree), (tree, tree / "below"), (tree, Path("/proc/none"))],
        3: [(path, tmp_path / "o") for path in (tmp_path / "none.msgpack", tmp_path, damaged)],
    }
    for code, pairs in wrong.items():
        for table, out in pairs:
            ended = called(export.main, table, "--to", "c99", "-o", out)
            assert (ended.code, ended.out, ended.one_line) == (code, "", True)
            assert ended.err.startswith("plan-export: ")
    assert [path.read_text() for path in full.iterdir()] == ["mine\n"]
    assert not (tmp_path / "o").exists()
    assert called(export.main, tree, "--to", "ada", "-o", tmp_path / "o").code == 2


@pytest.mark.parametrize(
    "prefix", ["", "Left", "2left", "left-hand", "left__hand", "_left", "left_", "x" * 25, "é"]
)
def test_export_invalid_prefix_is_refused(prefix, tree, tmp_path):
    ended = called(export.main, tree, "--to", "c99", "-o", tmp_path / "o", "--prefix", prefix)
    assert ended.code == 2
    assert ended.err.startswith("plan-export: --prefix")
    assert not (tmp_path / "o").exists()


def test_export_prefix_begins_all_names_and_is_refused_for_json(tree, tmp_path, capsys):
    for form in ("c99", "st"):
        out = tmp_path / form
        assert export.main([str(tree), "--to", form, "-o", str(out), "--prefix", "left_hand"]) == 0
        (name,) = (path.name for path in out.iterdir() if path.name != VECTORS)
        assert name == FORMS[form][0].replace("squeezetree", "left_hand")
        text = (out / name).read_text()
        assert not re.findall(r"(?i)squeezetree\w", text.replace("--prefix NAME", ""))
    assert export.main([str(tree), "--to", "json", "-o", str(tmp_path / "j"), "--prefix", "a"]) == 2
    assert "leave it out with --to json" in capsys.readouterr().err


@pytest.mark.parametrize("form", FORMS)
def test_export_writes_the_listed_files_the_same_each_time(form, tree, tmp_path):
    out = tmp_path / "made" / form
    record = document(export.main, tree, "--to", form, "-o", out, "--json")
    assert {path.name: path.stat().st_size for path in out.iterdir()} == record["files"]
    assert set(record["files"]) == {VECTORS, *FORMS[form]}
    again = tmp_path / "again"
    again.mkdir()
    ended = called(export.main, tree, "--to", form, "-o", again)
    assert (ended.code, ended.out.count("\n")) == (0, 1)
    for name in record["files"]:
        assert (again / name).read_bytes() == (out / name).read_bytes()
        assert load(tree).digest in (out / name).read_text() or name in (VECTORS, FORMS["json"][1])
