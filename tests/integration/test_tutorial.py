"""The commands of the tutorial and of the way from a solid, run in an empty folder, print what they show.

Plans are searched for with fewer particles than by default, which no page shows.
"""

import re
import shutil
import sys

import pytest
from documents import DOCS, blocks, changed, matches, run, stated


def test_the_tutorial_runs_as_written(work, environment):
    result = blocks(DOCS / "tutorial.md")
    assert len(result) >= 7
    shutil.copy(DOCS / "lever.dxf", work)
    result[1].commands.append(stated("lever.toml", particles=600))
    for block, lines in zip(result, run(result, work, environment), strict=False):
        assert matches(block.printed, lines)
    assert (work / "lever.html").stat().st_size < 3_000_000


# The page's search ends with its budget; this one is over before, on a busy machine too.
EASIER = {"--radius 5": "--radius 2 --turn 5", "--budget 20s": "--budget 60s"}


@pytest.mark.slow
def test_a_solid_becomes_a_running_cell_as_written_where_less_is_unknown(
    work, environment, tmp_path
):
    """Each located part is named rightly."""
    python = tmp_path / "bin" / "python3"
    python.write_text(f"#!/bin/sh\nexec '{sys.executable}' \"$@\"\n")
    python.chmod(0o755)
    results = [changed(block, EASIER) for block in blocks(DOCS / "from-a-solid.md")]
    assert len(results) == 4
    results[1].commands.append(stated("bracket.toml", particles=1000))
    printed = run(results, work, environment)
    for block, lines in zip(results, printed, strict=False):  # what follows the last mark is empty
        assert matches(block.printed, lines)
    ends = re.findall(r"LEAF, leaf \d+, (.*?), \(.*; it is (.*)", "\n".join(printed[3]))
    assert ends
    assert all(said == true for said, true in ends)
