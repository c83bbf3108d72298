"""The cells that decide the critical time step of a mesh, and the bound by its surface.

A cell is stable up to 2 / omega, omega^2 the largest eigenvalue of its own stiffness over its own
lumped mass. Let one corner move along the gradient of its shape function: that has the energy of
a plane wave, so omega >= 2 c / h, with h the cell's altitude at that corner and c the speed of
pressure waves, and the step is at most h / c. An altitude of a cell is at most that of any of its
facets at the same corner. So a fixed facet allows no more than its smallest altitude over
c, whatever lies behind it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body, lame_parameters
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.triangles import facet_areas, side_lengths

# Largest number of cells listed for a mesh.
MOST_TOLD = 10
# Altitudes to mesh for, in units of c times the target: a good cell's step is about half its
# smallest altitude over c.
_FACTORS = (0.0, 2.0, 2.5, 3.0)
# Moves of points at the end, and the relative gain of the step that a move has to bring.
_MOST_MOVES = 300
_LEAST_GAIN = 1e-3
# Steps of the search for a position, in units of the longest edge at the point.
_REACHES = (0.2, 0.1, 0.05, 0.02, 0.01)


@dataclass(frozen=True, eq=False)
class CriticalCells:
    """The cells and the facet that decide the time step of a mesh.

    Attributes:
        time_step: Time step of the mesh [s]: the smallest of all cells'.
        wave_speed: Speed of pressure waves [m/s]; times `time_step` a length of the mesh alone.
        cells: The ten with the smallest steps, smallest first.
        steps: Stable steps of these cells [s].
        positions: Their centroids [m], shape (n, 3).
        smallest_dihedral_deg: Smallest dihedral angle of all cells [degrees].
        surface_step: What the surface's thinnest facet allows at most [s].
        surface_facet: The number of that facet among the mesh's boundary facets.
        surface_place: Its centroid [m], shape (3,).
    """

    time_step: float
    wave_speed: float
    cells: Indices
    steps: Floats
    positions: Points
    smallest_dihedral_deg: float
    surface_step: float
    surface_facet: int
    surface_place: Points


def find_critical_cells(mesh: TetMesh, material: Material) -> CriticalCells:
    """The cells that decide the time step of linear tetrahedra at rest, and the surface's bound.

    In one pass over all cells; eigenvalues are computed of the few that may be among the worst.
    """
    angle, upper, tenth = _bounds(mesh, material)
    # Beyond rounding, also of cells that are nearly flat.
    candidates = np.flatnonzero(upper >= (1.0 - 1e-6) * tenth)
    used, corners = np.unique(mesh.cells[candidates], return_inverse=True)
    alone = TetMesh(mesh.points[used], corners.reshape(-1, 4).astype(np.int32))
    steps = Body(alone, material).cell_time_steps()
    worst = np.argsort(steps, kind="stable")[:MOST_TOLD]
    first = candidates[worst].astype(np.int32)
    speed = wave_speed(material)
    boundary = _core.find_boundary_facets(mesh.cells, mesh.num_points)
    altitudes = facet_altitudes(mesh.points[boundary])
    thinnest = int(np.argmin(altitudes))
    return CriticalCells(
        time_step=float(steps[worst[0]]),
        wave_speed=speed,
        cells=first,
        steps=steps[worst],
        positions=mesh.points[mesh.cells[first]].mean(axis=1),
        smallest_dihedral_deg=angle,
        surface_step=float(altitudes[thinnest]) / speed,
        surface_facet=thinnest,
        surface_place=mesh.points[boundary[thinnest]].mean(axis=0),
    )


def _bounds(mesh: TetMesh, material: Material) -> tuple[float, Floats, float]:
    """Smallest dihedral angle [degrees], and bounds of each cell's stiffness over its volume.

    With gradients g_a, the blocks are K_ab = lmbda g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I. Let
    T and F2 be the sums of g_a . g_a and of (g_a . g_b)^2. The largest eigenvalue is at most the
    Frobenius norm, root((lmbda^2 + mu^2) T^2 + (5 mu^2 + 4 lmbda mu) F2), and at least Rayleigh's
    quotient of all gradients, lmbda T + 2 mu F2 / T: 1 % apart at a Poisson's ratio of 0.45.

    Returns:
        The angle, the upper bounds, shape (num_cells,), and the tenth of the largest lower bounds.
    """
    cosine, upper, lower = _core.bound_cell_stiffness(
        mesh.points, mesh.cells, *lame_parameters(material)
    )
    tenth = min(MOST_TOLD, len(lower))
    angle = math.degrees(math.acos(min(cosine, 1.0)))
    return angle, upper, float(np.partition(lower, -tenth)[-tenth])


def wave_speed(material: Material) -> float:
    """Speed of pressure waves at rest [m/s]: root((lambda + 2 mu) / rho)."""
    modulus, ratio = material.youngs_modulus, material.poissons_ratio
    stiffness = modulus * (1.0 - ratio) / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    return float(np.sqrt(stiffness / material.density))


def facet_altitudes(corners: Points) -> Floats:
    """Smallest altitude of each facet [m], given by its corners, shape (num_facets, 3, 3)."""
    altitudes: Floats = 2.0 * facet_areas(corners) / side_lengths(corners).max(axis=1)
    return altitudes


def mesh_to_time_step(
    material: Material,
    time_step: float,
    make: Callable[[float], TetMesh],
    progress: Callable[[str], None] | None = None,
) -> TetMesh:
    """Mesh until the stable step is as long as wanted [s], or as near to it as possible.

    Cells below an altitude are improved by flips, moves and insertions of inner points, and the
    cells that decide the step by moves for its own sake; the altitude is raised until the step is
    reached. The mesh may fall short of it: `find_critical_cells` shows by how much, and the bound
    by the surface. `make` meshes a surface, from an altitude [m] below which cells are improved; 0
    is as without a target.
    """
    speed = wave_speed(material)
    best: tuple[float, TetMesh] | None = None
    for factor in _FACTORS:
        mesh = make(factor * time_step * speed)
        mesh, reached = move_for_time_step(mesh, material, time_step)
        if progress:
            progress(f"time step {reached:.3g} s of {time_step:.3g} s wanted")
        if best is None or reached > best[0]:
            best = reached, mesh
        if reached >= time_step:
            break
    assert best is not None
    return best[1]


def move_for_time_step(
    mesh: TetMesh, material: Material, time_step: float
) -> tuple[TetMesh, float]:
    """Move inner points at the cell that decides the step until that is as long as wanted [s].

    Returns the mesh, its boundary as before, and its step [s]: as wanted, or that of a cell whose
    corners are all on the boundary, or where no small move of one makes the worst cell around it
    better.
    """
    points = mesh.points.copy()
    steps = Body(mesh, material).cell_time_steps()
    is_inner = np.ones(mesh.num_points, dtype=bool)
    is_inner[mesh.boundary_facets] = False
    order = np.argsort(mesh.cells, axis=None, kind="stable")
    starts = np.searchsorted(mesh.cells.ravel()[order], np.arange(mesh.num_points + 1))
    for _ in range(_MOST_MOVES):
        worst = int(np.argmin(steps))
        if steps[worst] >= time_step:
            break
        for point in mesh.cells[worst]:
            star = order[starts[point] : starts[point + 1]] // 4
            if is_inner[point] and _move(
                points, mesh.cells[star], int(point), steps, star, material
            ):
                break
        else:
            break
    moved = TetMesh(points, mesh.cells, mesh.facet_groups, mesh.point_groups)
    return moved, float(steps.min())


def _move(
    points: Points, cells: Indices, point: int, steps: Floats, star: Indices, material: Material
) -> bool:
    """Move one point to a better position, if there is one, and update its cells' steps."""
    before = best = float(steps[star].min())
    start = points[point].copy()
    reach = float(np.linalg.norm(points[cells] - start, axis=2).max())
    is_it = cells == point
    position, found = start, steps[star]
    for part in _REACHES:
        positions = position + part * reach * _WAYS
        corners = np.repeat(points[cells][None], len(positions), axis=0)
        corners[:, is_it] = positions[:, None, :]
        tried = cell_steps(corners.reshape(-1, 4, 3), material).reshape(len(positions), -1)
        first = int(np.argmax(tried.min(axis=1)))
        if tried[first].min() > best:
            best, position, found = float(tried[first].min()), positions[first], tried[first]
    if best < (1.0 + _LEAST_GAIN) * before:
        return False
    points[point] = position
    if any(_core.orient3d(*(points[k].tolist() for k in cell)) <= 0 for cell in cells):
        points[point] = start
        return False
    steps[star] = found
    return True


