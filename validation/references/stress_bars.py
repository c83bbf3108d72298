"""Error bars of the truth's stress in a part of the body, and of its force through a surface.

They depend on the part that a check names, so they are worked out when it is judged, from the
quadratic solutions on the case's mesh and on the truth's: Roache's rule for two grids (ASME J.
Fluids Eng. 116, 1994), with first order assumed,

    bar = 3 |coarse - truth| / (r - 1),    r = 2 or 4 the cells of one over those of the other.

Stress of quadratic cells converges with second order where the solution is smooth. Near a clamped
or reentrant edge it may be a half, and there the rule still holds: 3 / (r - 1) is above
1 / (r^p - 1) from p = 0.42 on for r = 2, and from p = 0.5 on for r = 4. Forces as sums of nodal
ones converge with twice the order. Where the truth is on the case's own mesh, solved on the spot,
the bar is its difference from linear tetrahedra there, infinite where that is above a half: see
`live`. Under forces on points and Green strain nothing has a limit, and every bar is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics import Number, Part, measure
from palpate.validation.references.limits import without_limits
from palpate.validation.references.live import saturated
from palpate.validation.references.sequences import NOISE, SAFETY_FACTOR
from palpate.validation.references.sets import QUADRATIC, SAME_MESH, ReferenceSet
from palpate.validation.states import State

# Relative: stresses of a stored truth are kept in single precision.
_KEPT_TO = 2.0**-23


def bar_of_part(
    problem: Problem, references: ReferenceSet, strain: Strain, metric: str, part: Part
) -> float:
    """What the truth of a metric of a part may be off by, relative to the metric's scale [-].

    Infinite where there is no second solution to tell it from.
    """
    truth = references.stress_truth(strain)
    if truth is None:
        return math.inf
    bar = _bar(references, strain, lambda state: measure(metric, problem, state, truth, part).value)
    bar += NOISE + _KEPT_TO
    return without_limits(problem, strain, {metric: bar}, truth)[metric]


def bar_of_number(
    problem: Problem,
    references: ReferenceSet,
    strain: Strain,
    metric: str,
    read: Callable[[State], Number | None],
) -> float:
    """What a number that the truth's stresses or energy tell may be off by, in its unit.

    By the same rule, of the signed number itself. Infinite where a solution does not tell it.
    """
    truth = references.stress_truth(strain)
    best = None if truth is None else read(truth)
    if truth is None or best is None:
        return math.inf
    size = abs(best.value)

    def apart(state: State) -> float:
        found = read(state)
        return math.inf if found is None else abs(found.value - best.value)

    bar = _bar(references, strain, apart, size) + (NOISE + _KEPT_TO) * size
    return without_limits(problem, strain, {metric: bar}, truth)[metric]


def _bar(
    references: ReferenceSet, strain: Strain, apart: Callable[[State], float], size: float = 1.0
) -> float:
    """By the rule of the module from how far apart a coarser solution and the truth are.

    `size` is what they are apart by where nothing is told at all.
    """
    truth = references.stress_truth(strain)
    if truth is None:
        return math.inf
    coarse = references.states.get((QUADRATIC, strain))
    if truth is coarse:
        known = {**references.aside, **references.states}
        linear = known.get((SAME_MESH, strain))
        if linear is None:
            return math.inf
        return saturated(apart(linear) / size) * size if size > 0.0 else apart(linear)
    if coarse is None or coarse.integrals is None or truth.integrals is None:
        return math.inf
    ratio = 2.0 ** (truth.integrals.halvings - coarse.integrals.halvings)
    if not ratio > 1.0:
        return math.inf
    return SAFETY_FACTOR * apart(coarse) / (ratio - 1.0)
