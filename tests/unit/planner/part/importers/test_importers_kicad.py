"""Component bodies from KiCad footprints: all kinds of shapes, and the other content of such files."""

import math
import sys

import pytest
from drawings import area, read, refused

from planner.part.importers import kicad
from planner.part.importers.pieces import Options, time_limit
from runtime.shell.errors import InputError

FAB = '(layer "F.Fab") (width 0.1))'


def footprint(folder, *shapes, head='(footprint "part" (layer "F.Cu")'):
    path = folder / "part.kicad_mod"
    path.write_text("\n".join([head, *shapes, ")\n"]))
    return path


D_AREA = 400 + 50 * math.pi  # a square of 20 mm and half a disc on one side
ARC = "(arc (start 20 0) (mid 30 10) (end 20 20))"
STROKE = "(stroke (width 0.1) (type solid)) (fill none)"
RECT = "(fp_rect (start -10 -5) (end 10 5)"
DISCS = "(pts (arc (start -10 0) (mid 0 -10) (end 10 0)) (arc (start 10 0) (mid 0 10) (end -10 0)))"
CURVE = f"(fp_curve (pts (xy 0 0) (xy 0 20) (xy 30 20) (xy 30 0)) {FAB}"
OLD = "(fp_arc (start 0 0) (end 0 {}) (angle 180) (layer F.Fab) (width 0.1))"
BODIES = {  # shapes as versions of KiCad write them, and the area of the body [mm2]
    "arc in a polygon": (
        f"(fp_poly (pts (xy 0 0) (xy 20 0) {ARC} (xy 0 20)) {STROKE} {FAB}",
        D_AREA,
    ),
    "polygon of arcs": (f"(fp_poly {DISCS} {FAB}", 100 * math.pi),
    # 3/5 of 30 x 20, from the integral of its Bernstein polynomials
    "curve": (f"{CURVE} (fp_line (start 0 0) (end 30 0) {FAB}", 360.0),
    "rectangle": (f'(fp_rect (start 10 5) (end -10 -5) (fill no) (uuid "a-1") {FAB}', 200),
    "rounded rectangle": (f'{RECT} (radius 2) (layer "F.Fab"))', 200 - 16 + 4 * math.pi),
    "round ends": (f"(fp_rect (start 0 0) (end 30 10) (radius 5) {FAB}", 200 + 25 * math.pi),
    "arc that ends where it begins": (
        f"(fp_arc (start 10 0) (mid -10 0) (end 10 0) {FAB}",
        100 * math.pi,
    ),
    "name without quotes": (f"{RECT} (layer F.Fab) (width 0.1) (tstamp 5E9A))", 200),
    "all sides": ('(fp_circle (center 0 0) (end 6 8) (layers "*.Fab" "F.SilkS"))', 100 * math.pi),
    "old arcs": (OLD.format(-10) + OLD.format("10.0"), 100 * math.pi),
}
OTHERS = (  # other content of a footprint
    '(descr "a (body) on \\"F.Fab\\"; [odd") (tags "a b")',
    "(attr smd)",
    "(model ${K}/x.wrl (at (xyz 0 0 0)))",
    '(property "Reference" "REF**" (at 0 0 0) (layer "F.Fab") (effects (font (size 1 1))))',
    '(fp_text user %R (at 0 0) (layer "F.Fab") (effects (font (size 1 1) (thickness 0.1))))',
    '(fp_text_box "x" (start 0 0) (end 50 50) (layer "F.Fab"))',
    '(fp_rect (start -90 -90) (end 90 90) (layer "F.CrtYd") (width 0.05))',
    '(pad "1" smd roundrect (at 0 0) (size 60 60) (layers "F.Cu" "F.Paste") (roundrect_rratio 0.25))',
)


@pytest.mark.parametrize(
    "head", ['(footprint "x:y" (version 20240108)', "(module R_0603 (layer F.Cu) (tedit 5A)"]
)
@pytest.mark.parametrize(("shapes", "mm2"), BODIES.values(), ids=BODIES)
def test_read_body_of_any_version_keeps_its_area(tmp_path, shapes, mm2, head):
    result = read(footprint(tmp_path, *OTHERS, shapes, head=head))
    assert area(result) == pytest.approx(mm2, rel=3e-3)
    assert result.notes == ()


def test_read_unknown_shape_on_the_body_layer_is_named(tmp_path):
    odd = '(fp_ellipse (center 0 0) (layer "F.Fab"))'
    result = read(footprint(tmp_path, odd, odd, f"(fp_rect (start -10 -5) (end 10 5) {FAB}"))
    (note,) = result.notes
    assert "ignored on F.Fab: 2 fp_ellipse" in note
    refused(footprint(tmp_path, odd), r"no shape on F\.Fab.*not known: 1 fp_ellipse")


def test_read_footprint_without_a_body_is_refused_with_its_layers(tmp_path):
    silk = footprint(tmp_path, '(fp_rect (start 0 0) (end 9 5) (layer "F.SilkS") (width 0.1))')
    refused(silk, r"no shape on F\.Fab.*draws on F\.SilkS.*draw the body's outline")
    refused(footprint(tmp_path), "draws nothing at all")


DAMAGED = {
    "a number of two points": f"(fp_line (start 1.1.1 0) (end 1 1) {FAB}",
    "no end": f"(fp_circle (center 1 1) {FAB}",
    "curve of three points": f"(fp_curve (pts (xy 0 0) (xy 9 0) (xy 9 3)) {FAB}",
    "not finite": f"(fp_rect (start 0 0) (end nan 3) {FAB}",
    "a name on two lines": '(fp_line (start 0 "a\nb") (end 1 1) (layer "F.Fab"))',
    "open bracket": "((",
    "open text": '(descr "abc',
    "deep": "(" * 3000 + ")" * 3000,
}


@pytest.mark.parametrize("shape", DAMAGED.values(), ids=DAMAGED)
def test_read_damaged_footprint_is_refused_in_one_line(tmp_path, shape):
    refused(footprint(tmp_path, shape, f"(fp_rect (start -10 -5) (end 10 5) {FAB}"))


def test_read_footprint_beyond_the_time_limit_is_refused_as_slow(tmp_path, monkeypatch):
    # Python drops an alarm that comes in a callback of the garbage collector; the next alarm raises. It may
    # come while pytest's hook formats the dropped one.
    monkeypatch.setattr(sys, "unraisablehook", lambda dropped: None)
    path = footprint(tmp_path, "(at 0 0 0)" * 400_000)
    with pytest.raises(InputError, match="longer than"), time_limit(0.2):
        kicad.read(path.read_bytes(), Options())
