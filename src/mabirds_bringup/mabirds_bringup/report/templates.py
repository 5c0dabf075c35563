"""Reports and pages from the templates of the package."""

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def render(name: str, **content: Any) -> str:
    """The text of a template, such as ``bench.md.jinja``; in HTML, content is escaped."""
    return _environment().get_template(name).render(content)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape  # not before a report is made

    return Environment(
        loader=PackageLoader("mabirds_bringup"),
        autoescape=select_autoescape(enabled_extensions=("html.jinja",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
