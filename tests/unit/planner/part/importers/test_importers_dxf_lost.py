"""Unreadable shapes of DXF files are named, and a file is refused if such a shape may be its outline."""

import re

import pytest
from drawings import PLATE, PLATE_MM2, area, box, dxf, notes, read, refused
from ezdxf.math import Vec3

ROUND = [(30, 10, 0), (20, 25, 0), (0, 20, 0), (-5, 5, 0), (10, -5, 0), (30, 10, 0)]


def hole(space):
    space.add_circle((15, 10), 3)


def plate(space, **attributes):
    box(space, (0, 0), (40, 20), **attributes)


def spline(**broken):
    """Returns a function that draws a spline and then changes some of its attributes.

    `broken` maps an attribute's name to a function from the old value to the new one.
    """

    def draw(space, _):
        curve = space.add_open_spline(ROUND)
        for name, change in broken.items():
            setattr(curve, name, change(list(getattr(curve, name))))

    return draw


def flat_ellipse(space, _):
    space.add_ellipse((15, 10), (20, 0), 0.5).dxf.__dict__["major_axis"] = Vec3(0, 0, 0)


def one_fit_point(space, _):
    space.add_spline([(0, 0), (10, 10), (20, 0)]).fit_points = [(0, 0, 0)]


def undefined_block_in_a_block(space, document):
    document.blocks.new("OUTER").add_blockref("NOWHERE", (0, 0))
    space.add_blockref("OUTER", (0, 0))


def xref(space, document):
    document.add_xref_def("other.dxf", "XREF")
    space.add_blockref("XREF", (0, 0), dxfattribs={"layer": "TITLE"})


def solid_body(space, _):
    space.add_region().sat = ["700 0 1 0", "End-of-ACIS-data"]


def hatch(*corners):
    return lambda space, _: space.add_hatch().paths.add_polyline_path(corners, is_closed=True)


def upright(space, _):
    space.add_lwpolyline(PLATE, close=True, dxfattribs={"extrusion": (0, -1, 0)})


LOST = {
    "no knots": (spline(knots=lambda knots: []), "SPLINE"),
    "too few knots": (spline(knots=lambda knots: knots[:-2]), "SPLINE"),
    "wrong weights": (spline(weights=lambda _: [1.0, 2.0]), "SPLINE"),
    "too few points": (spline(control_points=lambda points: points[:2]), "SPLINE"),
    "no points": (spline(control_points=lambda _: [], knots=lambda _: []), "SPLINE"),
    "one fit point": (one_fit_point, "SPLINE"),
    "flat ellipse": (flat_ellipse, "ELLIPSE"),
    "undefined block": (lambda space, _: space.add_blockref("NOWHERE", (0, 0)), "INSERT"),
    "undefined block in a block": (undefined_block_in_a_block, "INSERT"),
    "xref": (xref, "xref"),
    "solid body": (solid_body, "REGION"),
    "hatch": (hatch(*PLATE), "HATCH"),
}


@pytest.mark.parametrize(("draw", "kind"), LOST.values(), ids=LOST)
def test_read_lost_outline_is_refused_and_named(tmp_path, draw, kind):
    about_a_hole = dxf(tmp_path, lambda *where: (draw(*where), hole(where[0])))
    refused(about_a_hole, f"may be missing: .*{kind}.*")
    alone = refused(dxf(tmp_path, draw))
    notes = getattr(alone, "__notes__", [])
    assert kind in " ".join([str(alone), *notes])
    assert all("\n" not in note for note in notes)


def test_read_outline_seen_edge_on_is_named(tmp_path):
    path = dxf(tmp_path, lambda *where: (upright(*where), hole(where[0])))
    assert "edge-on, left out: 1 LWPOLYLINE" in notes(read(path))


def test_read_layer_without_the_lost_xref_returns_its_outline(tmp_path):
    path = dxf(tmp_path, lambda *where: (xref(*where), plate(where[0], layer="CUT")))
    refused(path, "xref")
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)


def test_read_hatch_within_the_outline_is_ignored(tmp_path):
    def draw(space, _):
        plate(space)
        hatch((2, 2), (9, 2), (9, 9))(space, _)
        space.add_solid([(50, 0), (51, 0), (50.5, 2)])  # an arrow head

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2)
    assert "1 HATCH, 1 SOLID" in notes(part)


def test_read_dimensions_and_texts_are_ignored(tmp_path):
    def draw(space, _):
        plate(space)
        space.add_linear_dim(base=(0, -6), p1=(0, 0), p2=(40, 0)).render()
        space.add_mtext("a plate")
        space.add_leader([(0, 0), (-5, -5), (-9, -5)])

    path = dxf(tmp_path, draw)
    path.write_text(re.sub(r"\*D1\n", "*D7\n", path.read_text(), count=1))
    assert area(read(path)) == pytest.approx(PLATE_MM2)


def guessed(text):
    return text.replace("123.5", "12x3.5")


def cut_short(text):
    return text[: text.index("LWPOLYLINE", text.index("ENTITIES"))]


@pytest.mark.parametrize(("spoil", "reason"), [(guessed, "floating"), (cut_short, "cut short")])
def test_read_damaged_text_among_the_shapes_is_refused(tmp_path, spoil, reason):
    def draw(space, _):
        hole(space)
        space.add_line((123.5, 0), (1, 0))
        plate(space)

    path = dxf(tmp_path, draw)
    path.write_text(spoil(path.read_text()))
    refused(path, reason)


@pytest.mark.parametrize(
    "draw",
    [
        spline(knots=lambda knots: [*knots, 9.0, 10.0]),
        spline(knots=lambda knots: knots[::-1]),
        lambda space, _: space.add_polymesh((4, 4)),
    ],
    ids=["too many knots", "knots that fall", "polygon mesh"],
)
def test_read_shape_that_cannot_be_drawn_is_refused_and_named(tmp_path, draw):
    path = dxf(tmp_path, lambda *where: (hole(where[0]), draw(*where)))
    refused(path, r"its (SPLINE|POLYLINE) #\w+ cannot be drawn")


def test_read_unknown_shape_is_refused_where_it_is_visible(tmp_path):
    def draw(space, document):
        document.layers.add("HIDDEN").off()
        plate(space, layer="CUT")

    def with_unknown(layer):
        """A file with an entity of a kind that ezdxf does not know."""
        path = dxf(tmp_path, draw)
        unknown = f"0\nNEWSHAPE\n5\nABC\n330\n17\n100\nAcDbEntity\n8\n{layer}\n100\nAcDbNewShape\n"
        path.write_text(path.read_text().replace("ENTITIES\n", f"ENTITIES\n{unknown}", 1))
        return path

    path = with_unknown("OTHER")
    refused(path, "may be missing: NEWSHAPE")
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)
    assert area(read(with_unknown("HIDDEN"))) == pytest.approx(PLATE_MM2)
