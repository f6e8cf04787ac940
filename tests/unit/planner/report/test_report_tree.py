"""The picture of a table: every node and leaf is on it once, with the figures that the table states."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from planner.job.model import Job
from planner.report import tree
from runtime.table import Table

TREES = Path(__file__).parents[4] / "trees" / "rectangle"
SVG = "{http://www.w3.org/2000/svg}"


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
