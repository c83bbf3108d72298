"""A first mesh that resolves tools and springs, from a displacement near the equilibrium.

Tools touch the body at nodes. A tool as small as a facet enters between its nodes: the force is on
few nodes, there are several equilibria, and the next, finer mesh has none near that of the coarser
one. A patch of a spring that is smaller than a facet is a different patch on the finer mesh. The
error estimates on such a mesh show neither of these errors.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Problem
from palpate.meshes.refinement import refine_cells
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, SphereShape, SurfaceShape, ToolShape
from palpate.meshes.tet_mesh import CELL_FACETS
from palpate.reference.contact.tool_distance import tool_distance

# Largest radius of a facet's circumcircle over that of a round tool or spring: the flat facet then
# enters the tool by at most 1 - (1 - 0.43^2)^(1/2) = 0.1 of its radius between the corners.
_COARSEST = 0.43
# Facets nearer than this, in units of the tool's radius, may come into contact.
_NEAR = 0.15
# The same over the radius of the surface in contact, (R d)^(1/2) for a tool pressed in by d: the
# first meshes of a slab had one facet there, and displacements went apart before they settled.
_COARSEST_IN_CONTACT = 0.5
# Each round halves the edges.
_MOST_ROUNDS = 4


def first_mesh(problem: Problem, start: Points) -> tuple[Problem, Points, Indices]:
    """Cut the cells whose facets are too coarse for what touches them.

    `start` is a displacement near the equilibrium at the points of the case's mesh [m]. Returns the
    problem on the finer mesh, the displacement at its points, linear in the case's cells, and for
    each cell the cell of the case that it lies in, shape (num_cells,).
    """
    case_cell: Indices = np.arange(problem.mesh.num_cells, dtype=np.int32)
    current, moved = problem, np.asarray(start, dtype=np.float64)
    for _ in range(_MOST_ROUNDS):
        coarse = _too_coarse(current, moved)
        if not coarse.any():
            break
        refined = refine_cells(current, coarse)
        case_cell = case_cell[refined.given_cell]
        current = refined.problem
        moved = _carried(problem, start, current, case_cell)
    return current, moved, case_cell


def _too_coarse(problem: Problem, moved: Points) -> NDArray[np.bool_]:
    """Cells with a facet that is too large for a tool or a spring there."""
    mesh = problem.mesh
    facets = mesh.boundary_facets
    corners = (mesh.points + moved)[facets]
    seen = np.hstack([corners, 0.5 * (corners + np.roll(corners, 1, axis=1))])
    allowed = np.full(len(facets), math.inf)
    for tool in problem.tools:
        radius = _radius(tool.shape)
        if not math.isfinite(radius) or tool.drive is not None:
            continue
        pose = tool.path.pose_at(float(tool.path.times[-1]))
        gaps = tool_distance(tool.shape, *pose, seen.reshape(-1, 3)).gap.reshape(len(facets), -1)
        at_rest = tool_distance(tool.shape, *pose, mesh.points[np.unique(facets)]).gap
        depth = min(max(0.0, -float(at_rest.min())), radius)
        least = gaps.min(axis=1)
        for reach, size in (
            (_NEAR * radius, _COARSEST * radius),
            (min(_NEAR * radius, depth), _COARSEST_IN_CONTACT * math.sqrt(radius * depth)),
        ):
            is_near = least < reach
            allowed[is_near] = np.minimum(allowed[is_near], size)
    for spring in problem.springs:
        attached = spring.facets[spring.weights(mesh.points[spring.facets]).any(axis=1)]
        is_attached = _rows_in(facets, attached)
        allowed[is_attached] = np.minimum(allowed[is_attached], _COARSEST * spring.radius)
    coarse = facets[_circles(mesh.points[facets]) > allowed]
    own = mesh.cells[:, CELL_FACETS].reshape(-1, 3)
    found: NDArray[np.bool_] = _rows_in(own, coarse).reshape(-1, 4).any(axis=1)
    return found


def _radius(shape: ToolShape) -> float:
    """Radius of the thinnest part that may touch [m]; infinite for flat shapes."""
    match shape:
        case SphereShape(radius) | CapsuleShape(radius):
            return radius
        case BoxShape(half_widths):
            return min(half_widths)
        case SurfaceShape(surface):
            return 0.5 * float(np.ptp(surface.points, axis=0).min())
    return math.inf


def _circles(corners: Points) -> Floats:
    """Radii of the circles through the corners of facets [m], shape (n,) for (n, 3, 3)."""
    a, b, c = (np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(3))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii: Floats = a * b * c / (2.0 * np.linalg.norm(normal, axis=1))
    return radii


def _rows_in(facets: Indices, chosen: Indices) -> NDArray[np.bool_]:
    """Which facets are among the chosen, whatever the order of their points, shape (n,)."""
    rows = np.sort(np.vstack([facets, chosen]), axis=1)
    _, number = np.unique(rows, axis=0, return_inverse=True)
    of_rows = number.reshape(-1)
    return np.isin(of_rows[: len(facets)], of_rows[len(facets) :])


def _carried(problem: Problem, start: Points, finer: Problem, case_cell: Indices) -> Points:
    """A displacement, linear in the cells of a mesh, at the points of a finer one."""
    mesh, cells = problem.mesh, finer.mesh.cells
    own = np.empty(finer.mesh.num_points, dtype=np.int64)
    own[cells] = case_cell[:, None]
    corners = mesh.points[mesh.cells[own]]
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    parts = np.linalg.solve(edges, (finer.mesh.points - corners[:, 0])[:, :, None])[:, :, 0]
    weights = np.column_stack([1.0 - parts.sum(axis=1), parts])
    carried: Points = np.einsum("pk,pki->pi", weights, start[mesh.cells[own]])
    return carried
