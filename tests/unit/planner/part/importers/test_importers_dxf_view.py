"""What is visible in a DXF drawing: layers that are off or frozen, blocks, flags, clips, plotting."""

import math

import numpy as np
import pytest
from drawings import PLATE, PLATE_MM2, area, box, dxf, notes, read, refused
from ezdxf.xclip import XClip

FRAME = (-10, -10), (55, 35)  # about the plate
CORNERS = (0, 0), (40, 20)  # of the plate


def inserted(corners, content, *inserts):
    """Returns a function that draws a box within nested blocks: one block for each of `inserts`.

    `content` are the attributes of the box; `inserts` are those of the references, from the inmost outwards.
    """

    def draw(space, document):
        box(document.blocks.new("BLOCK"), *corners, **content)
        for number, attributes in enumerate(inserts):
            last = number == len(inserts) - 1
            place = space if last else document.blocks.new(f"BLOCK{'+' * (number + 1)}")
            place.add_blockref(f"BLOCK{'+' * number}", (0, 0), attributes)

    return draw


def layer(name, **more):
    return {"layer": name, **more}


OFF, FROZEN, SHOWN, ZERO = map(layer, ("HIDDEN", "FROZEN", "SHOWN", "0"))
HIDDEN = {
    "insert that is off": inserted(FRAME, ZERO, OFF),
    "two deep": inserted(FRAME, ZERO, ZERO, OFF),
    "inner insert": inserted(FRAME, ZERO, OFF, SHOWN),
    "array": inserted(FRAME, ZERO, layer("HIDDEN", row_count=2, row_spacing=100)),
    "layer in other case": inserted(FRAME, ZERO, layer("hidden")),
    "frozen insert of shown content": inserted(FRAME, SHOWN, FROZEN),
    "frozen two deep": inserted(FRAME, SHOWN, ZERO, FROZEN),
    "content on a layer that is off": inserted(FRAME, OFF, SHOWN),
    "invisible": lambda space, _: box(space, *FRAME, invisible=1),
    "invisible in a block": inserted(FRAME, {"invisible": 1}, {}),
    "invisible insert": inserted(FRAME, SHOWN, {"invisible": 1}),
    "skewed insert": inserted(FRAME, ZERO, layer("HIDDEN", xscale=1.2, yscale=0.9)),
}
ELSEWHERE = {
    "paper space": lambda _, document: box(document.layout("Layout1"), *FRAME),
    "block without an insert": lambda _, document: box(document.blocks.new("B"), *FRAME),
}


@pytest.mark.parametrize("name", HIDDEN | ELSEWHERE)
def test_read_hidden_frame_about_a_plate_returns_the_plate(tmp_path, name):
    def both(space, document):
        document.layers.add("HIDDEN").off()
        document.layers.add("FROZEN").freeze()
        box(space, *CORNERS, layer="SHOWN")
        (HIDDEN | ELSEWHERE)[name](space, document)

    path = dxf(tmp_path, both)
    part = read(path)
    assert area(part) == pytest.approx(PLATE_MM2)
    assert not part.holes_mm
    assert ("not visible, left out" in notes(part)) == (name in HIDDEN)
    assert area(read(path, layer="SHOWN")) == pytest.approx(PLATE_MM2)


CUT = layer("CUT")
SEEN = {
    "shown though the insert is off": inserted(CORNERS, CUT, OFF),
    "two deep": inserted(CORNERS, ZERO, CUT, OFF),
    "by block": inserted(CORNERS, layer("0", color=0, linetype="BYBLOCK"), CUT),
    "inherited three deep": inserted(CORNERS, ZERO, ZERO, ZERO, layer("CUT", rotation=90)),
    "skewed": inserted(((0, 0), (20, 40)), ZERO, layer("CUT", xscale=2, yscale=0.5)),
}


@pytest.mark.parametrize("shown", SEEN.values(), ids=SEEN)
def test_read_block_content_on_a_visible_layer_is_the_outline(tmp_path, shown):
    def draw(space, document):
        document.layers.add("HIDDEN").off()
        shown(space, document)

    def with_frame(space, document):
        draw(space, document)
        box(space, *FRAME, layer="JIG")

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2)
    assert area(read(dxf(tmp_path, with_frame), layer="cut")) == pytest.approx(PLATE_MM2)


def test_read_hidden_layer_by_name_leaves_out_invisible_shapes(tmp_path):
    def draw(space, document):
        document.layers.add("CUT").off()
        document.layers.get("CUT").freeze()
        inserted(CORNERS, ZERO, CUT)(space, document)
        box(space, *FRAME, layer="CUT", invisible=1)

    path = dxf(tmp_path, draw)
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)
    error = refused(path, "no closed contour")
    assert any("not visible" in note for note in error.__notes__)


def test_read_unplotted_frame_about_the_outline_is_refused(tmp_path):
    def draw(space, document):
        document.layers.add("GUIDE").dxf.plot = 0
        box(space, *CORNERS)
        box(space, *FRAME, layer="GUIDE")

    path = dxf(tmp_path, draw)
    refused(path, "on layer GUIDE is not plotted, and goes around it")
    assert area(read(path, layer="0")) == pytest.approx(PLATE_MM2)
    assert area(read(path, layer="GUIDE")) == pytest.approx(65 * 45)


def test_read_clipped_block_returns_what_the_clip_leaves(tmp_path):
    def draw(space, document):
        block = document.blocks.new("SHEET")
        box(block, *CORNERS)
        box(block, (100, 0), (180, 60))
        XClip(space.add_blockref("SHEET", (0, 0))).set_block_clipping_path([(-5, -5), (50, 30)])

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2)


def test_read_polyline_with_a_width_notes_it(tmp_path):
    def draw(space, _):
        space.add_lwpolyline(PLATE, close=True, dxfattribs={"const_width": 1.5})
        space.add_lwpolyline([(5, 5, 0.2, 0.5), (8, 5), (8, 8)], close=True)

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2)
    assert "polylines with a width: 2, up to 1.5 mm wide" in notes(part)


def test_read_turned_block_in_a_stretched_one_is_refused(tmp_path):
    draw = inserted(CORNERS, ZERO, {"rotation": 30}, {"xscale": 2})
    refused(dxf(tmp_path, draw), r"'BLOCK\+' skews a block")


@pytest.mark.parametrize("y", [2, -2])
def test_read_array_in_a_block_is_stretched_and_mirrored_with_it(tmp_path, y):
    array = {"row_count": 2, "row_spacing": 30}
    path = dxf(tmp_path, inserted(CORNERS, ZERO, array, {"xscale": 2, "yscale": y, "rotation": 30}))
    one, other = (read(path, contour=number) for number in (1, 2))
    assert area(one) == pytest.approx(area(other)) == pytest.approx(4 * PLATE_MM2)
    apart = np.subtract(one.origin_mm, other.origin_mm)
    assert np.abs(apart) == pytest.approx([60 * 0.5, 60 * math.cos(math.pi / 6)])


@pytest.mark.parametrize(("x", "y", "turn"), [(2, 2, 30), (2, -2, 90), (2, 0.5, 180)])
def test_read_nested_block_is_turned_and_stretched(tmp_path, x, y, turn):
    draw = inserted(CORNERS, ZERO, {"rotation": turn}, {"xscale": x, "yscale": y})
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2 * abs(x * y))
