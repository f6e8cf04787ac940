"""Checks exported tables in C and structured text against the decisions of the runtime."""

import csv
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from programs import ended
from sample_tables import small_table
from structured_text import OUTPUT, FunctionBlock

from drivers.ports import ObjectState
from planner.export.write import LEAF, NODE, UNRESOLVED, VECTORS
from runtime.errors import GripperStateError
from runtime.table import Branch, Place, Table, decision_map
from runtime.table.fields import MAX_BRANCHES
from runtime.traversal.decision import Policy, TraversalState, advance, decide
from runtime.traversal.results import Outcome

HARNESS = Path(__file__).with_name("export_harness.c")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
NUMBERS = {Outcome.LEAF: 1, Outcome.UNRESOLVED: 2, Outcome.REJECT: 3}
FAULT = (4, -1, 0, 0)
OBJECT = """\
#include "squeezetree_table.h"
squeezetree_decision decide(int32_t node, int32_t width_um, int32_t object_flag);
squeezetree_decision decide(int32_t node, int32_t width_um, int32_t object_flag)
{
    return squeezetree_decide(node, width_um, object_flag);
}
"""
"""C source that gives a linker the exported decision function, and nothing else."""

Answer = tuple[int, int, int, int]  # outcome, index, release x and y


def wide_table() -> Table:
    """Returns a table of one node, which drags the part and has as many branches as a node may have.

    In the first branch the jaws hold nothing, so that nothing is dragged.
    """
    table = small_table()
    lows = [2_500 * k for k in range(MAX_BRANCHES)]
    branches = tuple(
        Branch(low, low + 1_500, low + 3_000, 31_250, ~k) for k, low in enumerate(lows)
    )
    root = table.nodes[0]._replace(branches=branches, release=Place(3_000, -4_000))
    return replace(table, nodes=(root,), leaves=table.leaves[:1] * MAX_BRANCHES)


class Oracle:
    """Computes what a run with the default policy does after a reading, by the runtime's own code."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._maps = [decision_map(node, table.gripper) for node in table.nodes]

    def answer(self, index: int, width_um: int, flag: int) -> Answer:
        """Returns what follows a width and object flag at node `index`; `FAULT` if the run would fail."""
        if not 0 <= index < len(self._maps):
            return FAULT
        node = self._table.nodes[index]
        try:
            decision = decide(node, self._maps[index], width_um, ObjectState(flag))
        except (GripperStateError, ValueError):
            return FAULT
        state = advance(TraversalState(index), decision.target, self._table, Policy())
        x, y = node.release_point(decision.branch) or node.squeeze.place
        if state.outcome is None:
            return 0, state.node, x, y
        return NUMBERS[state.outcome], -1 if state.leaf is None else state.leaf, x, y


def rows_of(path: Path) -> list[tuple[int, ...]]:
    """Returns the test vectors in an export folder: one tuple of integers for each row of the file."""
    with (path / VECTORS).open() as file:
        return [tuple(map(int, row)) for row in list(csv.reader(file))[1:]]


def check_structured_text(block: FunctionBlock, table: Table, rows: Iterable[tuple]) -> None:
    """Calls the block with every row, and compares all outputs.

    Raises:
        AssertionError: an output differs from the row or from the table.
    """
    names = block.names[OUTPUT]
    hand, part = names.index("hand_x_um"), names.index("part_x_um")
    for row in rows:
        result = block(restart=False, node=row[0], width_um=row[1], object_flag=row[2])
        outcome, index = result["outcome"], result["index"]
        assert (outcome, index, result["release_x_um"], result["release_y_um"]) == row[3:], row
        if outcome == NODE:
            *motion, _clearance_um = table.nodes[index].squeeze
            assert [result[name] for name in names[hand : hand + 6]] == motion
        if outcome in (LEAF, UNRESOLVED):
            leaf = table.leaves[index]
            success = leaf.success_ppm if leaf.trials else -1
            pose = leaf.x_um, leaf.y_um, leaf.theta_urad
            wanted = (*pose, success, leaf.error_p95_um, len(leaf.alternatives))
            assert tuple(result[name] for name in names[part:]) == wanted


def compilers() -> list[str]:
    """The C compilers of this machine, at least one."""
    results = [name for name in ("gcc", "clang") if shutil.which(name)]
    assert results, "neither gcc nor clang is installed; install one (Debian: apt-get install gcc)"
    return results


def built(compiler: str, folder: Path, *flags: str) -> Path:
    """Compiles the C test program `HARNESS` with the header in an export folder; returns the program."""
    program = folder / f"harness-{compiler}"
    said("-I", folder, HARNESS, *flags, "-o", program, program=compiler)
    return program


def executor(compiler: str, folder: Path) -> Path:
    """Compiles the exported decision function alone, optimised for size; returns the object file.

    The compiler may use no library.
    """
    source = folder / "executor.c"
    source.write_text(OBJECT)
    path = folder / f"executor-{compiler}.o"
    said("-Os", "-ffreestanding", "-I", folder, "-c", source, "-o", path, *STRICT, program=compiler)
    return path


def code_bytes(compiled: Path) -> int:
    """The size of the code of an object file, without its data [bytes]."""
    rows = [line.split() for line in said("-A", compiled, program="size").splitlines()]
    return sum(int(row[1]) for row in rows if row and row[0].startswith(".text"))


def said(*words: object, program: str | Path) -> str:
    """Runs a program and returns its standard output; asserts exit code 0 and an empty standard error."""
    code, out, err = ended([program, *words], timeout=280)
    assert (code, err) == (0, ""), f"{program} ended with {code}: {err}"
    return out
