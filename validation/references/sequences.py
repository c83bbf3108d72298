"""Error bars of the truth from sequences of runs, metric by metric, and what is common to all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from numpy.linalg import norm

from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.grid_convergence import GridConvergence
from palpate.validation.states import State

# Relative: what solves to 1e-10 of the forces may leave in a number.
NOISE = 1e-8
# Two grids only: Roache's factor of safety (ASME J. Fluids Eng. 116, 1994), with first order
# assumed, since clamped edges are singular; then GCI = 3 |f2 - f1| / (2^1 - 1).
SAFETY_FACTOR = 3.0


def at_points_of(mesh: TetMesh, state: State, label: str) -> State:
    """A state of a refined mesh at the points of the mesh it came from, which come first.

    Without its stresses, which are of other cells.
    """
    at_points = state.displacement[: mesh.num_points]
    return replace(
        state,
        label=label,
        displacement=at_points,
        max_displacement=float(norm(at_points, axis=1).max()),
        stresses=None,
        integrals=None,
    )


def bar_of(convergence: GridConvergence) -> float:
    """The error bar, infinite where nothing can be concluded."""
    return math.inf if convergence.error_bar is None else convergence.error_bar


def as_data(found: Mapping[str, GridConvergence]) -> dict[str, dict[str, Any]]:
    """For the file and the report."""
    return {metric: asdict(convergence) for metric, convergence in found.items()}
