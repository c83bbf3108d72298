"""Where a reference's numbers have no limit as the mesh is refined, so that no bar can hold it.

Under a force on a single point the displacement grows as 1 / r (Kelvin's solution), and the square
of its gradient cannot be integrated. Under linear strain integrals of the displacement still have
a limit, and so have stresses, the force on a tool and that of a support elsewhere; the displacement
of points, energies and changes of volume and area have none. Under Green strain no solution is
known, and nothing has one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics.body import dead_force
from palpate.validation.states import State

# What has a limit all the same, under linear strain.
_INTEGRALS = (
    "displacement_l2",
    "trajectory_l2",
    "tool_force",
    "stress_l2",
    "traction_resultant",
    "published_reaction",
    "published_tool_force",
    "published_stress",
)
# Of the largest nodal force: what holds a body that balances itself is left with the rounding.
_NO_FORCE = 1e-6


def has_point_forces(problem: Problem, state: State | None = None) -> bool:
    """Whether forces act on single points: loads, or supports without facets that carry any.

    Args:
        problem: What is held and pushed.
        state: Where it tells nodal forces, supports of single points count only if they carry
            some; otherwise all of them do.
    """
    if any(isinstance(load, PointForce) for load in problem.loads):
        return True
    single = [support for support in problem.supports if not len(support.facets)]
    if not single or state is None or state.integrals is None:
        return bool(single)
    # Along what it holds alone: the point may lie on a face that is held or pushed as well.
    nodal = state.integrals.internal_force
    pushed = nodal - dead_force(problem)
    least = _NO_FORCE * np.linalg.norm(nodal, axis=1).max()
    return any(
        bool((np.abs(pushed[support.points] @ support.directions.T) > least).any())
        for support in single
    )


def has_limit(metric: str, strain: Strain) -> bool:
    """Whether a metric tends to anything under forces on points."""
    return strain is Strain.LINEAR and metric in _INTEGRALS


def without_limits(
    problem: Problem, strain: Strain, bars: Mapping[str, float], state: State | None = None
) -> dict[str, float]:
    """Bars by metric, infinite where forces on points leave no limit.

    Args:
        problem: What is held and pushed.
        strain: Strain measure.
        bars: By metric.
        state: See `has_point_forces`.
    """
    if not has_point_forces(problem, state):
        return dict(bars)
    return {m: bar if has_limit(m, strain) else math.inf for m, bar in bars.items()}
