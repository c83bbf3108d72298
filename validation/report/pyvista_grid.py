"""A solution as a grid of pyvista, to look at, cut and measure in a notebook.

The pages and figures of a report are drawn without pyvista.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid


class _Stresses(Protocol):
    @property
    def von_mises(self) -> Floats: ...
    @property
    def cauchy(self) -> Floats: ...


class Drawn(Protocol):
    """What is drawn of a state: see `palpate.State`, which imports this file."""

    @property
    def displacements(self) -> NDArray[np.float64]:
        """[m], (num_times, num_points, 3)."""

    @property
    def stresses(self) -> _Stresses | None:
        """Of the last of them."""


def to_pyvista(problem: Problem, state: Drawn, *, step: int = -1) -> UnstructuredGrid:
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
