"""Whether the stresses kept of a truth can be right: shapes, and balance with the loads.

The case's linear shape functions lie among those that the truth was solved with, so that it is in
balance with the loads at the case's points too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Problem
from palpate.validation.exchange.nodal_arrays import held_components, held_slopes, touchable_points
from palpate.validation.metrics.body import dead_force
from palpate.validation.states import State

# Of the largest nodal force: solved to 1e-10, summed over the points of a cell cut in eight twice.
_BALANCED_TO = 1e-7


def wrong_stresses(problem: Problem, state: State) -> Iterator[str]:
    """What is wrong with the stresses of a state, a line each; none where it has none."""
    kept, mesh = state.integrals, problem.mesh
    if kept is None:
        return
    wanted = ((mesh.num_cells, 3, 3), (mesh.num_points, 3))
    shapes = (kept.cauchy.shape, kept.internal_force.shape)
    if shapes != wanted or not all(
        np.isfinite(field).all() for field in (kept.cauchy, kept.internal_force)
    ):
        yield f"stresses do not fit the mesh: shapes {shapes}, not {wanted}, all finite"
        return
    if kept.strain_energy is not None and not 0.0 <= kept.strain_energy < math.inf:
        yield f"a strain energy of {kept.strain_energy:g} J"
    free = (held_components(problem)[0] == 0) & ~touchable_points(problem)[:, None]
    for load in problem.loads:
        if isinstance(load, Pressure):
            # It follows the truth's own surface, which is not kept.
            free[load.facets] = False
    for spring in problem.springs:
        # It pulls at the edges of a quadratic truth too.
        free[spring.facets] = False
    slopes = held_slopes(problem)
    if slopes is not None:
        free[slopes.points] = False
    dead = dead_force(problem)
    scale = float(np.abs(np.concatenate([kept.internal_force, dead])).max())
    left = float(np.abs(kept.internal_force - dead)[free].max(initial=0.0))
    if not left <= _BALANCED_TO * scale:
        yield (
            f"its stresses leave {left:.3g} N at a free point, where the largest nodal force is "
            f"{scale:.3g} N"
        )
