"""Exported tables are executed: C by each installed compiler, structured text by an interpreter."""

import csv
import re
from random import Random

import pytest
from blark.parse import parse_source_code
from exported import (
    FAULT,
    SANITIZERS,
    STRICT,
    Oracle,
    built,
    check_structured_text,
    code_bytes,
    compilers,
    executor,
    rows_of,
    said,
    wide_table,
)
from programs import ROOT, ended
from sample_tables import every_field_table, random_table, small_table
from structured_text import INPUT, OUTPUT, FunctionBlock
from tree_tables import committed

from planner.cli import export
from planner.export.write import NODE, VECTORS
from runtime.table import dump

GUIDE = (ROOT / "tools" / "docs" / "controllers.md").read_text()
COMMITTED = committed()
TABLES = {**COMMITTED, "every field": every_field_table(), "wide": wide_table()}
TABLES["sixty nodes"] = random_table(3, 60)
FUZZED = 20_000
MOST_CODE_BYTES = 4096
WILD = (-(2**31), -257, -2, -1, 256, 257, 4096, 2**31 - 1)
PLAYED = """\
#include <stdio.h>
#include <stdlib.h>
static char **reading;
int place_hand(int32_t x_um, int32_t y_um, int32_t angle_urad, int32_t opening_um)
{
    printf("%ld %ld %ld %ld ", (long)x_um, (long)y_um, (long)angle_urad, (long)opening_um);
    return 0;
}
int close_jaws(int32_t speed_um_s, int32_t force_mn, int32_t *width_um, int32_t *object_flag)
{
    printf("%ld %ld ", (long)speed_um_s, (long)force_mn);
    *width_um = (int32_t)atol(*reading++);
    *object_flag = (int32_t)atol(*reading++);
    return 0;
}
int release_at(int32_t x_um, int32_t y_um, int32_t angle_urad)
{
    printf("%ld %ld %ld\\n", (long)x_um, (long)y_um, (long)angle_urad);
    return 0;
}
int main(int count, char **words)
{
    squeezetree_decision end;
    (void)count;
    reading = words + 1;
    end = locate_part();
    printf("%ld %ld\\n", (long)end.outcome, (long)end.index);
    return 0;
}
"""
"""The cell of the guide's program; its gripper reads the values of the command line."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A function that exports a table once and returns the folder of the export."""
    base = tmp_path_factory.mktemp("export")

    def result(name, form, table=None):
        out = base / f"{name}-{form}"
        if not out.exists():
            dump(table or TABLES[name], base / f"{name}.msgpack")
            words = [str(base / f"{name}.msgpack"), "--to", form, "-o", str(out)]
            assert export.main(words) == 0
        return out

    return result


def wild_rows(table, seed):
    """Yields arguments that no gripper gives (node, width, flag), each row with the right answer."""
    random, oracle = Random(seed), Oracle(table)
    values = [*WILD, *(random.randint(-(2**31), 2**31 - 1) for _ in range(5))]
    for node in (*values, *range(min(3, len(table.nodes))), len(table.nodes)):
        for width in (*values, 0, 20_969, 85_000):
            for flag in (*values, 0, 1, 2, 3, 4):
                yield (node, width, flag, *oracle.answer(node, width, flag))


def test_oracle_wild_arguments_give_rejects_and_invalid_flags_faults():
    seen = {row[3] for row in wild_rows(small_table(), 0)}
    assert {3, 4} <= seen
    assert all(row[3:] == FAULT for row in wild_rows(small_table(), 0) if row[2] not in (2, 3))


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_c_export_reproduces_vectors_and_survives_wild_arguments(name, folder):
    out = folder(name, "c99")
    with (out / "wild.csv").open("w", newline="") as file:
        wild = list(wild_rows(TABLES[name], 1))
        csv.writer(file).writerows([["node"], *wild])
    for compiler in compilers():
        program = built(compiler, out, *STRICT, *SANITIZERS)
        assert int(said("check", out / VECTORS, program=program)) == len(rows_of(out))
        assert int(said("check", out / "wild.csv", program=program)) == len(wild)
        met = [int(word) for word in said("fuzz", FUZZED, 1, program=program).split()]
        assert sum(met) == FUZZED
        assert min(met[1], met[3], met[4]) > 0


@pytest.mark.slow
def test_c_check_of_vectors_wrong_number_fails_and_names_row(folder):
    out = folder("every field", "c99")
    program = built(compilers()[0], out)
    right = (out / VECTORS).read_text().splitlines()
    for column in range(3, 7):
        wrong = right[30].split(",")
        wrong[column] = str(int(wrong[column]) + 1)
        (out / "wrong.csv").write_text("\n".join([*right[:30], ",".join(wrong), *right[31:]]))
        done = ended([program, "check", out / "wrong.csv"])
        assert done.code == 1
        assert done.err.startswith("row 30:")


@pytest.mark.slow
def test_c_executor_is_small_and_needs_no_library(folder):
    out = folder("sixty nodes", "c99")
    header = (out / "squeezetree_table.h").read_text()
    assert re.findall(r"#include .*", header) == ["#include <stdint.h>"]
    for compiler in compilers():
        executable = executor(compiler, out)
        assert 0 < code_bytes(executable) < MOST_CODE_BYTES
        assert said("-u", executable, program="nm") == ""


