"""Unusual, damaged and hostile DXF files: the right outline, or an error that states the remedy."""

import math

import ezdxf
import numpy as np
import pytest
from drawings import PLATE, PLATE_MM2, area, box, dxf, lines, notes, read, refused

from runtime.shell.errors import ExpectedError, InputError, UsageError


def polyline(points):
    return lambda space, _: space.add_lwpolyline(points, close=True)


def plate(space, _):
    box(space, (0, 0), (40, 20))


@pytest.mark.parametrize(
    ("code", "units", "mm"), [(1, None, 25.4), (5, None, 10), (0, "mm", 1), (0, "in", 25.4)]
)
def test_read_units_of_the_file_or_stated_ones_scale_the_outline(tmp_path, code, units, mm):
    part = read(dxf(tmp_path, plate, units=code), units=units)
    assert area(part) == pytest.approx(PLATE_MM2 * mm**2)
    assert (len(part.outline_mm), part.symmetry) == (4, 2)


@pytest.mark.parametrize("tolerance", [0.005, 0.1])
def test_read_circle_stays_within_the_tolerance(tmp_path, tolerance):
    part = read(dxf(tmp_path, lambda s, _: s.add_circle((50, 50), 15)), tolerance_mm=tolerance)
    middles = 0.5 * (part.outline_mm + np.roll(part.outline_mm, 1, axis=0))
    radii = np.hypot(*np.concatenate([part.outline_mm, middles]).T)
    assert np.abs(radii - 15).max() <= tolerance


def closed_fit_spline(space, _):
    """A circle through 12 fit points, without control points, as QCAD writes splines."""
    angles = np.arange(12) * math.tau / 12
    space.add_spline(20 * np.column_stack([np.cos(angles), np.sin(angles)])).closed = True


def seen_from_below(space, _):
    """Lines in world coordinates, and an arc whose extrusion points down, as in mirrored parts."""
    for ends in (((0, 0), (20, 0)), ((20, 20), (0, 20)), ((0, 20), (0, 0))):
        space.add_line(*ends)
    space.add_arc((-20, 10), 10, 90, 270, dxfattribs={"extrusion": (0, 0, -1)})


SLOT = [(0, 0, 0, 0, 0), (20, 0, 0, 0, 1), (20, 10, 0, 0, 0), (0, 10, 0, 0, 1)]


@pytest.mark.parametrize(
    ("draw", "mm2"),
    [
        (polyline(SLOT), 200 + 25 * math.pi),
        (lambda space, _: space.add_ellipse((0, 0), (20, 0), ratio=0.5), 200 * math.pi),
        (closed_fit_spline, 400 * math.pi),
        (seen_from_below, 400 + 50 * math.pi),
    ],
)
def test_read_curves_keep_their_area(tmp_path, draw, mm2):
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(mm2, rel=2e-3)


def test_read_several_parts_lists_them_to_choose_from(tmp_path):
    def draw(space, document):
        plate(space, document)
        space.add_circle((60, 10), 5)

    path = dxf(tmp_path, draw)
    refused(path, r"--contour N: 1: 40 x 20 mm; 2: 10 x 10 mm", UsageError)
    assert np.allclose(read(path, contour=2).size_mm, 10, atol=0.05)
    refused(path, "no contour 3", UsageError, contour=3)


def blocks_that_explode(space, document):
    document.blocks.new("B0").add_line((0, 0), (1, 0))
    for k in range(1, 12):
        block = document.blocks.new(f"B{k}")
        for shift in range(10):
            block.add_blockref(f"B{k - 1}", (shift, 0))
    space.add_blockref("B11", (0, 0))


def block_in_itself(space, document):
    block = document.blocks.new("LOOP")
    block.add_line((0, 0), (1, 0))
    block.add_blockref("LOOP", (1, 1))
    space.add_blockref("LOOP", (0, 0))


REFUSED = {
    "blocks that explode": (blocks_that_explode, "more than 20000 shapes"),
    "block in itself": (block_in_itself, "contains itself"),
    "figure of eight": (polyline([(0, 0), (30, 20), (30, 0), (0, 20)]), "crosses itself at"),
    "tiny": (polyline(0.01 * np.array(PLATE)), "is the unit right"),
    "huge": (polyline(1e4 * np.array(PLATE)), "is the unit right"),
    "absurd": (polyline([(0, 0), (1e300, 0), (1e300, 21), (0, 21)]), "beyond 10000 km"),
    "open": (lambda space, _: lines(space, [(0.5, 0), *PLATE[1:], (0, 0)], close=False), "0.5 mm"),
}


@pytest.mark.parametrize(("draw", "reason"), REFUSED.values(), ids=REFUSED)
def test_read_invalid_outline_is_refused_with_the_reason(tmp_path, draw, reason):
    refused(dxf(tmp_path, draw), reason)


DAMAGED = {
    "empty": b"",
    "binary rubbish": bytes(range(256)) * 20,
    "a picture": b"\x89PNG\r\n\x1a\n" + b"\0" * 500,
    "a web page": b"<!DOCTYPE html><html><body>404</body></html>",
    "one line": b"0\n",
    "only tags": b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nabc\n0\nENDSEC\n0\nEOF\n",
}


@pytest.mark.parametrize("data", DAMAGED.values(), ids=DAMAGED)
def test_read_damaged_file_is_refused_in_one_line(tmp_path, data):
    path = tmp_path / "bad.dxf"
    path.write_bytes(data)
    refused(path, error=(InputError, UsageError))


def test_read_binary_file_is_refused_as_such(tmp_path):
    path = tmp_path / "part.dxf"
    document = ezdxf.new()
    plate(document.modelspace(), document)
    document.saveas(path, fmt="bin")
    refused(path, "binary DXF file; .*as text")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_read_file_cut_short_is_right_or_refused(tmp_path, share):
    path = dxf(tmp_path, plate)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    try:
        assert area(read(path)) == pytest.approx(PLATE_MM2)
    except ExpectedError as error:
        assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize(
    ("name", "error", "reason"),
    [("none.dxf", InputError, "check the path"), ("part.dwg", UsageError, "not one of")],
)
def test_read_missing_file_or_another_suffix_is_refused(tmp_path, name, error, reason):
    refused(tmp_path / name, reason, error)


@pytest.mark.parametrize("sheet", [(297, 210), (420 - 30, 297 - 20), (420 - 25, 297 - 10)])
def test_read_frame_of_a_sheet_is_left_out(tmp_path, sheet):
    def draw(space, _):
        box(space, (40, 40), (80, 60))
        box(space, (0, 0), sheet)

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2)
    assert "frame of a sheet" in notes(part)


def test_read_plate_with_a_hole_smaller_than_a_sheet_is_no_frame(tmp_path):
    def draw(space, _):
        box(space, (0, 0), (180, 120))
        space.add_circle((60, 50), 20)

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(180 * 120)
    assert len(part.holes_mm) == 1


def test_read_hole_and_origin_keep_their_place_in_the_drawing(tmp_path):
    def draw(space, _):
        box(space, (7, -3), (47, 17))
        space.add_circle((7 + 5, -3 + 6), 2)

    part = read(dxf(tmp_path, draw))
    assert np.allclose(part.origin_mm, (-7 - 20, 3 - 10))
    (hole,) = part.holes_mm
    assert np.allclose(hole.mean(axis=0), (5 - 20, 6 - 10), atol=0.05)
    assert "1 inner contour (holes) ignored" in notes(part)
