"""What is visible in an SVG drawing, in which size: styles, definitions, view boxes, units, bad numbers."""

import math
import re

import pytest
from drawings import MM, area, read, refused, svg

from runtime.shell.errors import ExpectedError

L_AREA = 40 * 25 - 25 * 15
L_PATH = "M5 5 H45 V15 H20 V30 H5 Z"
# A rectangle about the part, which is the outline unless it is left out.
JIG = '<rect width="90" height="70"/>'
USE = '<use href="#s" width="40" height="20"/>'
PLATE = '<rect width="400" height="200"/>'


def jig(attributes):
    return JIG.replace("/>", f" {attributes}/>")


def sheet(css, attributes='class="jig" id="jig"'):
    return f"<style>{css}</style>{jig(attributes)}"


UNDRAWN = ("mask", "symbol", "marker", "clipPath", "pattern", "defs", "metadata", "filter")
UNSEEN = {
    **{f"in a {kind}": f"<{kind} id='d' width='60' height='60'>{JIG}</{kind}>" for kind in UNDRAWN},
    "of another vocabulary": '<i:rect xmlns:i="urn:other" width="90" height="70"/>'
    f'<i:g xmlns:i="urn:other">{JIG}</i:g>',
    "visibility": jig('visibility="hidden"'),
    "visibility inherited": f'<g visibility="hidden"><g>{JIG}</g></g>',
    "display": jig('display="none"'),
    "opacity": jig('opacity="0"'),
    "opacity of a group": '<g opacity="0.0">' + jig('opacity="1"') + "</g>",
    "no fill": jig('fill="none"'),
    "stroke of no width": jig('fill="none" stroke="red" stroke-width="0"'),
    "clear fill": jig('fill="transparent"'),
    "clear stroke": jig('style="fill:#fff0; stroke:rgba(0,0,0,0)"'),
    "current colour": '<g color="transparent">' + jig('fill="currentColor"') + "</g>",
    "class": sheet(".jig { display: none }"),
    "descendant": f'<style>g.off > rect {{ opacity: 0 }}</style><g class="a off">{JIG}</g>',
    "important": sheet(".jig { display: none !important }", 'class="jig" style="display:inline"'),
    "specific": sheet("#jig { fill: none } rect.jig { fill: red }"),
    "rule for screens": sheet("@media print {.jig {fill: red}} @media screen {.jig {fill: none}}"),
    "sheet for screens": sheet(".jig {fill: none}").replace(">", ' media="print, Screen">', 1),
    "words in capitals": sheet(".jig { display: NONE }"),
    "copy of a hidden one": f'<defs><g id="j" display="none">{JIG}</g></defs><use href="#j"/>',
    "beside its viewport": '<svg width="60" height="60"><rect x="61" width="90" height="70"/></svg>',
}


@pytest.mark.parametrize("body", UNSEEN.values(), ids=UNSEEN)
def test_read_invisible_shape_is_left_out(tmp_path, body):
    result = read(svg(tmp_path, f'{body}<path d="{L_PATH}"/>'))
    assert area(result) == pytest.approx(L_AREA)


SEEN = {
    "shown in a hidden group": '<g visibility="hidden"><path visibility="visible" d="{}"/></g>',
    "stroked alone": '<path fill="none" stroke="#000" d="{}"/>',
    "pattern for a paint": '<path fill="url(#p) none" d="{}"/>',
    "style beats a sheet": '<style>path{{display:none}}</style><path style="display:inline" d="{}"/>',
    "a sheet beats an attribute": '<style>path{{fill:red}}</style><path fill="none" d="{}"/>',
    "a rule that CSS drops": '<style>path:foo{{display:none}} @import "x"; :{{}}</style><path d="{}"/>',
    "a rule for paper": '<style>@media print {{path {{display: none}}}}</style><path d="{}"/>',
    "a sheet of another language": '<style type="text/x">path {{display: none}}</style><path d="{}"/>',
    "first child of a switch": '<switch><foreignObject requiredExtensions="x"/>'
    f'<g><path d="{{}}"/></g>{JIG}</switch>',
    "a copy of a definition": '<clipPath><path id="a" d="{}"/></clipPath><use xlink:href="#a"/>',
}


@pytest.mark.parametrize("body", SEEN.values(), ids=SEEN)
def test_read_visible_shape_is_the_outline(tmp_path, body):
    assert area(read(svg(tmp_path, body.format(L_PATH)))) == pytest.approx(L_AREA)


NOTED = {
    "unseen": (jig('fill="none"'), "not seen .*: 1 of its elements"),
    "clipped": ('<rect clip-path="url(#c)" width="1" height="1"/>', "clip paths.*: 1 of its elem"),
    "cropped": ('<svg width="2" height="2"><rect width="9" height="1"/></svg>', "viewports.*: 1"),
    "rules that depend": (
        "<style>@media (width > 9px) {g {fill: red}} @layer a {} svg {g {fill: red}}</style>",
        r"not read.*: @media \(width > 9px\), @layer a, rules in that of svg",
    ),
    "another sheet": ('<style>@import "x.css";</style>', 'not read.*: @import "x.css"'),
    "wide stroke": (
        '<g transform="scale(2)"><path stroke-width="3" stroke="red" d="M9 4h1"/></g>',
        "strokes up to 6 mm wide",
    ),
    "text and pictures": ("<text>a</text><text>b</text><image/>", "ignored: 1 image, 2 text"),
    "a copy of nothing": (
        '<use href="#no"/><use href="o.svg#a"/>',
        "not in the file: #no, o.svg#a",
    ),
}


