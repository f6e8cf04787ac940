"""What of a DXF drawing is seen: layers through blocks, frozen and switched off, flags, clips, plotting."""

import pytest
from drawings import PLATE, PLATE_MM2, area, box, dxf, notes, read
from ezdxf.xclip import XClip

from runtime.shell.errors import InputError

FRAME = (-10, -10), (55, 35)


def jig(document, layer="0", name="JIG"):
    """A block with a frame about the plate."""
    block = document.blocks.new(name)
    box(block, *FRAME, layer=layer)
    return block


def plate_and(draw):
    def both(space, document):
        document.layers.add("HIDDEN").off()
        document.layers.add("FROZEN").freeze()
        document.layers.add("SHOWN")
        box(space, *[(0, 0), (40, 20)], layer="SHOWN")
        draw(space, document)

    return both


def off_insert(space, document):
    jig(document)
    space.add_blockref("JIG", (0, 0), {"layer": "HIDDEN"})


def off_insert_two_deep(space, document):
    jig(document)
    document.blocks.new("OUTER").add_blockref("JIG", (0, 0), {"layer": "0"})
    space.add_blockref("OUTER", (0, 0), {"layer": "HIDDEN"})


def off_inner_insert(space, document):
    jig(document)
    document.blocks.new("OUTER").add_blockref("JIG", (0, 0), {"layer": "HIDDEN"})
    space.add_blockref("OUTER", (0, 0), {"layer": "SHOWN"})


def off_array(space, document):
    jig(document)
    space.add_blockref("JIG", (0, 0), {"layer": "HIDDEN", "row_count": 2, "row_spacing": 100})


def off_layer_in_other_case(space, document):
    jig(document)
    space.add_blockref("JIG", (0, 0), {"layer": "hidden"})


def frozen_insert_of_shown_content(space, document):
    jig(document, "SHOWN")
    space.add_blockref("JIG", (0, 0), {"layer": "FROZEN"})


def frozen_two_deep(space, document):
    jig(document, "SHOWN")
    document.blocks.new("OUTER").add_blockref("JIG", (0, 0), {"layer": "0"})
    space.add_blockref("OUTER", (0, 0), {"layer": "FROZEN"})


def content_on_an_off_layer(space, document):
    jig(document, "HIDDEN")
    space.add_blockref("JIG", (0, 0), {"layer": "SHOWN"})


def invisible_entity(space, document):
    box(space, *FRAME, invisible=1)


def invisible_entity_in_a_block(space, document):
    box(document.blocks.new("B"), *FRAME, invisible=1)
    space.add_blockref("B", (0, 0))


def invisible_insert(space, document):
    jig(document, "SHOWN")
    space.add_blockref("JIG", (0, 0), {"invisible": 1})


def skewed_insert(space, document):
    jig(document)
    space.add_blockref("JIG", (0, 0), {"layer": "HIDDEN", "xscale": 1.2, "yscale": 0.9})


def layer_zero_off_itself(space, document):
    document.layers.get("0").off()
    box(space, *FRAME, layer="0")


def paper_space(space, document):
    box(document.layout("Layout1"), *FRAME)


def unused_block(space, document):
    jig(document)


def attribute(space, document):
    block = document.blocks.new("B")
    block.add_attdef("NUMBER", (0, 0))
    space.add_blockref("B", (5, 5)).add_attrib("NUMBER", "17", (5, 5))


HIDDEN = (
    off_insert,
    off_insert_two_deep,
    off_inner_insert,
    off_array,
    off_layer_in_other_case,
    frozen_insert_of_shown_content,
    frozen_two_deep,
    content_on_an_off_layer,
    invisible_entity,
    invisible_entity_in_a_block,
    invisible_insert,
    skewed_insert,
    layer_zero_off_itself,
    paper_space,
    unused_block,
    attribute,
)


@pytest.mark.parametrize("draw", HIDDEN)
def test_what_is_hidden_is_no_outline(tmp_path, draw):
    path = dxf(tmp_path, plate_and(draw))
    part = read(path)
    assert area(part) == pytest.approx(PLATE_MM2)
    assert not part.holes_mm
    if draw not in (paper_space, unused_block, attribute):
        assert "not visible, left out" in notes(part)
    assert area(read(path, layer="SHOWN")) == pytest.approx(PLATE_MM2)


def block_of(place, name="PART", inner="0"):
    box(place.blocks.new(name), (0, 0), (40, 20), layer=inner)


def shown_by_the_insert(space, document):
    document.layers.get("0").off()
    block_of(document)
    space.add_blockref("PART", (0, 0), {"layer": "CUT"})


def shown_though_the_insert_is_off(space, document):
    block_of(document, inner="CUT")
    document.layers.add("HIDDEN").off()
    space.add_blockref("PART", (0, 0), {"layer": "HIDDEN"})


def shown_two_deep(space, document):
    document.layers.add("HIDDEN").off()
    block_of(document)
    document.blocks.new("OUTER").add_blockref("PART", (0, 0), {"layer": "CUT"})
    space.add_blockref("OUTER", (0, 0), {"layer": "HIDDEN"})


