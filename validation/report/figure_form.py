"""What figures for a paper are written as; a file of its own, since the command line reads it."""

from __future__ import annotations

from enum import StrEnum


class FigureForm(StrEnum):
    """Lines and text, not pixels."""

    PDF = "pdf"
    SVG = "svg"
