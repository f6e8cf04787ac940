"""The picture of a table: every node and leaf is on it once, with the figures that the table states."""

import re
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from sample_tables import small_table

from planner import job as job_file
from planner.job import Job
from planner.report import canvas, tree
from planner.report.replay import replay
from runtime.table import Table, load

TREES = Path(__file__).parents[2] / "trees" / "rectangle"
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


def words(table: Table, job: Job, trials: int = 100) -> list[str]:
    figure = tree.figure(table, job, replay(table, job, trials, 0))
    return [text.get_text() for text in figure.axes[0].texts]


def test_one_panel_a_node_and_a_leaf(table: Table, job: Job, tmp_path: Path) -> None:
    path = tmp_path / "tree.svg"
    tree.draw(table, job, path, trials=200)
    assert panels(path) == names(table)


def test_readme_picture_shows_the_table_beside_it(table: Table) -> None:
    assert panels(TREES / "tree.svg") == names(table)
    assert (TREES / "tree.svg").stat().st_size < 500_000
    said = re.findall(r"<!-- (.*?) -->", (TREES / "tree.svg").read_text(encoding="utf-8"))
    for leaf in table.leaves:
        assert (f"of {leaf.trials}" if leaf.trials else "untried") in said


def test_branches_state_their_intervals_and_leaves_their_trials(table: Table, job: Job) -> None:
    said = words(table, job)
    for node in table.nodes:
        for branch in node.branches:
            assert f"{branch.low_um / 1e3:.1f}\N{EN DASH}{branch.high_um / 1e3:.1f}" in said
    for leaf in table.leaves:
        assert (f"of {leaf.trials}" if leaf.trials else "untried") in said


def test_unresolved_leaves_claim_no_pose(job: Job) -> None:
    said = words(small_table(), job)
    assert said.count("resolved") == 1
    assert "\N{MINUS SIGN}1.2, \N{MINUS SIGN}2.0" in said
    assert "90.0°" in said


def test_small_tree_leaves_room_for_the_legend(job: Job, tmp_path: Path) -> None:
    path = tmp_path / "small.png"
    tree.draw(small_table(), job, path, trials=100)
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert width >= 2 * tree.LEGEND_PX
    assert height > 3 * 2 * tree.PANEL


def test_texts_stay_on_the_page(table: Table, job: Job) -> None:
    with canvas.style():
        figure = tree.figure(table, job, replay(table, job, 100, 0))
        figure.draw_without_rendering()
        page = figure.bbox
        boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert all(page.x0 <= box.x0 and box.x1 <= page.x1 for box in boxes)
    assert all(page.y0 <= box.y0 and box.y1 <= page.y1 for box in boxes)
    # No two of them lie on each other.
    lows = np.array([[box.x0, box.y0] for box in boxes])
    highs = np.array([[box.x1, box.y1] for box in boxes])
    shared = np.minimum(highs[:, None], highs) - np.maximum(lows[:, None], lows)
    deep = np.all(shared > 1.0, axis=-1)
    assert np.count_nonzero(deep) == len(boxes)


def test_same_table_same_bytes(table: Table, job: Job, tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg"):
        tree.draw(table, job, tmp_path / name, trials=50)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
