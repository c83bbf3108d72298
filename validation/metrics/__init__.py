"""How far apart two solutions are: each metric with its unit, its scale and its meaning."""

from palpate.validation.metrics.catalogue import (
    CATALOGUE,
    MOVING_TRUTH_METRICS,
    WHOLE_BODY_METRICS,
    Metric,
    measure,
)
from palpate.validation.metrics.difference import Difference, is_still, make_state
from palpate.validation.metrics.numbers import STRESSES, Number
from palpate.validation.metrics.own_mesh import OWN_MESH_REMEDY
from palpate.validation.metrics.stress import Part, is_stress_known, stress_integrals
from palpate.validation.metrics.validity import (
    det_f,
    inverted_cells,
    most_inverted,
    smallest_det_f,
)

__all__ = [
    "CATALOGUE",
    "MOVING_TRUTH_METRICS",
    "OWN_MESH_REMEDY",
    "STRESSES",
    "WHOLE_BODY_METRICS",
    "Difference",
    "Metric",
    "Number",
    "Part",
    "det_f",
    "inverted_cells",
    "is_still",
    "is_stress_known",
    "make_state",
    "measure",
    "most_inverted",
    "smallest_det_f",
    "stress_integrals",
]
