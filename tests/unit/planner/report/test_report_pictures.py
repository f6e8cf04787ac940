"""Pictures of squeezes: right shapes, whole files in the format of their names, nothing left of a failure."""

import json
import re
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from html_pages import Page
from PIL import Image

from planner.arrays import Array
from planner.report import canvas, trajectory
from planner.report.trajectory import Squeezed

pytestmark = pytest.mark.slow

OUTLINE = np.array([[-15.0, -10.5], [15.0, -10.5], [15.0, 10.5], [-15.0, 10.5]])
JAWS = np.array([85.0, 27.5, 9.5, 0.5])
GRASP = Squeezed(
    np.array(
        [[4.0, 3.0, 0.4, 85.0], [4.0, 3.0, 0.4, 44.0], [3.0, 1.0, 0.2, 30.0], [2.5, 0.0, 0.0, 21.0]]
    ),
    "grasped",
)
MISS = Squeezed(np.array([[40.0, 0.0, 1.0, 85.0], [40.0, 0.0, 1.0, 0.0]]), "untouched")


def png_size(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


def groups(path: Path) -> list[str]:
    ids = [
        element.get("id", "") for element in ET.parse(path).iter("{http://www.w3.org/2000/svg}g")
    ]
    return [name for name in ids if re.fullmatch(r"(squeeze|node|leaf)-\d+", name)]


def test_outlines_are_turned_then_moved() -> None:
    poses = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, np.pi / 2], [-3.0, 0.5, 0.3]])
    placed = canvas.outlines(OUTLINE, poses)
    assert placed[0] == pytest.approx(OUTLINE + np.array([1.0, 2.0]))
    assert placed[1][0] == pytest.approx([1.0 + 10.5, 2.0 - 15.0])
    z = (OUTLINE[:, 0] + 1j * OUTLINE[:, 1]) * np.exp(0.3j) + (-3.0 + 0.5j)
    assert placed[2] == pytest.approx(np.stack([z.real, z.imag], axis=-1))


@pytest.mark.parametrize(("share", "middle"), [(0.5, 0.0), (1.0, -12.5), (0.0, 12.5)])
def test_fingers_leave_the_width_between_them(share: float, middle: float) -> None:
    # One finger alone closes 85 mm to 60 mm: the gap's middle moves half of that towards the other.
    upper, lower = canvas.finger_boxes(np.array([85.0, 27.5, 9.5, share]), 60.0)
    assert upper[:, 1].min() - lower[:, 1].max() == pytest.approx(60.0)
    assert 0.5 * (upper[:, 1].min() + lower[:, 1].max()) == pytest.approx(middle)
    for box in (upper, lower):
        assert np.ptp(box, axis=0) == pytest.approx([27.5, 9.5])


def test_interpolation_passes_through_the_steps() -> None:
    assert trajectory.along(GRASP.states, GRASP.states[:, 3]) == pytest.approx(GRASP.states)
    halfway = trajectory.along(GRASP.states, np.array([37.0]))
    assert halfway[0] == pytest.approx([3.5, 2.0, 0.3, 37.0])


def test_of_two_states_at_one_width_the_later_counts() -> None:
    slip = np.array([[0.0, 0.0, 0.0, 40.0], [1.0, 0.0, 0.0, 30.0], [5.0, 0.0, 0.0, 30.0]])
    assert trajectory.along(slip, np.array([30.0]))[0, 0] == pytest.approx(5.0)


@pytest.mark.parametrize(("trace", "width"), [(GRASP, 44.0), (MISS, 0.0)])
def test_touch_is_where_the_part_begins_to_move(trace: Squeezed, width: float) -> None:
    assert trajectory.touch(trace.states) == width


def test_trail_has_equal_distances_and_both_ends() -> None:
    path = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 7.0]])
    marks = trajectory.trail(path)
    assert marks[[0, -1]] == pytest.approx(path[[0, -1]])
    along = np.abs(marks[:, 0]) + np.abs(marks[:, 1])  # the length walked on this path
    assert np.ptp(np.diff(along)) < 1e-9
    assert np.diff(along)[0] == pytest.approx(trajectory.MARK_MM, rel=0.2)


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_one_panel_a_squeeze(tmp_path: Path, count: int) -> None:
    traces = [GRASP, MISS, GRASP, GRASP, MISS] * 3
    path = tmp_path / "squeezes.svg"
    canvas.save(path, lambda: trajectory.figure(OUTLINE, JAWS, traces[:count]))
    assert groups(path) == [f"squeeze-{k + 1}" for k in range(count)]


def test_panels_hold_everything_at_one_scale() -> None:
    figure = trajectory.figure(OUTLINE, JAWS, [GRASP, MISS])
    for axes, trace in zip(figure.axes, [GRASP, MISS], strict=True):
        assert axes.get_aspect() == 1.0
        x, y = axes.get_xlim()[1], axes.get_ylim()[1]
        corners = np.abs(canvas.outlines(OUTLINE, trace.states[:, :3])).max(axis=(0, 1))
        assert np.all(corners <= [x, y])
        assert y >= 0.5 * JAWS[0] + JAWS[2]
        assert trace.status in axes.get_title()


def test_formats_follow_the_name(tmp_path: Path) -> None:
    for name in ("a.png", "a.svg", "a.pdf"):
        canvas.save(tmp_path / name, lambda: trajectory.figure(OUTLINE, JAWS, [GRASP]))
    width, height = png_size(tmp_path / "a.png")
    assert width > 300
    assert height > width
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF-")
    assert ET.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "a.svg", "a.pdf"}


def test_same_picture_same_bytes(tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg"):
        canvas.save(tmp_path / name, lambda: trajectory.figure(OUTLINE, JAWS, [GRASP, MISS]))
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_failure_leaves_the_old_picture(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")
    broken = Squeezed(np.zeros((0, 4)), "grasped")
    with pytest.raises((IndexError, ValueError)):
        trajectory.gif(OUTLINE, JAWS, broken, path)
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == {"a.gif": b"old"}


@pytest.mark.parametrize("trace", [GRASP, MISS], ids=["grasp", "miss"])
def test_timeline_begins_open_and_ends_final(trace: Squeezed) -> None:
    frames = trajectory.timeline(trace.states)
    assert frames[0] == pytest.approx(trace.states[0])
    assert frames[-1] == pytest.approx(trace.states[-1])
    assert np.all(np.diff(frames[:, 3]) <= 0)


def test_gif_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trajectory, "CONTACT_FRAMES", 6)
    path = tmp_path / "squeeze.gif"
    trajectory.gif(OUTLINE, JAWS, GRASP, path)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.n_frames == len(
            trajectory.timeline(GRASP.states)
        )  # Pillow merges the held frames
        first = np.asarray(image.convert("L"), dtype=float)
        image.seek(image.n_frames - 1)
        last = np.asarray(image.convert("L"), dtype=float)
        assert image.info["duration"] >= 1000
    assert np.abs(first - last).mean() > 1.0
    # Axes and labels stand still, but for what the two palettes make of their grey.
    assert np.abs(first - last)[:, :40].max() < 16.0


def test_page_carries_its_data_and_needs_no_network(tmp_path: Path) -> None:
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
