"""A rigid sphere pressed into a block: a quarter of it, graded towards the contact.

Hertz: F = 4/3 E* sqrt(R) d^1.5, E* = E / (1 - nu^2), contact radius a = sqrt(R d) (Johnson 1985,
"Contact Mechanics", section 4.2), for small a / R on a half space.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import refine_to_size
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

RADIUS = 0.01
MATERIAL = Material(5000.0, 0.3)


def hertz_force(depth: Points, material: Material = MATERIAL, radius: float = RADIUS) -> Points:
    """Force of Hertz [N] at depths [m]."""
    stiffness = material.youngs_modulus / (1.0 - material.poissons_ratio**2)
    force: Points = 4.0 / 3.0 * stiffness * np.sqrt(radius) * np.asarray(depth) ** 1.5
    return force


def contact_radius(depth: float, radius: float = RADIUS) -> float:
    """Contact radius of Hertz [m]."""
    return float(np.sqrt(radius * depth))


@dataclass(frozen=True)
class Zone:
    """Where the mesh is finest: `edge` [m] within `reach` [m], then growing by `growth` [-]."""

    edge: float
    reach: float
    growth: float = 0.3


def quarter_block(side: float, zone: Zone) -> TetMesh:
    """The block 0 <= x, y <= side, -side <= z <= 0, graded towards the origin."""
    graded = GradedMesh(kuhn_cube(side))

    def size(places: Points) -> Points:
        distance = np.linalg.norm(places, axis=1)
        wanted: Points = np.maximum(zone.edge, zone.growth * (distance - zone.reach) + zone.edge)
        return wanted

    refine_to_size(graded, size, max_cells=400_000)
    mesh = graded.mesh
    return TetMesh(np.array(mesh.points), np.array(mesh.cells))


def sphere_into_block(mesh: TetMesh, depths: Points, material: Material = MATERIAL) -> Problem:
    """Sphere above the origin of a quarter block, pressed to depths [m] (the first is 0).

    Two sides are planes of symmetry, the bottom does not sink, the outer sides are free. The
    sphere may touch facets of the top within its own radius.
    """
    points = mesh.points
    side = float(points[:, 0].max())
    supports = []
    facets = mesh.boundary_facets
    for axis, value in ((0, 0.0), (1, 0.0), (2, -side)):
        # With their facets, so that quadratic elements hold their edges too.
        on_plane = facets[(np.abs(points[facets][:, :, axis] - value) < 1e-9 * side).all(axis=1)]
        held = tuple(k == axis for k in range(3))
        supports.append(Support(np.unique(on_plane), on_plane, (held[0], held[1], held[2])))
    is_top = (np.abs(points[facets][:, :, 2]) < 1e-9 * side).all(axis=1)
    is_near = (np.linalg.norm(points[facets][:, :, :2], axis=2) < RADIUS).any(axis=1)
    depths = np.asarray(depths, dtype=np.float64)
    positions = np.zeros((len(depths), 3))
    positions[:, 2] = RADIUS - depths
    path = ToolPath(np.arange(len(depths), dtype=np.float64), positions)
    tool = RigidTool(SphereShape(RADIUS), path, contact_facets=facets[is_top & is_near])
    return Problem(mesh, material, tuple(supports), (), tools=(tool,))


def kuhn_cube(side: float) -> TetMesh:
    """Six cells around the diagonal of a cube."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    cells = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        way = np.cumsum([0, *(4 >> axis for axis in order)])
        cells.append(way)
    table = np.array(cells, dtype=np.int32)
    flipped = signed_volumes(corners, table) < 0.0
    table[flipped] = table[flipped][:, [0, 1, 3, 2]]
    return TetMesh(side * (corners - [0.0, 0.0, 1.0]), table)