def by_block(space, document):
    box(document.blocks.new("PART"), (0, 0), (40, 20), layer="0", color=0, linetype="BYBLOCK")
    space.add_blockref("PART", (0, 0), {"layer": "CUT"})


def inherited_three_deep(space, document):
    block_of(document)
    document.blocks.new("B").add_blockref("PART", (0, 0), {"layer": "0"})
    document.blocks.new("C").add_blockref("B", (0, 0), {"layer": "0"})
    space.add_blockref("C", (0, 0), {"layer": "CUT", "rotation": 90})


def skewed(space, document):
    box(document.blocks.new("PART"), (0, 0), (20, 40))
    space.add_blockref("PART", (0, 0), {"layer": "CUT", "xscale": 2, "yscale": 0.5})


def dashed(space, document):
    document.linetypes.add("DASH", [1.0, 0.5, -0.5])
    block_of(document)
    space.add_blockref("PART", (0, 0), {"layer": "CUT"})
    document.layers.add("CUT", linetype="DASH")


@pytest.mark.parametrize(
    "draw",
    [
        shown_by_the_insert,
        shown_though_the_insert_is_off,
        shown_two_deep,
        by_block,
        inherited_three_deep,
        skewed,
        dashed,
    ],
)
def test_what_is_shown_is_read_by_its_layer_too(tmp_path, draw):
    def with_jig(space, document):
        draw(space, document)
        jig(document)
        space.add_blockref("JIG", (0, 0), {"layer": "JIG"})

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2)
    assert area(read(dxf(tmp_path, with_jig), layer="cut")) == pytest.approx(PLATE_MM2)


def test_layer_asked_for_is_read_though_it_is_off_but_not_what_is_invisible_on_it(tmp_path):
    def draw(space, document):
        document.layers.add("CUT").off()
        document.layers.get("CUT").freeze()
        block_of(document)
        space.add_blockref("PART", (0, 0), {"layer": "CUT"})
        box(space, *FRAME, layer="CUT", invisible=1)

    path = dxf(tmp_path, draw)
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)
    with pytest.raises(InputError, match="no closed contour") as caught:
        read(path)
    assert any("not visible" in note for note in caught.value.__notes__)


def unplotted(*boxes):
    def draw(space, document):
        document.layers.add("GUIDE").dxf.plot = 0
        box(space, (0, 0), (40, 20))
        for low, high in boxes:
            box(space, low, high, layer="GUIDE")

    return draw


def test_what_is_not_plotted_about_the_part_may_be_the_outline(tmp_path):
    path = dxf(tmp_path, unplotted(FRAME))
    with pytest.raises(InputError, match="on layer GUIDE is not plotted, and goes around it"):
        read(path)
    assert area(read(path, layer="0")) == pytest.approx(PLATE_MM2)
    assert area(read(path, layer="GUIDE")) == pytest.approx(65 * 45)


def test_clipped_block_shows_what_the_clip_leaves(tmp_path):
    def draw(space, document):
        block = document.blocks.new("SHEET")
        box(block, (0, 0), (40, 20))
        box(block, (100, 0), (180, 60))
        insert = space.add_blockref("SHEET", (0, 0))
        XClip(insert).set_block_clipping_path([(-5, -5), (50, 30)])

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2)


def test_polyline_width_is_noted(tmp_path):
    def draw(space, _):
        space.add_lwpolyline(PLATE, close=True, dxfattribs={"const_width": 1.5})
        space.add_lwpolyline([(5, 5, 0.2, 0.5), (8, 5), (8, 8)], close=True)
        space.add_polyline2d(
            [(25, 5), (28, 5), (28, 8)], close=True, dxfattribs={"default_start_width": 3.0}
        )

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2)
    assert "polylines with a width: 3, up to 3 mm wide" in notes(part)


@pytest.mark.parametrize("rotation", [30, 90])
def test_turned_block_in_a_stretched_one_is_refused(tmp_path, rotation):
    def draw(space, document):
        block_of(document)
        document.blocks.new("OUTER").add_blockref("PART", (0, 0), {"rotation": rotation})
        space.add_blockref("OUTER", (0, 0), {"xscale": 2})

    with pytest.raises(InputError, match="'OUTER' skews a block"):
        read(dxf(tmp_path, draw))


@pytest.mark.parametrize(
    ("outer", "inner"), [((2, 2), 30), ((2, -2), 90), ((2, 0.5), 0), ((2, 0.5), 180)]
)
def test_blocks_in_blocks_are_turned_and_stretched(tmp_path, outer, inner):
    def draw(space, document):
        block_of(document)
        document.blocks.new("OUTER").add_blockref("PART", (0, 0), {"rotation": inner})
        space.add_blockref("OUTER", (0, 0), {"xscale": outer[0], "yscale": outer[1]})

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2 * abs(outer[0] * outer[1]))
