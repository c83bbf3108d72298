"""Error bars of the truth from sequences of meshes, metric by metric.

Three meshes, each cut in eight from the last, give an order, Richardson's value and the grid
convergence index (`grid_convergence`). Signed numbers (volume, area, largest displacement) are
assessed as they are, and may be found oscillating; errors of fields, which have no sign, by how
their differences shrink. Sequences of degrees on one mesh carry no index.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from numpy.linalg import norm

from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics import COMPARISONS, stress_integrals
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.states import State

# Of displacements in the interior; at clamped edges less, which a quarter of it allows for.
EXPECTED_ORDER = 2.0
# Relative: what solves to 1e-10 of the forces may leave in a number.
NOISE = 1e-8
# Two grids only: Roache's factor of safety (ASME J. Fluids Eng. 116, 1994), with first order
# assumed, since clamped edges are singular; then GCI = 3 |f2 - f1| / (2^1 - 1).
SAFETY_FACTOR = 3.0
SIGNED = ("volume", "surface_area", "max_displacement")


def at_points_of(mesh: TetMesh, state: State, label: str) -> State:
    """A state of a refined mesh at the points of the mesh it came from, which come first.

    Its stresses, where the displacement at those points does not tell them, as integrals.
    """
    at_points = state.displacement[: mesh.num_points]
    stresses = None if state.degree == 1 else state.stresses
    return replace(
        state,
        label=label,
        displacement=at_points,
        max_displacement=float(norm(at_points, axis=1).max()),
        stresses=None,
        integrals=None
        if stresses is None or state.integrals is None
        else stress_integrals(mesh, stresses, state.integrals.strain_energy),
    )


def assess_metrics(mesh: TetMesh, states: Sequence[State]) -> dict[str, GridConvergence]:
    """Assess every metric on three meshes.

    Args:
        mesh: The coarsest, at whose points the states are.
        states: Finest first, each mesh half the size of the next.

    Returns:
        By metric, in units of the metric's scale: signed numbers with their own value, errors of
        fields with the finest at 0.
    """
    fine, middle, coarse = states
    found = {}
    for metric, compare in COMPARISONS.items():
        scale = compare(mesh, middle, fine).scale
        if metric in SIGNED:
            # A change that is nothing has no scale, and nothing to converge to.
            values = [getattr(s, metric) / scale if scale else 0.0 for s in states]
        else:
            last, before = compare(mesh, middle, fine), compare(mesh, coarse, middle)
            # Both in units of the finest, which is not what the coarser two are divided by.
            first = before.value * before.scale / scale if scale else 0.0
            values = [0.0, last.value, last.value + first]
        size = max(1.0, *(abs(v) for v in values))
        found[metric] = assess_grid_convergence(
            values, (1.0, 2.0, 4.0), expected_order=EXPECTED_ORDER, noise=NOISE * size
        )
    return found


def bar_of(convergence: GridConvergence) -> float:
    """The error bar, infinite where nothing can be concluded."""
    return math.inf if convergence.error_bar is None else convergence.error_bar


def bar_of_two(
    mesh: TetMesh,
    truth: State,
    coarser: State,
    others: Sequence[State],
    found: Mapping[str, GridConvergence],
) -> dict[str, float]:
    """Bars of a truth on two meshes, held against a sequence of lower degree on three.

    Args:
        mesh: The coarsest, at whose points the states are.
        truth: On the finer of the two.
        coarser: On the other.
        others: The sequence of lower degree, finest first.
        found: What `assess_metrics` says of it.

    Returns:
        By metric: Roache's rule for two grids, widened by what the sequence says.
    """
    bars = {}
    for metric, compare in COMPARISONS.items():
        bar = SAFETY_FACTOR * compare(mesh, coarser, truth).value
        # The unit that `assess_metrics` gives the sequence's own values in.
        scale = compare(mesh, others[1], others[0]).scale
        value = getattr(truth, metric) / scale if metric in SIGNED and scale else 0.0
        bars[metric] = widen(bar, value, found[metric], metric)
    return bars


def widen(bar: float, truth: float, other: GridConvergence, metric: str) -> float:
    """An error bar that another sequence has been heard about.

    Args:
        bar: Of the truth, in units of the metric's scale.
        truth: Its value in the same unit; read for signed metrics.
        other: The same metric on three meshes of another degree.
        metric: Its name.

    Returns:
        Infinite where the other sequence allows no conclusion; wide enough to meet the other's
        own bar around its extrapolated value, for signed metrics; otherwise as it was.
    """
    if other.error_bar is None:
        return math.inf
    if metric not in SIGNED or other.extrapolated is None:
        return bar
    return largest((bar, abs(truth - other.extrapolated) - other.error_bar))


def as_data(found: Mapping[str, GridConvergence]) -> dict[str, dict[str, Any]]:
    """For the file and the report."""
    return {metric: asdict(convergence) for metric, convergence in found.items()}
