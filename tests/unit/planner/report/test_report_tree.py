"""The picture of a table: every node and leaf is on it once, with the figures that the table states."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from planner.job.model import Job
from planner.report import tree
from planner.report.replay import replay
from runtime.table import Table

SVG = "{http://www.w3.org/2000/svg}"


def panels(path: Path) -> list[str]:
    ids = [group.get("id", "") for group in ET.parse(path).iter(f"{SVG}g")]
    return sorted(name for name in ids if re.fullmatch(r"(node|leaf)-\d+", name))


def names(table: Table) -> list[str]:
    nodes = [f"node-{index}" for index in range(len(table.nodes))]
    return sorted([*nodes, *(f"leaf-{index}" for index in range(len(table.leaves)))])


@pytest.fixture(scope="module")
def drawn(table: Table, job: Job, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tree") / "tree.svg"
    path.write_text(tree.picture(table, job, replay(table, job, 200, 0)))
    return path


def test_one_panel_a_node_and_a_leaf(table: Table, drawn: Path) -> None:
    assert panels(drawn) == names(table)
