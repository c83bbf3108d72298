"""A solution as a grid of pyvista, to look at, cut and measure in a notebook.

The pages and figures of a report are drawn without pyvista.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.temporaries import atomic_path

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


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise InputError(
            "pyvista is needed and not installed: pip install 'palpate[pyvista]'"
        ) from error
    return pyvista


# Frames of a GIF follow one another no faster than this [s]: players slow down what is shorter.
_FRAME = 0.02
_DISPLACEMENT = "displacement [m]"


# The scale of colours, beside the body: below it its title would cross its numbers.
BAR = {"vertical": True, "position_x": 0.86, "position_y": 0.15, "n_labels": 3, "fmt": "%.2g"}


def animate(
    problem: Problem, displacements: NDArray[np.float64], target: Path, seconds: float
) -> Path:
    """See `palpate.Trajectory.animate`."""
    if target.suffix.lower() != ".gif":
        raise InputError(f"{target}: a motion is shown as .gif")
    if not 0.0 < seconds < math.inf:
        raise InputError(f"seconds = {seconds:g}: needs a finite value above 0")
    pyvista, points = _pyvista(), problem.mesh.points
    from PIL import Image

    moved = displacements[:: max(1, math.ceil(len(displacements) * _FRAME / seconds))]
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: np.array(problem.mesh.cells)}, points)
    lengths = np.linalg.norm(moved, axis=2)
    plotter = pyvista.Plotter(off_screen=True, window_size=(800, 600))
    grid.point_data[_DISPLACEMENT] = lengths[0]
    largest = float(lengths.max()) or 1.0
    plotter.add_mesh(
        grid, scalars=_DISPLACEMENT, clim=(0.0, largest), show_edges=True, scalar_bar_args=BAR
    )
    # One camera, which sees the body wherever it goes.
    everywhere = (points + moved).reshape(-1, 3)
    bounds = np.stack([everywhere.min(axis=0), everywhere.max(axis=0)], axis=1).ravel()
    plotter.view_isometric()
    plotter.reset_camera(bounds=tuple(bounds))
    plotter.camera.zoom(0.8)  # beside the bar
    frames = []
    for displacement, length in zip(moved, lengths, strict=True):
        grid.points, grid.point_data[_DISPLACEMENT] = points + displacement, length
        plotter.render()
        frames.append(Image.fromarray(plotter.screenshot(return_img=True)))
    plotter.close()
    with atomic_path(target) as temporary:
        frames[0].save(
            temporary, format="GIF", save_all=True, append_images=frames[1:], loop=0,
            duration=round(1e3 * seconds / len(frames)),
        )  # fmt: skip
    return target


def to_pyvista(problem: Problem, state: Drawn, *, step: int = -1) -> UnstructuredGrid:
    """See `palpate.to_pyvista`."""
    pyvista = _pyvista()
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
