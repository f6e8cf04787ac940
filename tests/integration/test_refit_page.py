"""The commands of the page of refit, run in an empty folder with fewer parts."""

import json
import re
import shutil
import tomllib

import pytest
from documents import DOCS, Block, blocks, changed, run, stated
from programs import ROOT

# What a page says of hundreds of parts, as a test tries it.
REJECT, ALARM = 10, 11  # exit codes of runs and reports that the page shows
FEWER = {"--trials 2000": "--trials 300", "--trials 4000": "--trials 500"}


def interval(lines: list[str], quantity: str) -> tuple[float, float]:
    """Middle and half width of the interval that a line states for a quantity."""
    (line,) = (line for line in lines if line.startswith(f"  {quantity}"))
    mean, half = re.findall(r"[-+]?\d+\.\d+", line)[:2]
    return float(mean), float(half)


@pytest.mark.slow
def test_the_page_of_refit_runs_as_written_with_fewer_parts(work, environment):
    """The blind cell of the page: what journals and audits tell is written, and mends nearly all answers."""
    page = DOCS / "refit.md"
    (work / "hidden.py").write_text(
        re.search(r"```python\n(.*?)```", page.read_text(), re.DOTALL)[1]
    )
    shutil.copy(DOCS / "lever.dxf", work)
    result = "plan-init lever.dxf -o cell.toml --units mm --thickness 16 --radius 8 --turn 20"
    result += " --gripper robotiq-2f-85 --fingers rubber"
    friction = {"finger_part_min": 0.4, "finger_part_max": 0.6}
    known = stated("cell.toml", **friction)
    begin = Block([result, known, "plan-compile cell.toml -o cell.msgpack --trials 2000"], [])
    results = []
    for block in blocks(page):
        fewer = changed(block, FEWER)
        lines = [
            f"{line} || case $? in {REJECT}|{ALARM}) ;; *) exit 1;; esac" for line in fewer.commands
        ]
        results.append(fewer._replace(commands=lines))
    printed = run([begin, *results], work, environment | {"PYTHONPATH": f"{ROOT}:{work}"})
    assert any(line.startswith("advice    a refit would pay") for line in printed[1])
    assert any(line.startswith("  widths read +0.") for line in printed[3])
    assert any(line.startswith("  the fingers meet -") for line in printed[3])
    for quantity, truth in (("the upper finger makes", 54.0), ("the fingers meet", -2.84)):
        mean, half = interval(printed[3], quantity)
        assert abs(mean - truth) < 2.0 * half + 0.05  # of 90 %: further off are 0.1 %
    low, high = tomllib.loads((work / "cell2.toml").read_text())["doubt"]["encoder_mm"]
    assert 0.0 < low < 0.6 < high < 1.2  # the preset's were -1.1 and 1.1
    before, after = (json.loads(line) for line in printed[4] if line.startswith("{"))
    assert before["wrong_rate"] > 0.3
    assert after["wrong_rate"] < 0.1 * before["wrong_rate"]
