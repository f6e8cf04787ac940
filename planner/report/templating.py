"""The templates of pages and pictures: jinja2, escaping what it fills in."""

from __future__ import annotations

from functools import cache

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template


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
    return environment.get_template(name)
