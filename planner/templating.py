"""Jinja environments of the package's templates: pages, programs and job files."""

from jinja2 import Environment, PackageLoader, StrictUndefined


def environment(package: str, *, markup: bool) -> Environment:
    """The templates of a package: `markup` escapes values, other text keeps its last newline."""
    return Environment(
        loader=PackageLoader(package),
        autoescape=markup,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not markup,
    )
