"""How far apart two solutions are: each metric with its unit, its scale and its meaning."""

from palpate.validation.metrics.catalogue import CATALOGUE, MOVING_TRUTH_METRICS, Metric, measure
from palpate.validation.metrics.fields import det_f, end_shape, inverted_cells
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
    "CATALOGUE",
    "COMPARISONS",
    "MOVING_TRUTH_METRICS",
    "SMALLEST_CHANGE",
    "Difference",
    "Metric",
    "det_f",
    "displacement_l2",
    "displacement_max",
    "end_shape",
    "inverted_cells",
    "l2_norm",
    "make_state",
    "max_displacement",
    "measure",
    "surface_area",
    "volume",
]
