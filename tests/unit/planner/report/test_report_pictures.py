"""Pictures of squeezes, as image files and as a page."""

import json
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from html_pages import Page

from planner.arrays import Array
from planner.mechanics.clearance import Jaws
from planner.report import canvas, trajectory
from planner.report.trajectory import Squeezed

pytestmark = pytest.mark.slow

OUTLINE = np.array([[-15.0, -10.5], [15.0, -10.5], [15.0, 10.5], [-15.0, 10.5]])
JAWS = Jaws(85.0, 27.5, 9.5, 0.5)
WAY = [[4.0, 3.0, 0.4, 85.0], [4.0, 3.0, 0.4, 44.0], [3.0, 1.0, 0.2, 30.0], [2.5, 0.0, 0.0, 21.0]]
GRASP = Squeezed(np.array(WAY), "grasped")
MISS = Squeezed(np.array([[40.0, 0.0, 1.0, 85.0], [40.0, 0.0, 1.0, 0.0]]), "untouched")


def png_size(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


def test_save_writes_the_format_of_the_suffix(tmp_path: Path) -> None:
    for name in ("a.png", "a.svg", "a.pdf"):
        canvas.save(tmp_path / name, lambda: trajectory.figure(OUTLINE, JAWS, [GRASP]))
    width, height = png_size(tmp_path / "a.png")
    assert width > 300
    assert height > width
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF-")
    assert ET.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "a.svg", "a.pdf"}


def test_html_carries_its_data_and_needs_no_network(tmp_path: Path) -> None:
    path = tmp_path / "squeezes.html"
    trajectory.html(OUTLINE, JAWS, [GRASP, MISS], "<rectangle> & poses", path)
    page = path.read_text(encoding="utf-8")
    assert "&lt;rectangle&gt; &amp; poses" in page
    whole = Page(page)
    assert whole.open == []
    assert "default-src 'none'" in page
    assert not [tag for tag, _ in whole.elements if tag in ("img", "iframe")]
    data = json.loads(whole.scripts["data"])
    assert [squeeze["status"] for squeeze in data["squeezes"]] == ["grasped", "untouched"]
    assert len({len(squeeze["states"]) for squeeze in data["squeezes"]}) == 1
    finals: list[Array] = [
        np.array([*squeeze["states"][-1].values()]) for squeeze in data["squeezes"]
    ]
    for final, trace in zip(finals, [GRASP, MISS], strict=True):
        assert final == pytest.approx(trace.states[-1], abs=1e-4)
