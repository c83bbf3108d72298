"""Error bars of the truth's stress in a part of the body, of its energy, of forces through it.

A stored truth, on adaptive meshes, has them for the parts that the case's checks named when it was
built: its meshes were refined for those, and of others nothing is told. Where the truth is on the
case's own mesh, solved on the spot, the bar is its difference from linear tetrahedra there,
infinite where that is above a half: see `live`. Under forces on points and Green strain nothing has
a limit, and every bar is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics import Number, Part, measure
from palpate.validation.references.adaptive_truth import name_of_part
from palpate.validation.references.limits import without_limits
from palpate.validation.references.live import saturated
from palpate.validation.references.sequences import NOISE
from palpate.validation.references.sets import SAME_MESH, TRUTH, ReferenceSet
from palpate.validation.states import State

# Relative: stresses of a stored truth are kept in single precision.
_KEPT_TO = 2.0**-23


def bar_of_part(
    problem: Problem, references: ReferenceSet, strain: Strain, metric: str, part: Part
) -> float:
    """What the truth of a metric of a part may be off by, relative to the metric's scale [-].

    Infinite where nothing tells it.
    """
    truth = references.stress_truth(strain)
    if truth is None:
        return math.inf
    if truth.label == TRUTH:
        return references.bars.get((name_of_part(metric, part), strain), math.inf) + _KEPT_TO
    linear = _linear(references, strain)
    if linear is None:
        return math.inf
    bar = saturated(measure(metric, problem, linear, truth, part).value) + NOISE
    return without_limits(problem, strain, {metric: bar}, truth)[metric]


def bar_of_number(
    problem: Problem,
    references: ReferenceSet,
    strain: Strain,
    metric: str,
    name: str,
    read: Callable[[State], Number | None],
) -> float:
    """What a number that the truth's stresses or energy tell may be off by, over its scale [-].

    By the same rule, of the signed number itself. Infinite where a solution does not tell it.

    Args:
        problem: The case's.
        references: Of the case.
        strain: Strain measure.
        metric: Its name.
        name: Of the bar that a stored truth has for it.
        read: The number of a state.
    """
    truth = references.stress_truth(strain)
    if truth is None:
        return math.inf
    if truth.label == TRUTH:
        return references.bars.get((name, strain), math.inf) + _KEPT_TO
    linear = _linear(references, strain)
    other, best = None if linear is None else read(linear), read(truth)
    if other is None or best is None or not best.scale > 0.0:
        return math.inf
    size, apart = abs(best.value), abs(other.value - best.value)
    bar = saturated(apart / size) * size if size > 0.0 else apart
    bar = bar / best.scale + NOISE
    return without_limits(problem, strain, {metric: bar}, truth)[metric]


def was_asked(references: ReferenceSet, strain: Strain, name: str) -> bool:
    """Whether a stored truth was asked for a bar; one that was solved on the spot tells any."""
    truth = references.stress_truth(strain)
    return truth is None or truth.label != TRUTH or (name, strain) in references.bars


def _linear(references: ReferenceSet, strain: Strain) -> State | None:
    """Linear tetrahedra on the case's mesh, whoever is judged."""
    return {**references.aside, **references.states}.get((SAME_MESH, strain))
