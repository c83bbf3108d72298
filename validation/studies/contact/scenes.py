"""Scenes with tools, solved by both simulators on the same mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.static_contact import ContactResult, solve_contact
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.states import Progress
from palpate.validation.studies.bodies import volume_change
from palpate.validation.studies.contact.sphere import DEPTHS, RADIUS, indentation, sphere_into_block

TISSUE = Material(1e4, 0.45)
KIDNEY_EDGE = 8e-3
# About y, by which a capsule lies across the kidney.
ACROSS = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)


class Scene(NamedTuple):
    """A problem with one tool; `parts` such make the whole body."""

    name: str
    problem: Problem
    parts: float = 1.0


class Pair(NamedTuple):
    """Both answers to one scene, knot by knot.

    `forces` are fastsim's on the tool [N]; the errors are the largest difference of the forces over
    the largest force, the norm of the difference of displacement over the norm at the last knot,
    and the difference over the reference's change of volume [-]. `reached` is "the end", or where
    equilibrium was lost.
    """

    scene: str
    strain: Strain
    cells: int
    forces: tuple[tuple[float, ...], ...]
    force_error: float
    displacement_error: float
    volume_error: float
    reached: str


def all_scenes() -> list[Scene]:
    """Sphere and punch in a block, and tools on the kidney."""
    block = Scene("sphere into block", indentation(), 4.0)
    return [block, flat_punch(block), *kidney_scenes()]


def flat_punch(block: Scene) -> Scene:
    """Square punch, about 0.4 of the sphere's radius to either side, into the same block.

    Its edge runs midway between vertices, further from them than it sinks: nearer ones would be
    as near to its sides as to its bottom, and then which side pushes them is a matter of taste.
    """
    points = block.problem.mesh.points
    near = np.abs(points[:, 2]) < 1e-12
    near &= (points[:, :2] < 0.6 * RADIUS).all(axis=1)
    line = np.unique(np.round(points[near, :2], 12))
    outer = int(np.searchsorted(line, 0.4 * RADIUS))
    half = float(0.5 * (line[outer - 1] + line[outer]))
    positions = np.zeros((3, 3))
    positions[:, 2] = half - 0.2 * (line[outer] - line[outer - 1]) * np.arange(3.0)
    # Wide in the planes of symmetry too: only the outer edges of the quarter are edges.
    punch = replace(
        block.problem.tools[0],
        shape=BoxShape((half, half, half)),
        path=ToolPath(np.arange(3.0), positions),
    )
    return Scene("flat punch", replace(block.problem, tools=(punch,)), block.parts)


def lying_kidney(mesh: TetMesh) -> Support:
    """Its side below, held."""
    return Support(np.flatnonzero(mesh.points[:, 1] < -0.02).astype(np.int32))


def kidney_scenes() -> list[Scene]:
    """A sphere that slides over the kidney, a capsule pressed into it."""
    mesh = mesh_surface(shape_kidney(edge_length=KIDNEY_EDGE))
    top = float(mesh.points[np.abs(mesh.points[:, 2]) < 0.015, 1].max())
    radius = 0.015
    # Pressed 4 mm, then 30 mm along the kidney.
    down = np.array([0.0, 4.0, 4.0, 4.0, 4.0]) * 1e-3
    along = np.array([-15.0, -15.0, -5.0, 5.0, 15.0]) * 1e-3
    positions = np.stack([np.zeros(5), top + radius - down, along], axis=1)
    sphere = RigidTool(SphereShape(radius), ToolPath(np.arange(5.0), positions))
    depth = 0.002 * np.arange(4.0)
    sinking = np.stack([0.0 * depth, top + 0.01 - depth, 0.0 * depth], axis=1)
    path = ToolPath(np.arange(4.0), sinking, np.array([ACROSS] * 4))
    capsule = RigidTool(CapsuleShape(0.01, 0.02), path)
    return [
        Scene(name, Problem(mesh, TISSUE, (lying_kidney(mesh),), (), tools=(tool,)))
        for name, tool in (
            ("sphere sliding over the kidney", sphere),
            ("capsule into the kidney", capsule),
        )
    ]


def compare(scene: Scene, strain: Strain, progress: Progress) -> Pair:
    """Solve a scene with both; up to where both have an equilibrium."""
    from palpate.reference.statics import solve_static

    progress(f"{scene.name}, {strain} strain: fastsim and reference")
    problem = scene.problem
    found, lost = _solve_on(problem, strain)
    if lost is not None:
        tool = problem.tools[0]
        poses = np.array([tool.path.pose_at(float(t))[0] for t in found.times])
        shorter = replace(tool, path=ToolPath(found.times, poses))
        problem = replace(problem, tools=(shorter,))
    truth = solve_static(problem, strain=strain)
    forces = np.array(truth.tools[0].forces)
    u, v = found.displacements[-1], truth.displacement
    change = volume_change(problem.mesh, u) * problem.mesh.volume
    return Pair(
        scene.name,
        strain,
        problem.mesh.num_cells,
        tuple(map(tuple, (scene.parts * found.forces[:, 0]).tolist())),
        float(np.abs(found.forces[:, 0] - forces).max() / np.abs(forces).max()),
        float(np.linalg.norm(u - v) / np.linalg.norm(v)),
        abs(change / (truth.volume - truth.rest_volume) - 1.0),
        "the end" if lost is None else str(lost),
    )


def last_depth(beyond: float) -> tuple[float, float, str]:
    """Press the sphere on to `beyond` [radii]; depth [radii] and smallest det F there, and why."""
    depths = (0.0, DEPTHS[-1], beyond)
    problem = sphere_into_block(indentation().mesh, depths)
    found, lost = _solve_on(problem, Strain.GREEN)
    depth = float(np.interp(found.times[-1], np.arange(3.0), depths))
    reason = "the end of the path" if lost is None else lost.reason
    return depth, float(found.smallest_det_f[-1]), reason


def _solve_on(problem: Problem, strain: Strain) -> tuple[ContactResult, ContactLostError | None]:
    """By fastsim, as far as there is an equilibrium, and what ended it."""
    try:
        return solve_contact(problem, strain=strain), None
    except ContactLostError as error:
        if not isinstance(error.partial, ContactResult):
            raise
        return error.partial, error
