"""Templates of the reports and of the studies' pages: nothing in a text can act."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from palpate.validation.quoting import for_html

_PACKAGE = "palpate.validation.report"


def page_environment() -> Environment:
    """Templates that escape every text and show what is hidden in it."""
    return Environment(
        loader=PackageLoader(_PACKAGE),
        autoescape=True,
        finalize=for_html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def template_text(name: str) -> str:
    """A file of the templates' folder as it is."""
    return (resources.files(_PACKAGE) / "templates" / name).read_text(encoding="utf-8")


def script_of(*names: str) -> tuple[Markup, Markup]:
    """Scripts one after another as one, and the words by which a page's policy admits it."""
    script = "\n".join(template_text(name) for name in names)
    return Markup(script), policy_hash(script)


def policy_hash(text: str) -> Markup:
    """Of a script or a style, for a Content-Security-Policy."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
    return Markup("sha256-{}").format(digest)