@pytest.mark.parametrize(("body", "sentence"), NOTED.values(), ids=NOTED)
def test_read_left_out_or_uncertain_content_is_noted(tmp_path, body, sentence):
    result = read(svg(tmp_path, f'{body}<path d="{L_PATH}"/>'), contour=1)
    assert area(result) == pytest.approx(L_AREA)
    assert any(re.search(sentence, note) for note in result.notes)


def symbol(attributes, content=PLATE, box="0 0 400 200"):
    return f'<symbol id="s" viewBox="{box}" {attributes}>{content}</symbol>'


VIEWED = {  # body, and its area by hand [mm2]
    "use states the size": (symbol("") + USE, 800),
    "use overrules the symbol": (symbol('width="9" height="9"') + USE, 800),
    "meets the lesser side": (symbol("") + '<use href="#s" width="40" height="60"/>', 800),
    "stretched": (symbol('preserveAspectRatio="none"') + USE.replace("20", "10"), 400),
    "two levels": (
        symbol("", '<use href="#t" width="200" height="100"/>')
        + '<symbol id="t" viewBox="0 0 800 400"><rect width="400" height="400"/></symbol>'
        + USE,
        10 * 10,
    ),
    "transformed": (symbol("") + f'<g transform="rotate(30) scale(.5)">{USE}</g>', 200),
    "copied nested drawing": (
        f'<defs><svg id="s" viewBox="0 0 400 200">{PLATE}</svg></defs>{USE}',
        800,
    ),
    "percent of a nested drawing": (
        '<svg width="40" height="20" viewBox="0 0 400 200"><rect width="50%" height="100%"/></svg>',
        400,
    ),
    "skewed curves": ('<circle r="10" transform="skewX(40) scale(2 1)"/>', 200 * math.pi),
}


@pytest.mark.parametrize(("body", "mm2"), VIEWED.values(), ids=VIEWED)
def test_read_view_boxes_and_transforms_scale_their_content(tmp_path, body, mm2):
    assert area(read(svg(tmp_path, body))) == pytest.approx(mm2, rel=2e-3)


UPRIGHT = '<line x1="4cm" x2="40mm" y2="20mm"/>'
UNITS = {
    "mm": ('<rect width="40mm" height="20mm"/>', 800),
    "points and picas": ('<rect width="72pt" height="6pc"/>', 25.4**2),
    "transform": ('<rect width="40mm" height="20mm" transform="scale(.5)"/>', 200),
    "ellipse": ('<ellipse rx="20mm" ry="1cm"/>', 200 * math.pi),
    "lines": (f'<g stroke="red"><line x2="4cm"/>{UPRIGHT}<line x1="40mm" y1="20mm"/></g>', 400),
}


@pytest.mark.parametrize("size", ['width="100mm" height="80mm"', "", MM, 'viewBox="0 0 400 320"'])
@pytest.mark.parametrize(("body", "mm2"), UNITS.values(), ids=UNITS)
def test_read_length_with_a_unit_does_not_depend_on_the_user_unit(tmp_path, body, mm2, size):
    path = svg(tmp_path, body, size)
    for units in ("mm", "in"):
        assert area(read(path, units=units, tolerance_mm=0.005)) == pytest.approx(mm2, rel=2e-3)


MALFORMED = {
    "length": '<rect width="1.1.1mm" height="5"/>',
    "decimal comma": '<rect width="4,5" height="5"/>',
    "words": '<ellipse rx="wide" ry="3"/>',
    "negative": '<rect width="-4" height="5"/>',
    "points": '<polygon points="0,0 30,0 30"/>',
    "path": '<path d="M0 0 L30 0 30 2x Z"/>',
    "path number": '<path d="M0 0 L1.1.1 5 Z"/>',
    "arc flag": '<path d="M0 0 A5 5 0 2 1 10 0 Z"/>',
    "transform": '<rect width="4" height="5" transform="scale(1.1.1)"/>',
    "unknown transform": '<g transform="turn(4)"><rect width="4" height="5"/></g>',
    "opacity": '<rect width="4" height="5" opacity="0.x"/>',
    "variable": '<rect width="4" height="5" style="display:var(--d)"/>',
    "scaled by a style": '<rect width="4" height="5" style="scale:2"/>',
    "inline style": '<rect height="5" style="width:1.1.1mm"/>',
    "copy": '<rect id="r" width="4" height="5"/><use href="#r" x="1..2"/>',
    "view box": '<svg viewBox="0 0 1.1.1 1 2"><rect width="4" height="5"/></svg>',
    "symbol": '<symbol id="s" viewBox="a"/><use href="#s"/>',
}


@pytest.mark.parametrize("body", MALFORMED.values(), ids=MALFORMED)
def test_read_malformed_number_is_refused_with_its_element(tmp_path, body):
    refused(svg(tmp_path, body), r"part\.svg: <\w+>.*correct it in the drawing")


@pytest.mark.parametrize("size", ['width="1.1.1mm" viewBox="0 0 100 80"', 'width="100x"'])
def test_read_malformed_size_of_the_drawing_is_refused(tmp_path, size):
    path = svg(tmp_path, f'<path d="{L_PATH}"/>', size)
    for units in (None, "mm"):
        refused(path, r'<svg>: width="1.*" is no length', ExpectedError, units=units)


def test_read_percentage_of_an_unknown_size_is_refused(tmp_path):
    path = svg(tmp_path, '<rect width="50%" height="20"/>', "")
    refused(path, "size that the file does not state", units="mm")
