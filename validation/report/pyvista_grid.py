"""A solution as a grid of pyvista, to look at, cut and measure in a notebook.

The pages and figures of a report are drawn without pyvista.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.states import State

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid


def to_pyvista(problem: Problem, state: State, *, step: int = -1) -> UnstructuredGrid:
    """See `palpate.to_pyvista`."""
    try:
        import pyvista
    except ImportError as error:
        raise InputError(
            "pyvista is needed and not installed: pip install 'palpate[pyvista]'"
        ) from error
    displacements = state.displacements
    if not -len(displacements) <= step < len(displacements):
        raise InputError(f"step {step}: there are {len(displacements)} output times, from 0")
    mesh, displacement = problem.mesh, displacements[step]
    if displacement.shape != mesh.points.shape:
        raise InputError(
            f"the state has {len(displacement)} points, the problem's mesh {mesh.num_points}; "
            "give the problem that was solved"
        )
    grid = pyvista.UnstructuredGrid(
        {pyvista.CellType.TETRA: np.array(mesh.cells)}, mesh.points + displacement
    )
    grid.point_data["displacement"] = np.array(displacement)
    if state.stresses is not None and step in (-1, len(displacements) - 1):
        grid.cell_data["von_mises"] = state.stresses.von_mises
        grid.cell_data["cauchy_stress"] = state.stresses.cauchy.reshape(-1, 9)
    return grid
