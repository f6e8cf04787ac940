"""Draws formulas as SVG within the page, so that the reader needs no script, font or network.

MathML needs a mathematical font on the reader's device. Few phones have one, and without it letters are
misplaced. ziamath sets formulas with STIX Two when the site is built.
"""

from html import escape

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

EM = 16.0  # font size in which formulas are set; on the page they scale with the text around them
LARGER = 1.1  # enlargement of a formula relative to its text; STIX is a small face


def drawn(latex: str, inline: bool) -> str:
    """Returns an <svg> element with the formula, its base line aligned with the base line of the text."""
    formula = ziamath.Latex(latex, size=EM, color="currentColor", inline=inline)
    svg = formula.svgxml()
    width, height = (float(svg.get(side, "0")) for side in ("width", "height"))
    top = float(svg.get("viewBox", "0 0 0 0").split()[1])
    below = height + top  # of the base line
    for name, value in (("width", width), ("height", height)):
        svg.set(name, f"{LARGER * value / EM:.3f}em")
    svg.set("style", f"vertical-align: {-LARGER * below / EM:.3f}em")
    text = ziamath.zmath.ET.tostring(svg, encoding="unicode")
    return text.replace("<svg ", f'<svg role="img" aria-label="{escape(latex)}" ', 1)


def inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(drawn(node.astext(), inline=True))
    raise nodes.SkipNode


def block(self: HTML5Translator, node: nodes.math_block) -> None:
    latex = " ".join(node.astext().split())
    self.body.append(f'<div class="formula">{drawn(latex, inline=False)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    ziamath.config.svg2 = False  # no <symbol>s, whose ids several formulas of a page would share
    ziamath.config.precision = 2
    app.add_html_math_renderer("drawn", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
