"""Reports of judged cases and pages of studies: HTML, pictures, plots, tables."""

from enum import StrEnum


class FigureForm(StrEnum):
    """What figures for a paper are written as: lines and text, not pixels."""

    PDF = "pdf"
    SVG = "svg"