# Along the axes, and the corners of a cube.
_WAYS = np.array([w for w in np.ndindex(3, 3, 3) if w != (1, 1, 1)], dtype=np.float64) - 1.0


def cell_steps(corners: Points, material: Material) -> Floats:
    """The step of single cells, shape (n, 4, 3) [s]; 0 of one that is inverted or flat.

    See `Body.cell_time_steps`, which does so for a mesh.
    """
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.linalg.det(edges)
    is_good = volumes > 1e-9 * np.linalg.norm(edges, axis=2).max(axis=1) ** 3
    steps = np.zeros(len(corners))
    inverse = np.linalg.inv(edges[is_good]).transpose(0, 2, 1)
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    # B^T D B, block by block: lambda g_a g_b^T + mu (g_a . g_b I + g_b g_a^T).
    lmbda, mu = lame_parameters(material)
    outer = np.einsum("nai,nbj->naibj", gradients, gradients)
    inner = np.einsum("nai,nbi->nab", gradients, gradients)
    block = lmbda * outer + mu * outer.transpose(0, 1, 4, 3, 2)
    block += mu * inner[:, :, None, :, None] * np.eye(3)[None, None, :, None, :]
    largest = np.linalg.eigvalsh(block.reshape(-1, 12, 12))[:, -1]
    steps[is_good] = np.sqrt(material.density / largest)
    return steps
