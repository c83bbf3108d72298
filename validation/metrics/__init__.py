"""How far apart two solutions are: each metric with its unit, its scale and its meaning."""

from palpate.validation.metrics.pairs import (
    COMPARISONS,
    SMALLEST_CHANGE,
    Difference,
    displacement_l2,
    displacement_max,
    l2_norm,
    make_state,
    max_displacement,
    surface_area,
    volume,
)

__all__ = [
    "COMPARISONS",
    "SMALLEST_CHANGE",
    "Difference",
    "displacement_l2",
    "displacement_max",
    "l2_norm",
    "make_state",
    "max_displacement",
    "surface_area",
    "volume",
]