@pytest.mark.slow
def test_guide_c_program_follows_tree_to_each_outcome(folder):
    """The small table ends at two leaves, at an unresolved leaf, in a reject and in a fault."""
    out = folder("small", "c99", small_table())
    program = re.findall(r"```c\n(.*?)```", GUIDE, re.DOTALL)
    assert len(program) == 1
    (out / "guide.c").write_text(program[0] + PLAYED)
    root = "0 0 0 85000 60000 40000 0 0 0"
    second = "1000 -2000 1570796 85000 60000 40000 1000 -2000 1570796"
    for compiler in compilers():
        path = out / f"guide-{compiler}"
        said("-I", out, out / "guide.c", "-o", path, *STRICT, *SANITIZERS, program=compiler)
        for readings, record in {
            "29955 2 20969 2": [root, second, "1 1"],
            "20969 2": [root, "1 0"],
            "29955 2 35947 2": [root, second, "2 2"],
            "20969 3": [root, "3 -1"],
            "20969 1": [root.rsplit(" ", 3)[0], "4 -1"],
        }.items():
            printed = said(*readings.split(), program=path).split()
            assert printed == " ".join(record).split()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "every field", "wide"])
def test_structured_text_export_reproduces_vectors(name, folder):
    table, out = TABLES[name], folder(name, "st")
    block = FunctionBlock((out / "squeezetree_table.st").read_text())
    assert block.names[INPUT] == ["restart", "node", "width_um", "object_flag"]
    vectors = rows_of(out)
    assert len({row[:3] for row in vectors}) == len(vectors) >= 6 * len(table.nodes)
    check_structured_text(block, table, (*vectors, *wild_rows(table, 2)))
    begun = block(restart=True, node=-7, width_um=300, object_flag=9)
    assert (begun["outcome"], begun["index"]) == (NODE, 0)
    assert begun["opening_um"] == table.nodes[0].squeeze.opening_um


@pytest.mark.slow
def test_guide_structured_text_program_is_parsed_and_uses_outputs(folder):
    block = (folder("every field", "st") / "squeezetree_table.st").read_text()
    (program,) = re.findall(r"```text\n(.*?)```", GUIDE, re.DOTALL)
    assert parse_source_code(program).exception is None
    used = set(re.findall(r"table\.(\w+)", program))
    assert used < set(FunctionBlock(block).names[OUTPUT])


REFUSED = """\
FUNCTION_BLOCK refused
VAR_INPUT
    n : DINT;
END_VAR
VAR
    a : DINT;
END_VAR
VAR CONSTANT
    b : ARRAY[0..1] OF DINT := [1, 2];
    c : DINT := 1;
END_VAR
a := 1;
{}
END_FUNCTION_BLOCK
"""


def test_function_block_invalid_statement_raises():
    assert FunctionBlock(REFUSED.format("a := b[1];"))(n=1) == {}
    wrong = "a := b[2]; a := b[-1]; c := 1; n := 2; a := 2147483647 + a; a := TRUE; a := d;"
    for statement in wrong.split("; "):
        block = FunctionBlock(REFUSED.format(f"{statement.rstrip(';')};"))
        with pytest.raises((AssertionError, IndexError, KeyError, TypeError)):
            block(n=1)


TWO = """\
#include "left_table.h"
#include "left_table.h"
#include "right_table.h"
#include <stdio.h>
int main(void)
{
    left_decision one = left_decide(0, 20969, 2);
    right_decision two = right_decide(0, 20969, 2);
    printf("%ld %ld %ld %ld %d %d\\n", (long)one.release_x_um, (long)one.release_y_um, (long)two.release_x_um,
           (long)two.release_y_um, LEFT_NODES, RIGHT_NODES);
    return 0;
}
"""


def test_export_two_prefixes_share_a_program_and_equal_ones_fail(tmp_path):
    """If both tables have one prefix, the compiler must fail and not skip the second header."""
    tables = {"left": small_table(), "right": every_field_table()}
    for name, table in tables.items():
        dump(table, tmp_path / "t.msgpack")
        for form in ("c99", "st"):
            words = f"{tmp_path}/t.msgpack --to {form} -o {tmp_path}/{name}-{form} --prefix {name}"
            assert export.main(words.split()) == 0
        words = f"{tmp_path}/t.msgpack --to c99 -o {tmp_path}/{name}-same"
        assert export.main(words.split()) == 0
    (tmp_path / "two.c").write_text(TWO)
    folders = ("-I", tmp_path / "left-c99", "-I", tmp_path / "right-c99")
    (tmp_path / "same.c").write_text(
        '#include "left-same/squeezetree_table.h"\n#include "right-same/squeezetree_table.h"\n'
    )
    for compiler in compilers():
        said(*folders, tmp_path / "two.c", *STRICT, "-o", tmp_path / "two", program=compiler)
        one, two = (Oracle(table).answer(0, 20_969, 2)[2:] for table in tables.values())
        assert one != two
        assert [int(word) for word in said(program=tmp_path / "two").split()] == [*one, *two, 2, 2]
        refused = ended([compiler, "-fsyntax-only", tmp_path / "same.c"])
        assert refused.code != 0
        assert "another table has the prefix squeezetree" in refused.err
    texts = [(tmp_path / f"{name}-st" / f"{name}_table.st").read_text() for name in tables]
    names = [re.findall(r"FUNCTION_BLOCK (\w+)", text)[0] for text in texts]
    assert names == ["LeftTable", "RightTable"]
