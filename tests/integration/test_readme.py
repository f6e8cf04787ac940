"""The commands of the README, run in an empty folder, print what it shows."""

import re
import shutil

import pytest
from documents import DOCS, blocks, matches, run
from programs import ROOT, TREES

from planner.kernel import CACHE_VARIABLE, cache_folder

TIMED = re.compile(
    r"^(?:(Can .*\?|The plan finds|located|error|effort|weakest|wrote .* after|plan .*msgpack)|limit).*"
)


@pytest.mark.slow
def test_the_readme_runs_as_written(work, environment):
    """All but its two scripts: `tools/demo` runs the same commands, `tools/check` this test.

    What `squeezetree try` answers within its budget is up to the machine.
    """
    results = [
        block._replace(commands=[line for line in block.commands if not line.startswith("tools/")])
        for block in blocks(ROOT / "README.md")
    ]
    results = [block for block in results if block.commands]
    assert len(results) >= 2
    (work / "out").mkdir()
    (work / ".venv" / "bin").mkdir(parents=True)  # made by tools/demo
    (work / ".venv" / "bin" / "activate").touch()
    shutil.copytree(TREES / "rectangle", work / "trees" / "rectangle")
    (work / "tools" / "docs").mkdir(parents=True)
    shutil.copy(DOCS / "lever.dxf", work / "tools" / "docs")
    home = {"HOME": str(work), CACHE_VARIABLE: str(cache_folder())}  # completion writes into it
    printed = run(results, work, environment | home)
    for block, lines in zip(results, printed, strict=False):
        timed = block.commands[0].startswith("squeezetree try ")
        assert matches(
            [TIMED.sub(r"\1...", line) if timed else line for line in block.printed], lines
        )
