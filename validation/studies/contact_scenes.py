"""Scenes with tools, solved by both simulators on the same mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.static_contact import ContactResult, solve_contact
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.studies.contact_hertz import RADIUS, Zone, quarter_block, sphere_into_block

# Depths of the indentation [radii]; the last is that of the comparison.
DEPTHS = (0.0, 0.01, 0.025, 0.05, 0.1, 0.15)
TISSUE = Material(1e4, 0.45)
KIDNEY_EDGE = 8e-3


@dataclass(frozen=True)
class Scene:
    """A problem with one tool, and what it is called; `share` of the body is modelled."""

    name: str
    problem: Problem
    share: float = 1.0


@dataclass(frozen=True)
class Pair:
    """Both answers to one scene, knot by knot.

    Attributes:
        scene: Its name.
        strain: Strain measure.
        cells: Of the mesh.
        times: Knots with an answer of both.
        forces: Of fastsim on the tool [N], shape (n, 3).
        force_error: Largest difference of the forces over the largest force [-].
        displacement_error: Norm of the difference over the norm at the last knot [-].
        volume_error: Difference over the reference's change of volume [-].
        reached: "the end", or where equilibrium was lost.
    """

    scene: str
    strain: Strain
    cells: int
    times: tuple[float, ...]
    forces: tuple[tuple[float, ...], ...]
    force_error: float
    displacement_error: float
    volume_error: float
    reached: str


def indentation(edges_per_radius: float = 6.0) -> Scene:
    """Sphere into a block 50 contact radii wide at the last depth."""
    finest = RADIUS * np.sqrt(DEPTHS[-1])
    mesh = quarter_block(20.0 * RADIUS, Zone(finest / edges_per_radius, 1.2 * finest))
    return Scene("sphere into block", sphere_into_block(mesh, RADIUS * np.array(DEPTHS)), 4.0)


def flat_punch() -> Scene:
    """Square punch, about 0.4 of the sphere's radius to either side, into the same block.

    Its edge runs midway between vertices, further from them than it sinks: nearer ones would be
    as near to its sides as to its bottom, and then which side pushes them is a matter of taste.
    """
    block = indentation().problem
    points = block.mesh.points
    near = np.abs(points[:, 2]) < 1e-12
    near &= (points[:, :2] < 0.6 * RADIUS).all(axis=1)
    line = np.unique(np.round(points[near, :2], 12))
    outer = int(np.searchsorted(line, 0.4 * RADIUS))
    half = float(0.5 * (line[outer - 1] + line[outer]))
    depths = 0.2 * (line[outer] - line[outer - 1]) * np.arange(3.0)
    positions = np.zeros((3, 3))
    positions[:, 2] = half - depths
    path = ToolPath(np.arange(3.0), positions)
    # Wide in the planes of symmetry too: only the outer edges of the quarter are edges.
    punch = replace(block.tools[0], shape=BoxShape((half, half, half)), path=path)
    return Scene("flat punch", replace(block, tools=(punch,)), 4.0)


def kidney_mesh() -> TetMesh:
    """The kidney, about 5000 cells."""
    return mesh_surface(shape_kidney(edge_length=KIDNEY_EDGE))


def kidney_scenes() -> list[Scene]:
    """A sphere that slides over the kidney, a capsule pressed into it."""
    mesh = kidney_mesh()
    lying = np.flatnonzero(mesh.points[:, 1] < -0.02).astype(np.int32)
    top = _top_at(mesh, 0.0)
    radius = 0.015
    # Pressed 4 mm, then 30 mm along the kidney.
    down = np.array([0.0, 4.0, 4.0, 4.0, 4.0]) * 1e-3
    along = np.array([-15.0, -15.0, -5.0, 5.0, 15.0]) * 1e-3
    positions = np.stack([np.zeros(5), top + radius - down, along], axis=1)
    sphere = RigidTool(SphereShape(radius), ToolPath(np.arange(5.0), positions))
    across = np.repeat([[np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]], 4, axis=0)
    depth = 0.002 * np.arange(4.0)
    sinking = np.stack([0.0 * depth, top + 0.01 - depth, 0.0 * depth], axis=1)
    capsule = RigidTool(CapsuleShape(0.01, 0.02), ToolPath(np.arange(4.0), sinking, across))
    held = (Support(lying),)
    return [
        Scene("sphere sliding over the kidney", Problem(mesh, TISSUE, held, (), tools=(sphere,))),
        Scene("capsule into the kidney", Problem(mesh, TISSUE, held, (), tools=(capsule,))),
    ]


def compare(scene: Scene, strain: Strain, progress: Callable[[str], None]) -> Pair:
    """Solve a scene with both; up to where both have an equilibrium."""
    from palpate.reference.statics import solve_static

    progress(f"{scene.name}, {strain} strain: fastsim and reference")
    reached = "the end"
    problem = scene.problem
    try:
        found = solve_contact(problem, strain=strain)
    except ContactLostError as error:
        reached = str(error)
        if not isinstance(error.partial, ContactResult):
            raise
        found = error.partial
        problem = _until(problem, found.times)
    truth = solve_static(problem, strain=strain)
    forces = np.array(truth.tools[0].forces)
    u, v = found.displacements[-1], truth.displacement
    change = truth.volume - truth.rest_volume
    size = float(np.abs(forces).max())
    return Pair(
        scene=scene.name,
        strain=strain,
        cells=problem.mesh.num_cells,
        times=tuple(found.times.tolist()),
        forces=tuple(map(tuple, (scene.share * found.forces[:, 0]).tolist())),
        force_error=float(np.abs(found.forces[:, 0] - forces).max()) / size,
        displacement_error=float(np.linalg.norm(u - v) / np.linalg.norm(v)),
        volume_error=abs(_volume_change(problem.mesh, u) / change - 1.0),
        reached=reached,
    )


def last_depth(scene: Scene, beyond: float) -> tuple[float, float, str]:
    """Press on to `beyond` [radii]; depth [radii] and smallest det F at the end, and why there."""
    depths = RADIUS * np.array([0.0, DEPTHS[-1], beyond])
    problem = sphere_into_block(scene.problem.mesh, depths)
    try:
        found, reason = solve_contact(problem), "the end of the path"
    except ContactLostError as error:
        if not isinstance(error.partial, ContactResult):
            raise
        found, reason = error.partial, error.reason
    depth = float(np.interp(found.times[-1], np.arange(3.0), depths)) / RADIUS
    return depth, float(found.smallest_det_f[-1]), reason


def _until(problem: Problem, times: Points) -> Problem:
    tool = problem.tools[0]
    poses = np.array([tool.path.pose_at(float(t))[0] for t in times])
    return replace(problem, tools=(replace(tool, path=ToolPath(times, poses)),))


def _volume_change(mesh: TetMesh, displacement: Points) -> float:
    moved = signed_volumes(mesh.points + displacement, mesh.cells)
    return float((moved - signed_volumes(mesh.points, mesh.cells)).sum())


def _top_at(mesh: TetMesh, z: float) -> float:
    """Highest y of the boundary within 15 mm of a place along the kidney [m]."""
    near = mesh.points[np.abs(mesh.points[:, 2] - z) < 0.015]
    return float(near[:, 1].max())
