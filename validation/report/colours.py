"""The colours of lines, in every plot the same ones."""

from __future__ import annotations

BLUE, RED, OCHRE, GREEN, PURPLE, GREY, PINK, BROWN = COLOURS = (
    "#2f6f8f", "#b5332e", "#c98a12", "#2f8f4e", "#6b4c9a", "#4d4d4d", "#d0679b", "#8a5a2b",
)  # fmt: skip
