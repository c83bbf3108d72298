"""How Sphinx makes the documentation; `make docs` calls it by way of .ci/docs.sh."""

import re
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

sys.path.insert(0, str(Path(__file__).parent))

project = "palpate"
author = "the palpate developers"
copyright = f"2026, {author}"
release = version = metadata.version("palpate")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["making"]
html_theme = "furo"
html_title = f"palpate {release}"
html_static_path = ["../static"]
html_css_files = ["palpate.css"]
html_math_renderer = "mathml"

# The demos are the examples that the tests run too: Python files in cells, executed here.
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_google_docstring = True
napoleon_use_rtype = False


def _plain_text(*event: Any) -> None:
    """Docstrings are plain text: what reStructuredText would take for marks is escaped."""
    lines = event[-1]
    lines[:] = [re.sub(r"^( *)([+|])", r"\1\\\2", line.replace("|", "\\|")) for line in lines]


def _levels(*event: Any) -> None:
    """The theme's headings in the list of pages have no level, which screen readers want.

    And what scrolls in itself (tables, code) is reached by the Tab key, to be scrolled by arrows.
    """
    context = event[3]
    body = context.get("body", "").replace("<pre>", '<pre tabindex="0">')
    context["body"] = body.replace(
        '<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'
    )
    tree = context.get("furo_navigation_tree", "")
    named = tree.replace('role="heading"', 'role="heading" aria-level="2"')
    context["furo_navigation_tree"] = named


# Formulas as MathML, which browsers set by themselves: no script, nothing fetched.


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    formula = convert(node.astext(), display="block")
    translator.body.append(f'<div class="math-block" tabindex="0">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("autodoc-process-docstring", _plain_text)
    app.connect("html-page-context", _levels, priority=900)  # after the theme
