"""A rigid sphere pressed into a block, a quarter of it, graded towards the contact.

Against Hertz on finer meshes, and with penalties of growing stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import refine_to_size
from palpate.meshes.arrays import Points
from palpate.meshes.bricks import brick_box, rollers, side
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Progress
from palpate.validation.studies.closed_forms import contact_radius, hertz_force

RADIUS = 0.01
MATERIAL = Material(5000.0, 0.3)
BLOCK_SIDE = 20.0  # radii
DEPTH = 0.01  # radii: the block is 200 contact radii wide
# Edges in a contact radius, and how fast they grow with distance: all edges shrink together.
LEVELS = ((4.0, 0.4), (4.0 * 2**0.5, 0.4 / 2**0.5), (8.0, 0.2), (8.0 * 2**0.5, 0.2 / 2**0.5))
# Depths of the indentation [radii]; the last is that of the comparison.
DEPTHS = (0.0, 0.01, 0.025, 0.05, 0.1, 0.15)
# Penalties in stiffnesses of a layer of cells, as the constraint's own is 100.
LAYERS = (3.0, 10.0, 30.0, 100.0)


class Level(NamedTuple):
    """One mesh of the family: force over Hertz' at 0.01 R."""

    edges_per_radius: float
    cells: int
    linear: float
    green: float


class Penalty(NamedTuple):
    """Force of one penalty stiffness [Pa/m]: what it lacks of the constraint's [-]; depth [m]."""

    layers: float
    stiffness: float
    lack: float
    penetration: float


def hertz(depth: float) -> float:
    """Force of Hertz on the whole sphere at a depth in radii [N]."""
    return hertz_force(depth * RADIUS, MATERIAL, RADIUS)


def quarter_cube(edge: float) -> TetMesh:
    """Six cells around the diagonal of the cube 0 <= x, y <= edge, -edge <= z <= 0 [m]."""
    cube = brick_box((1, 1, 1), (edge, edge, edge))
    return TetMesh(cube.points - [0.0, 0.0, edge], cube.cells)


def quarter_block(
    finest: float, reach: float, *, growth: float = 0.3, width: float = BLOCK_SIDE * RADIUS
) -> TetMesh:
    """The block graded towards the origin.

    Args:
        finest: Edge within `reach` of the origin [m].
        reach: [m].
        growth: Of the edge with distance beyond [-].
        width: Of the quarter [m].
    """
    graded = GradedMesh(quarter_cube(width))

    def size(places: Points) -> Points:
        distance = np.linalg.norm(places, axis=1)
        wanted: Points = np.maximum(finest, growth * (distance - reach) + finest)
        return wanted

    refine_to_size(graded, size, max_cells=400_000)
    mesh = graded.mesh
    return TetMesh(np.array(mesh.points), np.array(mesh.cells))


def sphere_into_block(mesh: TetMesh, depths: Sequence[float]) -> Problem:
    """Sphere above the origin of a quarter block, pressed to depths [radii], the first 0.

    Two sides are planes of symmetry, the bottom does not sink, the outer sides are free. The
    sphere may touch facets of the top within its own radius.
    """
    width = float(mesh.points[:, 0].max())
    supports = rollers(mesh, ((0, 0.0), (1, 0.0), (2, -width)))
    top = side(mesh, 2, 0.0)
    is_near = (np.linalg.norm(mesh.points[top][:, :, :2], axis=2) < RADIUS).any(axis=1)
    times = np.arange(len(depths), dtype=np.float64)
    positions = np.zeros((len(depths), 3))
    positions[:, 2] = RADIUS * (1.0 - np.array(depths))
    tool = RigidTool(SphereShape(RADIUS), ToolPath(times, positions), contact_facets=top[is_near])
    return Problem(mesh, MATERIAL, supports, (), tools=(tool,))


def indentation(edges_per_radius: float = 6.0) -> Problem:
    """Sphere into a block 50 contact radii wide at the last depth."""
    finest = contact_radius(DEPTHS[-1] * RADIUS, RADIUS)
    return sphere_into_block(quarter_block(finest / edges_per_radius, 1.2 * finest), DEPTHS)


def hertz_level(edges_per_radius: float, growth: float, progress: Progress) -> Level:
    """Both strains on one mesh of the family."""
    radius = contact_radius(DEPTH * RADIUS, RADIUS)
    mesh = quarter_block(radius / edges_per_radius, 1.5 * radius, growth=growth)
    progress(f"Hertz: {edges_per_radius:.3g} edges in the contact radius, {mesh.num_cells} cells")
    problem = sphere_into_block(mesh, (0.0, DEPTH))
    linear, green = (
        4.0 * float(solve_contact(problem, strain=strain).forces[-1, 0, 2]) / hertz(DEPTH)
        for strain in (Strain.LINEAR, Strain.GREEN)
    )
    return Level(edges_per_radius, mesh.num_cells, linear, green)


def vary_penalty() -> list[Penalty]:
    """The force at 0.05 R under penalties of growing stiffness."""
    problem = sphere_into_block(indentation(4.0).mesh, (0.0, 0.05))
    exact = solve_contact(problem)
    limit = float(exact.forces[-1, 0, 2])
    found = []
    for layers in LAYERS:
        law = ContactLaw(ContactForm.PENALTY, exact.stiffnesses[0] * layers / 100.0)
        run = solve_contact(problem, law=law)
        lack = 1.0 - float(run.forces[-1, 0, 2]) / limit
        found.append(Penalty(layers, run.stiffnesses[0], lack, float(run.penetrations[-1, 0])))
    return found


def penalty_rates(penalties: Sequence[Penalty]) -> list[float]:
    """Exponents of what is lacking, from one stiffness to the next."""
    return [
        float(np.log(a.lack / b.lack) / np.log(b.stiffness / a.stiffness))
        for a, b in pairwise(penalties)
    ]
