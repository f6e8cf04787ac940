"""The templates of pages and pictures: jinja2, escaping what it fills in."""

from functools import cache

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from planner.arrays import Array


@cache
def template(name: str) -> Template:
    """A file of `planner/report/templates`."""
    environment = Environment(
        loader=PackageLoader("planner.report", "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["mm"] = lambda um: f"{um / 1e3:.2f}"
    environment.filters["degrees"] = lambda urad: f"{np.degrees(urad / 1e6):.1f}"
    environment.filters["percent"] = lambda share: f"{100 * share:.2f} %"
    environment.filters["transform"] = transform
    environment.filters["points"] = points
    environment.filters["part"] = part
    return environment.get_template(name)


def transform(pose: Array) -> str:
    """A pose (3,) [mm, mm, rad] as an SVG transform; the picture's y axis points up."""
    return f"translate({pose[0]:.2f} {pose[1]:.2f})rotate({np.degrees(pose[2]):.1f})"


def part(state: Array) -> int:
    """Which hypothesis a state (3 or 4,) is of, as `planner.mechanics.traits.with_hypothesis` writes it."""
    return int(state[3]) if len(state) > 3 else 0


def points(shape: Array) -> str:
    """Vertices (n, 2) as SVG points."""
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in shape)
