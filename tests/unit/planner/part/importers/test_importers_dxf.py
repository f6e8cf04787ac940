"""Odd, damaged and hostile DXF files: the right outline, or a sentence that says what to do."""

import io
import math

import ezdxf
import numpy as np
import pytest

from planner.part import outline as outlines
from planner.part.importers.file import read_outline
from planner.part.importers.pieces import Options
from runtime.shell.errors import ExpectedError, InputError, UsageError

RECTANGLE = [(0, 0), (30, 0), (30, 21), (0, 21)]


def drawn(tmp_path, draw, units=4, version="R2010"):
    """A file in which `draw(model_space, document)` has drawn."""
    document = ezdxf.new(version)
    document.units = units
    draw(document.modelspace(), document)
    path = tmp_path / "part.dxf"
    document.saveas(path)
    return path


def read(path, **options):
    return read_outline(path, Options(**options))


def is_rectangle(result, scale=1.0):
    assert np.allclose(sorted(result.size_mm), (21 * scale, 30 * scale), atol=0.03)
    assert len(result.outline_mm) == 4
    assert result.symmetry == 2
    assert outlines.area(result.outline_mm) == pytest.approx(630 * scale**2, rel=2e-3)


def polyline(space, points=RECTANGLE, close=True):
    space.add_lwpolyline(points, close=close)


def lines(space, points=RECTANGLE, gap=0.0):
    for k, (x, y) in enumerate(points):
        space.add_line((x + gap, y), points[(k + 1) % len(points)])


@pytest.mark.parametrize(("code", "mm"), [(1, 25.4), (5, 10.0), (4, 1.0)])
def test_units_of_the_file_are_believed(tmp_path, code, mm):
    is_rectangle(read(drawn(tmp_path, lambda m, d: polyline(m), units=code)), mm)


def test_unitless_asks_for_units(tmp_path):
    path = drawn(tmp_path, lambda m, d: polyline(m), units=0)
    with pytest.raises(UsageError, match="--units mm, cm, in or m"):
        read(path)
    is_rectangle(read(path, units="mm"))
    is_rectangle(read(path, units="in"), 25.4)


def test_an_open_contour_says_where(tmp_path):
    with pytest.raises(InputError, match=r"open at .* 0\.5 mm away; close it"):
        read(drawn(tmp_path, lambda m, d: lines(m, gap=0.5)))


@pytest.mark.parametrize("tolerance", [0.005, 0.02, 0.1])
def test_a_circle_is_flattened_to_the_tolerance(tmp_path, tolerance):
    result = read(drawn(tmp_path, lambda m, d: m.add_circle((50, 50), 15)), tolerance_mm=tolerance)
    vertices = result.outline_mm
    middles = 0.5 * (vertices + np.roll(vertices, 1, axis=0))
    radii = np.hypot(*np.concatenate([vertices, middles]).T)
    assert np.abs(radii - 15).max() <= tolerance
    assert result.symmetry > 4


def test_bulges_splines_and_ellipses_are_curves(tmp_path):
    slot = [(0, 0, 0, 0, 0), (20, 0, 0, 0, 1), (20, 10, 0, 0, 0), (0, 10, 0, 0, 1)]
    result = read(drawn(tmp_path, lambda m, d: m.add_lwpolyline(slot, close=True)))
    assert outlines.area(result.outline_mm) == pytest.approx(200 + 25 * math.pi, rel=2e-3)
    result = read(drawn(tmp_path, lambda m, d: m.add_ellipse((0, 0), (20, 0), ratio=0.5)))
    assert outlines.area(result.outline_mm) == pytest.approx(200 * math.pi, rel=2e-3)
    around = [(0, 0), (30, 0), (30, 20), (0, 20)]

    def spline(space, document):
        space.add_spline(degree=3).set_closed([(x, y, 0) for x, y in around], degree=3)

    assert read(drawn(tmp_path, spline)).symmetry == 2


def test_several_parts_are_listed_to_choose_from(tmp_path):
    def draw(space, document):
        polyline(space)
        space.add_circle((60, 10), 5)

    path = drawn(tmp_path, draw)
    with pytest.raises(UsageError, match=r"--contour N: 1: 30 x 21 mm; 2: 10 x 10 mm"):
        read(path)
    is_rectangle(read(path, contour=1))
    assert np.allclose(read(path, contour=2).size_mm, 10, atol=0.05)
    with pytest.raises(UsageError, match="no contour 3"):
        read(path, contour=3)


