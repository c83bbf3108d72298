"""Templates of the reports and of the studies' pages: nothing in a text can act."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from palpate.validation.quoting import for_html


def page_environment() -> Environment:
    """Templates that escape every text and show what is hidden in it."""
    return Environment(
        loader=PackageLoader("palpate.validation.report"),
        autoescape=True,
        finalize=for_html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
