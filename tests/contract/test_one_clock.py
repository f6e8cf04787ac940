"""Every wait, date and deadline of the runtime goes through the Clock port, which may be a virtual one."""

import ast
from pathlib import Path

import pytest

RUNTIME = Path(__file__).parents[2] / "runtime"
CLOCKS = {"time", "datetime", "sched", "timeit"}


def modules_imported(source: str) -> set[str]:
    result = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            result |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            result.add((node.module or "").partition(".")[0])
    return result


@pytest.mark.parametrize("path", sorted(RUNTIME.rglob("*.py")), ids=lambda path: path.stem)
def test_only_the_system_clock_reads_the_time(path):
    assert bool(modules_imported(path.read_text()) & CLOCKS) == (path.name == "clock.py")
