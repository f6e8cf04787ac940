"""Unusual, damaged and hostile SVG files: the right outline, or an error that states the remedy."""

import numpy as np
import pytest
from drawings import MM, area, notes, read, refused, svg

from planner.part import outline as outlines
from runtime.shell.errors import UsageError

RECT = '<rect x="5" y="5" width="30" height="21"/>'


def is_rectangle(result, scale=1.0):
    assert np.allclose(sorted(result.size_mm), (21 * scale, 30 * scale), rtol=1e-5)
    assert len(result.outline_mm) == 4
    assert result.symmetry == 2


SIZES = {
    "millimetres": (MM, 1.0),
    "inches": ('width="4in" height="4in" viewBox="0 0 4 4"', 25.4),
    "half scale": ('width="50mm" height="50mm" viewBox="0 0 100 100"', 0.5),
    "width alone": ('width="100mm" viewBox="0 0 100 100"', 1.0),
}


@pytest.mark.parametrize(("size", "scale"), SIZES.values(), ids=SIZES)
def test_read_physical_size_scales_the_outline(tmp_path, size, scale):
    is_rectangle(read(svg(tmp_path, RECT, size)), scale)


UNITLESS = {
    "pixels": 'width="100" height="100" viewBox="0 0 100 100"',
    "nothing": "",
    "view box alone": 'viewBox="0 0 100 100"',
    "bad view box": 'width="100mm" height="100mm" viewBox="a b c d"',
}


@pytest.mark.parametrize("size", UNITLESS.values(), ids=UNITLESS)
def test_read_drawing_without_a_scale_asks_for_units(tmp_path, size):
    path = svg(tmp_path, RECT, size)
    refused(path, "--units mm, cm, in or m", UsageError)
    is_rectangle(read(path, units="mm"))


def test_read_stretched_drawing_is_refused(tmp_path):
    size = 'width="100mm" height="50mm" viewBox="0 0 100 100"'
    refused(svg(tmp_path, RECT, size), "two different scales")


def test_read_outline_is_not_mirrored(tmp_path):
    # The right angle of the drawing is at the upper left.
    result = read(svg(tmp_path, '<path d="M0 0 L30 0 L0 21 Z"/>'))
    top = result.outline_mm[:, 1].max()
    assert np.count_nonzero(np.isclose(result.outline_mm[:, 1], top)) == 2
    left = result.outline_mm[:, 0].min()
    assert np.count_nonzero(np.isclose(result.outline_mm[:, 0], left)) == 2


@pytest.mark.parametrize(
    "body",
    [
        '<g transform="translate(10 10) rotate(30)"><rect width="30" height="21" transform="scale(1)"/></g>',
        '<defs><rect id="r" width="30" height="21"/></defs><use href="#r" x="5" y="5"/>',
        '<defs><rect id="r" width="30" height="21"/></defs><use xlink:href="#r" transform="rotate(45)"/>',
        '<polygon points="0,0 30,0 30,21 0,21"/>',
        '<path d="m 1 1 h 30 v 21 h -30 z"/>',
        '<line x1="0" y1="0" x2="30" y2="0"/><polyline points="30,0 30,21 0,21 0,0"/>',
    ],
)
def test_read_shapes_transforms_and_copies_return_the_rectangle(tmp_path, body):
    result = read(svg(tmp_path, body))
    assert area(result) == pytest.approx(630, rel=1e-5)
    assert outlines.min_width(result.outline_mm) == pytest.approx(21, rel=1e-5)


PASSWD = '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
TENFOLD = (f'<g id="u{k}">' + f'<use href="#u{k - 1}"/>' * 10 + "</g>" for k in range(1, 10))
COPIES = '<rect id="u0" width="1" height="1"/>' + "".join(TENFOLD)
REFUSED = {
    "billion laughs": (
        '<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">]>',
        "<text>&c;</text>",
        "holds XML entities",
    ),
    "a file of the machine": (PASSWD, "<text>&x;</text>", "holds XML entities"),
    "copies of copies": ("", f'<defs>{COPIES}</defs><use href="#u9"/>', "more than 20000 shapes"),
    "a copy of itself": ("", '<g id="a"><use href="#a"/></g>', "in itself"),
    "nested too deeply": ("", "<g>" * 500 + "</g>" * 500, "nested too deeply"),
    "no shapes": ("", "<text>part</text>", "no closed contour"),
    "an open path": ("", '<path d="M0 0 h30 v21 h-30"/>', r"open at .* 21 mm away"),
    "a huge curve": ("", '<path d="M0 0 C 1e30 0 1e30 1e30 0 1e30 Z"/>', "absurdly large"),
    "a tiny part": ("", '<rect width="0.001" height="0.001"/>', "no closed contour|is the unit"),
}


@pytest.mark.parametrize(("before", "body", "sentence"), REFUSED.values(), ids=REFUSED)
def test_read_hostile_or_wrong_file_is_refused_with_the_reason(tmp_path, before, body, sentence):
    refused(svg(tmp_path, body, before=before), sentence)


NO_SVG = [b"", b"<svg", b"<html></html>", b"\xff\xfe\x00", b"{}", b"<svg xmlns='x'></g>"]


@pytest.mark.parametrize("data", NO_SVG)
def test_read_bytes_that_are_no_svg_are_refused(tmp_path, data):
    path = tmp_path / "bad.svg"
    path.write_bytes(data)
    refused(path)


def test_read_stated_units_overrule_the_file_with_a_note(tmp_path):
    result = read(svg(tmp_path, RECT, SIZES["half scale"][0]), units="mm")
    is_rectangle(result)
    assert "overruled" in notes(result)
