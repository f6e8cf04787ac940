"""The commands of pages, run in an empty folder, print what the pages show.

The tests plan with fewer particles, or try fewer parts, than a page shows.
"""

import json
import re
import shutil
import sys
import tomllib

import pytest
from documents import DOCS, Block, blocks, changed, matches, run, stated
from programs import ROOT, TREES

from planner.kernel import CACHE_VARIABLE, cache_folder

SAID = r"Can .*\?|The plan finds|located|error|effort|weakest|wrote .* after|plan .*msgpack"
TIMED = re.compile(rf"^(?:({SAID})|limit).*")


@pytest.mark.slow
def test_readme_commands_print_shown_output(work, environment):
    """The page's call of `tools/demo` is left out: this script runs the page's next commands itself.

    What `squeezetree try` answers within its budget depends on the machine, so that its numbers are not
    compared.
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
        shown = [TIMED.sub(r"\1...", line) if timed else line for line in block.printed]
        assert matches(shown, lines)


def test_tutorial_commands_print_shown_output(work, environment):
    result = blocks(DOCS / "tutorial.md")
    assert len(result) >= 7
    shutil.copy(DOCS / "lever.dxf", work)
    result[1].commands.append(stated("lever.toml", particles=600))
    for block, lines in zip(result, run(result, work, environment), strict=False):
        assert matches(block.printed, lines)
    assert (work / "lever.html").stat().st_size < 3_000_000


# The page's search ends with its budget; an easier one ends before it, on a busy machine too.
EASIER = {"--radius 5": "--radius 2 --turn 5", "--budget 20s": "--budget 60s"}


@pytest.mark.slow
def test_from_a_solid_page_with_less_uncertainty_prints_shown_output(work, environment, tmp_path):
    """The printed name of each located part is the true one."""
    python = tmp_path / "bin" / "python3"
    python.write_text(f"#!/bin/sh\nexec '{sys.executable}' \"$@\"\n")
    python.chmod(0o755)
    results = [changed(block, EASIER) for block in blocks(DOCS / "from-a-solid.md")]
    assert len(results) == 4
    results[1].commands.append(stated("bracket.toml", particles=1000))
    printed = run(results, work, environment)
    # The text after the last mark is empty.
    for block, lines in zip(results, printed, strict=False):
        assert matches(block.printed, lines)
    ends = re.findall(r"LEAF, leaf \d+, (.*?), \(.*; it is (.*)", "\n".join(printed[3]))
    assert ends
    assert all(said == true for said, true in ends)


# The page runs hundreds of parts, the test fewer.
REJECT, ALARM = 10, 11  # exit codes of runs and reports that the page shows
FEWER = {"--trials 2000": "--trials 300", "--trials 4000": "--trials 500"}


def interval(lines: list[str], quantity: str) -> tuple[float, float]:
    """Middle and half width of the interval that a line states for a quantity."""
    (line,) = (line for line in lines if line.startswith(f"  {quantity}"))
    mean, half = re.findall(r"[-+]?\d+\.\d+", line)[:2]
    return float(mean), float(half)


@pytest.mark.slow
def test_refit_page_with_fewer_parts_recovers_hidden_errors(work, environment):
    """The refit of the page's blind cell recovers the hidden errors and removes nearly all wrong answers."""
    page = DOCS / "refit.md"
    hidden = re.search(r"```python\n(.*?)```", page.read_text(), re.DOTALL)[1]
    (work / "hidden.py").write_text(hidden)
    shutil.copy(DOCS / "lever.dxf", work)
    result = "plan-init lever.dxf -o cell.toml --units mm --thickness 16 --radius 8 --turn 20"
    result += " --gripper robotiq-2f-85 --fingers rubber"
    friction = {"finger_part_min": 0.4, "finger_part_max": 0.6}
    known = stated("cell.toml", **friction)
    begin = Block([result, known, "plan-compile cell.toml -o cell.msgpack --trials 2000"], [])
    results = []
    for block in blocks(page):
        fewer = changed(block, FEWER)
        borne = f"case $? in {REJECT}|{ALARM}) ;; *) exit 1;; esac"
        lines = [f"{line} || {borne}" for line in fewer.commands]
        results.append(fewer._replace(commands=lines))
    printed = run([begin, *results], work, environment | {"PYTHONPATH": f"{ROOT}:{work}"})
    assert any(line.startswith("advice    a refit would pay") for line in printed[1])
    assert any(line.startswith("  widths read +0.") for line in printed[3])
    assert any(line.startswith("  the fingers meet -") for line in printed[3])
    for quantity, truth in (("the upper finger makes", 54.0), ("the fingers meet", -2.84)):
        mean, half = interval(printed[3], quantity)
        # The interval is one of 90 %: only 0.1 % lie beyond twice its half width.
        assert abs(mean - truth) < 2.0 * half + 0.05
    low, high = tomllib.loads((work / "cell2.toml").read_text())["doubt"]["encoder_mm"]
    assert 0.0 < low < 0.6 < high < 1.2  # the preset's were -1.1 and 1.1
    before, after = (json.loads(line) for line in printed[4] if line.startswith("{"))
    assert before["wrong_rate"] > 0.3
    assert after["wrong_rate"] < 0.1 * before["wrong_rate"]
