"""Shapes of DXF files that cannot be read: named, and refused where they may be the outline."""

import re

import pytest
from drawings import PLATE_MM2, area, box, dxf, notes, read
from ezdxf.math import Vec3

from planner.cli import init
from runtime.shell.errors import InputError

ROUND = [(30, 10, 0), (20, 25, 0), (0, 20, 0), (-5, 5, 0), (10, -5, 0), (30, 10, 0)]


def hole(space, _=None):
    space.add_circle((15, 10), 3)


def spline(space):
    return space.add_open_spline(ROUND)


def no_knots(space, _):
    spline(space).knots = []


def too_few_knots(space, _):
    curve = spline(space)
    curve.knots = list(curve.knots)[:-2]


def wrong_weights(space, _):
    spline(space).weights = [1.0, 2.0]


def too_few_points(space, _):
    spline(space).control_points = ROUND[:2]


def no_points(space, _):
    curve = spline(space)
    curve.control_points, curve.knots = [], []


def one_fit_point(space, _):
    curve = space.add_spline([(0, 0), (10, 10), (20, 0)])
    curve.fit_points = [(0, 0, 0)]


def flat_ellipse(space, _):
    space.add_ellipse((15, 10), (20, 0), 0.5).dxf.__dict__["major_axis"] = Vec3(0, 0, 0)


def undefined_block(space, _):
    space.add_blockref("NOWHERE", (0, 0))


def undefined_block_in_a_block(space, document):
    document.blocks.new("OUTER").add_blockref("NOWHERE", (0, 0))
    space.add_blockref("OUTER", (0, 0))


def xref(space, document):
    document.add_xref_def("other.dxf", "XREF")
    space.add_blockref("XREF", (0, 0))


def solid_body(space, _):
    space.add_region().sat = ["700 0 1 0", "End-of-ACIS-data"]


LOST = {
    no_knots: "SPLINE",
    too_few_knots: "SPLINE",
    wrong_weights: "SPLINE",
    too_few_points: "SPLINE",
    no_points: "SPLINE",
    one_fit_point: "SPLINE",
    flat_ellipse: "ELLIPSE",
    undefined_block: "INSERT",
    undefined_block_in_a_block: "INSERT",
    xref: "xref",
    solid_body: "REGION",
}


@pytest.mark.parametrize("draw", LOST)
def test_lost_outline_about_a_hole_is_refused_and_named(tmp_path, draw):
    def both(space, document):
        draw(space, document)
        hole(space)

    with pytest.raises(InputError, match=f"may be missing: .*{LOST[draw]}.*repair") as caught:
        read(dxf(tmp_path, both))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("draw", LOST)
def test_lost_outline_alone_is_named(tmp_path, capsys, draw):
    path = dxf(tmp_path, draw)
    flags = [
        "--radius",
        "3",
        "--gripper",
        "robotiq-2f-85",
        "--fingers",
        "rubber",
        "--thickness",
        "10",
    ]
    code = init.main([str(path), "-o", str(tmp_path / "job.toml"), *flags])
    error = capsys.readouterr().err
    assert code == InputError.exit_code
    assert LOST[draw] in error
    assert error.count("\n") == 1
    assert not (tmp_path / "job.toml").exists()


def test_lost_xref_on_a_hidden_or_another_layer_is_none(tmp_path):
    def draw(space, document):
        document.add_xref_def("other.dxf", "XREF")
        space.add_blockref("XREF", (0, 0), dxfattribs={"layer": "TITLE"})
        box(space, (0, 0), (40, 20), layer="CUT")

    path = dxf(tmp_path, draw)
    with pytest.raises(InputError, match="xref"):
        read(path)
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)


def hatch(space, *corners):
    space.add_hatch().paths.add_polyline_path(corners, is_closed=True)


@pytest.mark.parametrize(
    "corners", [[(0, 0), (40, 0), (40, 20), (0, 20)], [(2, 2), (9, 2), (9, 9)]]
)
def test_hatch_within_the_outline_is_ignored(tmp_path, corners):
    def draw(space, _):
        box(space, (0, 0), (40, 20))
        hole(space)
        hatch(space, *corners)
        space.add_solid([(50, 0), (51, 0), (50.5, 2)])  # an arrow head

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2)
    assert "1 HATCH, 1 SOLID" in notes(part)


