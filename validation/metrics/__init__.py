"""How far apart two solutions are: each metric with its unit, its scale and its meaning."""

from palpate.validation.metrics.catalogue import CATALOGUE, MOVING_TRUTH_METRICS, measure
from palpate.validation.metrics.fields import det_f, inverted_cells, most_inverted, smallest_det_f
from palpate.validation.metrics.finite import is_still
from palpate.validation.metrics.metric import Metric
from palpate.validation.metrics.numbers import STRESSES, Number
from palpate.validation.metrics.own_mesh import OWN_MESH_REMEDY
from palpate.validation.metrics.pairs import (
    COMPARISONS,
    Difference,
    displacement_l2,
    displacement_max,
    make_state,
    max_displacement,
    surface_area,
    volume,
)
from palpate.validation.metrics.stress import Part, stress_integrals, tells_stress

__all__ = [
    "CATALOGUE",
    "COMPARISONS",
    "MOVING_TRUTH_METRICS",
    "OWN_MESH_REMEDY",
    "STRESSES",
    "Difference",
    "Metric",
    "Number",
    "Part",
    "det_f",
    "displacement_l2",
    "displacement_max",
    "inverted_cells",
    "is_still",
    "make_state",
    "max_displacement",
    "measure",
    "most_inverted",
    "smallest_det_f",
    "stress_integrals",
    "surface_area",
    "tells_stress",
    "volume",
]
