"""Reports as HTML: templates of this folder, every text in them escaped."""

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template


@cache
def template(name: str) -> Template:
    """A template of `dualwinch/reports/templates` by its file name; a name that it is not given is an error."""
    environment = Environment(
        loader=PackageLoader("dualwinch.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