def test_what_no_outline_can_be_is_no_loss(tmp_path):
    def draw(space, _):
        box(space, (0, 0), (40, 20))
        space.add_linear_dim(base=(0, -6), p1=(0, 0), p2=(40, 0)).render()
        space.add_mtext("a plate")
        space.add_leader([(0, 0), (-5, -5), (-9, -5)])

    path = dxf(tmp_path, draw)
    text = re.sub(r"\*D1\n", "*D7\n", path.read_text(), count=1)
    path.write_text(text)
    assert area(read(path)) == pytest.approx(PLATE_MM2)


def test_number_that_had_to_be_guessed_is_refused(tmp_path):
    path = dxf(tmp_path, lambda space, _: (hole(space), space.add_line((123.5, 0), (1, 0))))
    path.write_text(path.read_text().replace("123.5", "12x3.5"))
    with pytest.raises(InputError, match="floating point"):
        read(path)


def test_file_cut_short_among_its_shapes_is_refused(tmp_path):
    path = dxf(tmp_path, lambda space, _: (hole(space), box(space, (0, 0), (40, 20))))
    text = path.read_text()
    path.write_text(text[: text.index("LWPOLYLINE", text.index("ENTITIES"))])
    with pytest.raises(InputError, match="cut short"):
        read(path)


def too_many_knots(space, _):
    curve = spline(space)
    curve.knots = [*curve.knots, 9.0, 10.0]


def knots_that_fall(space, _):
    curve = spline(space)
    curve.knots = list(curve.knots)[::-1]


def polygon_mesh(space, _):
    space.add_polymesh((4, 4))


@pytest.mark.parametrize("draw", [too_many_knots, knots_that_fall, polygon_mesh])
def test_shape_that_cannot_be_drawn_is_named(tmp_path, draw):
    path = dxf(tmp_path, lambda space, _: (hole(space), draw(space, _)))
    with pytest.raises(InputError, match=r"its (SPLINE|POLYLINE) #\w+ cannot be drawn"):
        read(path)


def with_unknown(path, layer):
    """The file with an entity of a kind that ezdxf does not know."""
    unknown = (
        f"  0\nNEWSHAPE\n  5\nABC\n330\n17\n100\nAcDbEntity\n  8\n{layer}\n100\nAcDbNewShape\n"
    )
    head, tail = path.read_text().split("ENTITIES\n", 1)
    path.write_text(f"{head}ENTITIES\n{unknown}{tail}")


def test_unknown_shape_is_lost_where_it_is_seen(tmp_path):
    def draw(space, document):
        document.layers.add("HIDDEN").off()
        box(space, (0, 0), (40, 20), layer="CUT")

    path = dxf(tmp_path, draw)
    with_unknown(path, "OTHER")
    with pytest.raises(InputError, match="may be missing: NEWSHAPE"):
        read(path)
    assert area(read(path, layer="CUT")) == pytest.approx(PLATE_MM2)
    path = dxf(tmp_path, draw)
    with_unknown(path, "HIDDEN")
    assert area(read(path)) == pytest.approx(PLATE_MM2)


def test_frame_of_a_fitted_polyline_is_no_part_of_it(tmp_path):
    def draw(space, _):
        shape = space.add_polyline2d([(0, 0), (40, 0), (40, 20), (0, 20)], close=True)
        shape.dxf.flags |= shape.SPLINE_FIT_VERTICES_ADDED
        for vertex in shape.vertices:
            vertex.dxf.flags = vertex.SPLINE_FRAME_CONTROL_POINT
        shape.append_vertices([(5, 5), (35, 5), (35, 15), (5, 15)], {"flags": 8})

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(300)


def test_hatch_beyond_all_contours_may_be_the_outline(tmp_path):
    def draw(space, _):
        hole(space)
        hatch(space, (0, 0), (40, 0), (40, 20), (0, 20))

    with pytest.raises(InputError, match="may be missing: HATCH"):
        read(dxf(tmp_path, draw))
