"""Jinja environments of the package's templates: pages, programs and job files."""

from jinja2 import Environment, PackageLoader, StrictUndefined


def environment(package: str, *, markup: bool) -> Environment:
    """Returns the environment that loads the templates of a package.

    Args:
        package: name of the package.
        markup: whether the templates are HTML or SVG, so that values are escaped. Other templates keep their
            last newline.
    """
    return Environment(
        loader=PackageLoader(package),
        autoescape=markup,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not markup,
    )
