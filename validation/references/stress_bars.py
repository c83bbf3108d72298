"""Error bars of the truth's stress in a part of the body, and of its force through a surface.

They depend on the part that a check names, so they are worked out when it is judged, from the
quadratic solutions on the case's mesh and on the truth's: Roache's rule for two grids (ASME J.
Fluids Eng. 116, 1994), with first order assumed,

    bar = 3 |coarse - truth| / (r - 1),    r = 2 or 4 the cells of one over those of the other.

Stress of quadratic cells converges with second order where the solution is smooth. Near a clamped
or reentrant edge it may be a half, and there the rule still holds: 3 / (r - 1) is above
1 / (r^p - 1) from p = 0.42 on for r = 2, and from p = 0.5 on for r = 4. Forces as sums of nodal
ones converge with twice the order. Where the truth is on the case's own mesh, solved on the spot,
the bar is its difference from linear tetrahedra there, an upper estimate.
"""

from __future__ import annotations

import math

from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics import Part, measure, tells_stress
from palpate.validation.references.sequences import NOISE, SAFETY_FACTOR
from palpate.validation.references.sets import QUADRATIC, SAME_MESH, ReferenceSet

# Relative: stresses of a stored truth are kept in single precision.
_KEPT_TO = 2.0**-23


def bar_of_part(
    problem: Problem, references: ReferenceSet, strain: Strain, metric: str, part: Part
) -> float:
    """What the truth of a metric of a part may be off by, relative to the metric's scale [-].

    Infinite where there is no second solution to tell it from.
    """
    truth = references.truth(strain)
    if truth is None or not tells_stress(truth):
        return math.inf
    least = NOISE + _KEPT_TO
    coarse = references.states.get((QUADRATIC, strain))
    if truth is coarse:
        known = {**references.aside, **references.states}
        linear = known.get((SAME_MESH, strain))
        if linear is None:
            return math.inf
        return measure(metric, problem, linear, truth, part).value + least
    if coarse is None or coarse.integrals is None or truth.integrals is None:
        return math.inf
    ratio = 2.0 ** (truth.integrals.halvings - coarse.integrals.halvings)
    if not ratio > 1.0:
        return math.inf
    apart = measure(metric, problem, coarse, truth, part).value
    return SAFETY_FACTOR * apart / (ratio - 1.0) + least
