"""The picture of a table: every node and leaf is on it once, with the figures that the table states."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from planner.job import model as job_file
from planner.job.model import Job
from planner.report import tree
from planner.report.replay import replay
from runtime.table import Table, load

TREES = Path(__file__).parents[4] / "trees" / "rectangle"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def job() -> Job:
    return job_file.load(TREES / "job.toml")


@pytest.fixture(scope="module")
def table() -> Table:
    return load(TREES / "rectangle.msgpack").table


def panels(path: Path) -> list[str]:
    ids = [group.get("id", "") for group in ET.parse(path).iter(f"{SVG}g")]
    return sorted(name for name in ids if re.fullmatch(r"(node|leaf)-\d+", name))


def names(table: Table) -> list[str]:
    nodes = [f"node-{index}" for index in range(len(table.nodes))]
    return sorted([*nodes, *(f"leaf-{index}" for index in range(len(table.leaves)))])


def words(path: Path) -> list[str]:
    return [text.text or "" for text in ET.parse(path).iter(f"{SVG}text")]


@pytest.fixture(scope="module")
def drawn(table: Table, job: Job, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tree") / "tree.svg"
    tree.draw(table, job, path, trials=200)
    return path


def test_one_panel_a_node_and_a_leaf(table: Table, drawn: Path) -> None:
    assert panels(drawn) == names(table)


def test_readme_picture_shows_the_table_beside_it(table: Table) -> None:
    assert panels(TREES / "tree.svg") == names(table)
    said = words(TREES / "tree.svg")
    for leaf in table.leaves:
        assert (f"of {leaf.trials}" if leaf.trials else "untried") in said


@pytest.mark.parametrize("style", [tree.DOWNWARDS, tree.SIDEWAYS], ids=["downwards", "sideways"])
def test_panels_lie_on_the_page_and_apart(table: Table, job: Job, style: tree.Style) -> None:
    drawing = tree.drawing(table, job, replay(table, job, 100, 0), style)
    corners = np.array([(panel.x, panel.y) for panel in drawing.panels])
    assert np.all(corners >= 0.0)
    assert np.all(corners + tree.PANEL <= (drawing.width, drawing.height))
    apart = np.max(np.abs(corners[:, None] - corners), axis=-1) + tree.PANEL * np.eye(len(corners))
    assert np.all(apart >= tree.PANEL)
    assert (drawing.height > drawing.width) == style.sideways