def test_a_block_of_blocks_that_explodes_is_refused(tmp_path):
    def draw(space, document):
        document.blocks.new("B0").add_line((0, 0), (1, 0))
        for k in range(1, 12):
            block = document.blocks.new(f"B{k}")
            for shift in range(10):
                block.add_blockref(f"B{k - 1}", (shift, 0))
        space.add_blockref("B11", (0, 0))

    with pytest.raises(InputError, match="more than 20000 shapes"):
        read(drawn(tmp_path, draw))


def test_a_block_in_itself_is_refused(tmp_path):
    def draw(space, document):
        block = document.blocks.new("LOOP")
        block.add_line((0, 0), (1, 0))
        block.add_blockref("LOOP", (1, 1))
        space.add_blockref("LOOP", (0, 0))

    with pytest.raises(InputError, match="contains itself"):
        read(drawn(tmp_path, draw))


def test_a_figure_of_eight_is_refused_with_its_place(tmp_path):
    crossed = [(0, 0), (30, 20), (30, 0), (0, 20)]
    with pytest.raises(InputError, match=r"crosses itself at"):
        read(drawn(tmp_path, lambda m, d: polyline(m, crossed)))


@pytest.mark.parametrize("scale", [0.01, 1e4])
def test_an_impossible_size_asks_about_the_unit(tmp_path, scale):
    points = [(x * scale, y * scale) for x, y in RECTANGLE]
    with pytest.raises(InputError, match="is the unit right"):
        read(drawn(tmp_path, lambda m, d: polyline(m, points)))


@pytest.mark.parametrize("x", [1e300, 1e12])
def test_absurd_coordinates_are_refused(tmp_path, x):
    points = [(0, 0), (x, 0), (x, 21), (0, 21)]
    with pytest.raises(InputError, match="beyond 10000 km"):
        read(drawn(tmp_path, lambda m, d: polyline(m, points)))


def text_of(version="R2010"):
    document = ezdxf.new(version)
    document.units = 4
    polyline(document.modelspace())
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue().encode()


DAMAGED = {
    "empty": b"",
    "blank": b"  \n\n",
    "binary rubbish": bytes(range(256)) * 20,
    "a picture": b"\x89PNG\r\n\x1a\n" + b"\0" * 500,
    "a web page": b"<!DOCTYPE html><html><body>404</body></html>",
    "one line": b"0\n",
    "only tags": b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nabc\n0\nENDSEC\n0\nEOF\n",
}


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_no_drawing_is_refused(tmp_path, name):
    path = tmp_path / "bad.dxf"
    path.write_bytes(DAMAGED[name])
    with pytest.raises((InputError, UsageError)) as caught:
        read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_file_cut_short_is_read_rightly_or_refused(tmp_path, share):
    data = text_of()
    path = tmp_path / "cut.dxf"
    path.write_bytes(data[: int(share * len(data))])
    try:
        result = read(path)
    except ExpectedError as error:
        result = error
    if isinstance(result, ExpectedError):
        assert "\n" not in str(result)
    else:
        is_rectangle(result)


def test_missing_files_and_other_suffixes(tmp_path):
    with pytest.raises(InputError, match="check the path"):
        read(tmp_path / "none.dxf")
    with pytest.raises(UsageError, match="not one of"):
        read(tmp_path / "part.dwg")
    with pytest.raises(UsageError, match="--tolerance"):
        read(drawn(tmp_path, lambda m, d: polyline(m)), tolerance_mm=0.0)


@pytest.mark.parametrize("sheet", [(297, 210), (420 - 30, 297 - 20)])
def test_the_frame_of_a_sheet_is_left_out(tmp_path, sheet):
    def draw(space, _):
        polyline(space, [(x + 40, y + 40) for x, y in RECTANGLE])
        polyline(space, [(0, 0), (sheet[0], 0), sheet, (0, sheet[1])])

    result = read(drawn(tmp_path, draw))
    is_rectangle(result)
    assert any("frame of a sheet" in note for note in result.notes)


def test_holes_lie_in_the_outline_and_the_origin_is_the_drawings(tmp_path):
    def draw(space, _):
        polyline(space, [(x + 7, y - 3) for x, y in RECTANGLE])
        space.add_circle((7 + 5, -3 + 6), 2)

    result = read(drawn(tmp_path, draw))
    assert np.allclose(result.origin_mm, (-7 - 15, 3 - 10.5))
    (hole,) = result.holes_mm
    assert np.allclose(hole.mean(axis=0), (5 - 15, 6 - 10.5), atol=0.05)
