"""Component bodies from KiCad footprints: every kind of shape, and what else a file may hold."""

import math

import numpy as np
import pytest
import shapely

from planner.errors import InputFileError, OutlineError
from planner.part.importers.file import read_outline
from planner.part.importers.pieces import Options

FAB = '(layer "F.Fab") (width 0.1))'


def lines(*corners, layer=FAB):
    ends = [*corners[1:], corners[0]]
    return [
        f"(fp_line (start {a} {b}) (end {c} {d}) {layer}"
        for (a, b), (c, d) in zip(corners, ends, strict=True)
    ]


def read(tmp_path, *shapes, head="(footprint"):
    path = tmp_path / "part.kicad_mod"
    path.write_text(f'{head} "part" (layer "F.Cu")\n' + "\n".join(shapes) + "\n)\n")
    return read_outline(path, Options(contour=1))


def test_lines_make_the_body_and_y_points_down(tmp_path):
    found = read(tmp_path, *lines((0, 0), (30, 0), (0, 10)), '(fp_text value "x" (at 1 2) (layer "F.Fab"))')
    assert shapely.Polygon(found.outline_mm).area == pytest.approx(150)
    corners = (
        found.outline_mm - found.outline_mm[np.argmin(found.outline_mm.sum(axis=1) + found.outline_mm[:, 1])]
    )
    assert {tuple(map(float, np.rint(corner))) for corner in corners} == {(0, 0), (0, 10), (30, 10)}


def test_other_layers_are_not_the_body(tmp_path):
    silk = lines((-50, -50), (50, -50), (50, 50), (-50, 50), layer='(layer "F.SilkS") (width 0.1))')
    found = read(tmp_path, *silk, f"(fp_rect (start -10 -5) (end 10 5) {FAB}")
    assert found.size_mm.tolist() == [20, 10]


@pytest.mark.parametrize(
    "arc",
    ["(fp_arc (start 0 -5) (mid 5 0) (end 0 5)", "(fp_arc (start 0 5) (mid 5 0) (end 0 -5)",
     "(fp_arc (start 0 0) (end 0 -5) (angle 180)", "(fp_arc (start 0 0) (end 0 5) (angle -180)"],
)  # fmt: skip
def test_a_half_disc_by_its_arc_as_either_version_writes_it(tmp_path, arc):
    found = read(tmp_path, f"{arc} {FAB}", f"(fp_line (start 0 5) (end 0 -5) {FAB}")
    assert shapely.Polygon(found.outline_mm).area == pytest.approx(12.5 * math.pi, rel=0.01)
    assert found.size_mm == pytest.approx([5, 10], abs=0.05)
    assert found.outline_mm[:, 0].max() == pytest.approx(5 - 20 / (3 * math.pi), abs=0.05)


def test_circles_and_polygons(tmp_path):
    disc = read(tmp_path, f"(fp_circle (center 3 4) (end 9 4) {FAB}")
    assert shapely.Polygon(disc.outline_mm).area == pytest.approx(36 * math.pi, rel=0.01)
    poly = read(tmp_path, f"(fp_poly (pts (xy 0 0) (xy 9 0) (xy 9 3)) {FAB}")
    assert shapely.Polygon(poly.outline_mm).area == pytest.approx(13.5)


def test_what_cannot_be_read_is_told_in_one_line(tmp_path):
    with pytest.raises(InputFileError, match="not a KiCad footprint"):
        read(tmp_path, head="(kicad_pcb")
    with pytest.raises(InputFileError, match="cannot be read"):
        read(tmp_path, f"(fp_line (start 0 x) (end 1 1) {FAB}")
    with pytest.raises(InputFileError, match="cannot be read"):
        read(tmp_path, f"(fp_arc (start 0 0) (end 1 1) {FAB}")
    with pytest.raises(OutlineError):
        read(tmp_path, f"(fp_arc (start 0 0) (mid 0 0) (end 0 0) {FAB}")
