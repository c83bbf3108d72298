"""Loads, springs and rigid tools of a body, as numbers and as they are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Material, Problem
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
)
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.units import Units
from palpate.validation.exchange.nodal_arrays import area_vectors, nodal_force

# The most arrows on a face whose traction varies.
MOST_ARROWS = 60
_NO_FACETS = np.zeros((0, 3), dtype=np.int32)


@dataclass(frozen=True, eq=False)
class Resultant:
    """The resultant of one load on the rest body, of a kind in a word or two.

    On loaded facets (none of weight and point forces) of an area [m2], a force [N] acts at a center
    [m]; of a traction that varies it is the centre of the face, with a moment about it [N m], and
    the `spread` are its values at the centre of each facet [Pa], (n, 3).
    """

    kind: str
    facets: Indices
    area: float
    force: Points
    center: Points
    moment: Points = field(default_factory=lambda: np.zeros(3))
    spread: Points | None = None


def resultant_of(problem: Problem, load: Load) -> Resultant:
    """The resultant of a load on the rest body, with a factor of 1."""
    mesh = problem.mesh
    match load:
        case Traction() | Pressure():
            vectors = area_vectors(mesh.points, load.facets)
            areas = np.linalg.norm(vectors, axis=1)
            total = float(areas.sum())
            center = np.average(mesh.points[load.facets].mean(axis=1), axis=0, weights=areas)
            if isinstance(load, Pressure):
                force = -load.pressure * vectors.sum(axis=0)
                return Resultant("pressure", load.facets, total, force, center)
            if not load.is_uniform:
                return _varying(problem, load, total, center)
            force = np.array(load.traction) * total
            return Resultant("force on a surface", load.facets, total, force, center)
        case PointForce():
            center = mesh.points[load.points].mean(axis=0)
            return Resultant("point force", _NO_FACETS, 0.0, np.sum(load.forces, axis=0), center)
        case BodyForce():
            low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
            force = np.array(load.force_density) * mesh.volume
            return Resultant("weight", _NO_FACETS, 0.0, force, 0.5 * (low + high))


def _varying(problem: Problem, load: Traction, area: float, center: Points) -> Resultant:
    points = problem.mesh.points
    nodal = nodal_force(problem.mesh, load)
    force, moment = nodal.sum(axis=0), np.cross(points - center, nodal).sum(axis=0)
    # Rounding residue is not reported.
    size = float(np.ptp(points[np.unique(load.facets)], axis=0).max())
    largest = float(np.abs(nodal).sum())
    force[np.abs(force) < 1e-12 * largest] = 0.0
    moment[np.abs(moment) < 1e-12 * largest * size] = 0.0
    spread = load.at(points[load.facets].mean(axis=1))
    kind = "force on a surface, varying," if force.any() else "moment, its force"
    return Resultant(kind, load.facets, area, force, center, moment, spread)


def load_arrows(problem: Problem, scale: float) -> Points:
    """Loads as starts and vectors, (num_arrows, 2, 3), in a unit of `scale` metres.

    There is an arrow for each load, longer for more force, but the smallest is seen too; a traction
    that varies has many, for the force per area.
    """
    points = problem.mesh.points / scale
    reach = float(np.ptp(points, axis=0).max())
    loads = [resultant_of(problem, load) for load in problem.loads]
    arrows = [_spread_arrows(points, load, reach) for load in loads if load.spread is not None]
    whole = [load for load in loads if load.spread is None]
    sizes = [float(np.linalg.norm(load.force)) for load in whole]
    largest = max(sizes, default=0.0) or 1.0
    for load, size in zip(whole, sizes, strict=True):
        way = load.force / size if size else np.zeros(3)
        arrow = reach * way * (0.12 + 0.18 * size / largest)
        start = _start(points, problem.mesh.boundary_facets, load, load.center / scale, arrow)
        arrows.append(np.array([[start, arrow]]))
    return np.concatenate([np.zeros((0, 2, 3)), *arrows])


def spring_arrows(springs: Sequence[Spring], points: Points, scale: float) -> Points:
    """Motions of springs' anchors, or short arrows where they stay, (num_springs, 2, 3)."""
    arrows = np.zeros((len(springs), 2, 3))
    for arrow, spring in zip(arrows, springs, strict=True):
        path = spring.path
        way = (path.end - path.displacements[0] * (len(path.times) > 1)) / scale
        arrow[0] = np.array(spring.center) / scale
        arrow[1] = way if way.any() else 1e-3 * np.ptp(points, axis=0)
    return arrows


def arrows_around(problem: Problem, centre: Points, scale: float) -> Points:
    """Loads and motions of springs' anchors from a centre, (num_arrows, 2, 3).

    All in a unit of `scale` metres.
    """
    points = problem.mesh.points / scale
    pairs = [spring_arrows(problem.springs, points, scale), load_arrows(problem, scale)]
    arrows = np.concatenate(pairs)
    arrows[:, 0] -= centre
    return arrows


def _spread_arrows(points: Points, load: Resultant, reach: float) -> Points:
    """Arrows on a face whose traction varies: a push ends on the face, a pull begins there."""
    assert load.spread is not None
    rows = np.arange(0, len(load.facets), -(-len(load.facets) // MOST_ARROWS))
    middles, traction = points[load.facets[rows]].mean(axis=1), load.spread[rows]
    largest = float(np.linalg.norm(traction, axis=1).max(initial=0.0)) or 1.0
    arrows = 0.2 * reach / largest * traction
    outward = area_vectors(points, load.facets[rows])
    is_push = np.einsum("ij,ij->i", outward, arrows) < 0.0
    starts = np.where(is_push[:, None], middles - arrows, middles)
    return np.stack([starts, arrows], axis=1)


def _start(
    points: Points, boundary: Indices, load: Resultant, center: Points, arrow: Points
) -> Points:
    """Start of an arrow outside of the body: a push ends on its surface, a pull begins there."""
    length = float(np.linalg.norm(arrow))
    if length == 0.0:
        return center
    direction = arrow / length
    if load.kind == "point force":
        return center - arrow
    outward = area_vectors(points, load.facets).sum(axis=0)
    is_pull = bool(outward @ arrow > 0.0)
    # The point of the loaded facets nearest to the line of the force: about where they meet.
    # A weight has none: its arrow ends where its line enters the body, and is not hidden in it.
    is_weight = not len(load.facets)
    middles = points[boundary if is_weight else load.facets].mean(axis=1)
    along = (middles - center) @ direction
    beside = np.linalg.norm(middles - center - along[:, None] * direction, axis=1)
    if is_weight:
        near = beside <= beside.min() + 0.2 * length
        return center + direction * float(along[near].min()) - arrow
    beside[along < -1e-9 * length if is_pull else along > 1e-9 * length] = np.inf
    met = center + direction * float(along[beside.argmin()])
    return met if is_pull else met - arrow


_BOX = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
_BOX_FACETS = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ],
    dtype=np.int32,
)  # fmt: skip


def tool_surface(tool: RigidTool, size: float, *, fineness: float = 0.3) -> tuple[Points, Indices]:
    """Points (n, 3) in the tool's frame [m], and triangles (m, 3), by which a tool is drawn.

    A plane is a flat box of a side of `size` [m]; edges of spheres and capsules are a fraction of
    the radius.
    """
    match tool.shape:
        case SphereShape(radius):
            ball = shape_sphere(radius, edge_length=fineness * radius)
            return ball.points, ball.facets
        case CapsuleShape(radius, half_length):
            ball = shape_sphere(radius, edge_length=fineness * radius)
            drawn_out = np.zeros_like(ball.points)
            drawn_out[:, 2] = np.sign(np.round(ball.points[:, 2] / radius, 6)) * half_length
            return ball.points + drawn_out, ball.facets
        case BoxShape(half_widths):
            return _BOX * np.array(half_widths), _BOX_FACETS
        case SurfaceShape(surface):
            return surface.points, surface.facets
        case PlaneShape():
            low, high = np.array([-0.5, -0.5, -0.05]), np.array([0.5, 0.5, 0.0])
            return size * np.where(_BOX > 0, high, low), _BOX_FACETS


# Points of each facet at which a tool's depth is measured: barycentric, in tenths.
_TENTHS = [(i, j, 10 - i - j) for i in range(11) for j in range(11 - i)]


def depth_of(tool: RigidTool, problem: Problem) -> float | None:
    """How deep a tool's last pose reaches into the body at rest [m], 0 where it does not touch.

    None of a tool that a force drives, and of one whose shape is a surface.
    """
    if tool.drive is not None or isinstance(tool.shape, SurfaceShape):
        return None
    position, turn = tool.path.pose_at(float(tool.path.times[-1]))
    corners = problem.mesh.points[problem.mesh.boundary_facets]
    weights = np.array(_TENTHS) / 10.0
    points = (np.einsum("wk,fkx->fwx", weights, corners).reshape(-1, 3) - position) @ turn
    match tool.shape:
        case SphereShape(radius):
            within = radius - np.linalg.norm(points, axis=1)
        case CapsuleShape(radius, half_length):
            points[:, 2] -= np.clip(points[:, 2], -half_length, half_length)
            within = radius - np.linalg.norm(points, axis=1)
        case BoxShape(half_widths):
            within = (np.array(half_widths) - np.abs(points)).min(axis=1)
        case PlaneShape():
            within = -points[:, 2]
    return max(float(within.max()), 0.0)


def tools_in_words(problem: Problem, units: Units) -> list[str]:
    """Each tool as "sphere, 2 mm deep in the rest shape at the end", in the case's unit."""
    size, unit = units.of("length")
    words = []
    for tool in problem.tools:
        words.append(type(tool.shape).__name__.removesuffix("Shape").lower())
        depth = depth_of(tool, problem)
        if depth is not None:
            words[-1] += f", {depth / size:.3g} {unit} deep in the rest shape at the end"
    return words


def tools_around(
    problem: Problem, centre: Points, times: Points | None, scale: float
) -> list[tuple[Points, Indices, Points]]:
    """Each tool that follows a path, from a centre, at the times of a motion [s].

    Lengths, those of the centre too, are in a unit of `scale` metres.

    Without times at the end of the path. A tool that a force drives is left out: its position is
    part of the result, and not stored.

    Returns:
        Points in the tool's frame (n, 3), facets (m, 3), and for each time the nine numbers of the
        rotation matrix row by row and the position (num_times, 12).
    """
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    found = []
    for tool in problem.tools:
        if tool.drive is None:
            own, facets = tool_surface(tool, size)
            shown = [tool.path.times[-1]] if times is None else times
            poses = [tool.path.pose_at(float(time)) for time in shown]
            rows = np.array([[*turn.ravel(), *(at / scale - centre)] for at, turn in poses])
            found.append((own / scale, facets, rows))
    return found


@dataclass(frozen=True, eq=False)
class DrawnInclusion:
    """Cells of another material than the body's: how many, which part of it, and their surface."""

    material: Material
    num_cells: int
    volume: float
    facets: Indices

    def part_of(self, mesh: TetMesh) -> float:
        """Its volume over that of the body [-]."""
        return self.volume / mesh.volume


def inclusions_of(problem: Problem) -> list[DrawnInclusion]:
    """The inclusions of a body, in their order."""
    mesh = problem.mesh
    found = []
    for one in problem.inclusions:
        used, cells = np.unique(mesh.cells[one.cells], return_inverse=True)
        part = TetMesh(mesh.points[used], cells.reshape(-1, 4).astype(np.int32))
        facets = used[part.boundary_facets]
        found.append(DrawnInclusion(one.material, part.num_cells, part.volume, facets))
    return found


# Colours of inclusions in 3-D: unlike those of supports, loads, tools and of the scales.
_INSIDE = ((0.48, 0.31, 0.64), (0.85, 0.42, 0.1), (0.1, 0.5, 0.45), (0.75, 0.2, 0.5))


def inside_colour(number: int) -> tuple[float, float, float]:
    """The colour of an inclusion by its number from 0: red, green, blue."""
    return _INSIDE[number % len(_INSIDE)]


def inclusion_names(problem: Problem, tables: Mapping[str, Any]) -> list[str]:
    """What a case file calls its inclusions: a label, a group or a surface, or else a number."""
    given: list[Any] = [*tables.get("inclusion", ())]
    names = []
    for number, _ in enumerate(problem.inclusions, 1):
        table = given[number - 1] if len(given) == len(problem.inclusions) else {}
        called = table.get("label") or (table.get("region") or {}).get("group")
        called = called or table.get("surface")
        names.append(f"inclusion {number}" if called is None else f"inclusion {called}")
    return names


def inclusion_legend(
    problem: Problem, units: Units, tables: Mapping[str, Any]
) -> list[tuple[str, tuple[float, float, float]]]:
    """Of each inclusion its name, modulus and volume in words, and its colour, red, green, blue."""
    size, unit = units.of("stress")
    length, of_length = units.of("length")
    return [
        (
            f"{name}: E = {one.material.youngs_modulus / size:g} {unit}, "
            f"{one.volume / length**3:.4g} {of_length}3",
            inside_colour(k),
        )
        for k, (one, name) in enumerate(
            zip(inclusions_of(problem), inclusion_names(problem, tables), strict=True)
        )
    ]


def inclusions_inside(
    problem: Problem, used: Indices, units: Units, tables: Mapping[str, Any]
) -> tuple[Indices, list[tuple[str, tuple[float, float, float], Indices]]]:
    """What a 3-D view needs of the inclusions, beside the points of the boundary.

    Args:
        problem: The body.
        used: Points of the boundary, shape (n,).
        units: The case's.
        tables: Those of its file.

    Returns:
        The points of inclusions that are not among the used ones, ascending, (m,); and of each
        inclusion its words, its colour, and the facets of its surface (k, 3) in the numbering of
        the used points and then those.
    """
    found = inclusions_of(problem)
    drawn = np.concatenate([_NO_FACETS, *(one.facets for one in found)])
    inner: Indices = np.setdiff1d(drawn, used).astype(np.int32)
    row = np.full(problem.mesh.num_points, -1, dtype=np.int32)
    row[np.concatenate([used, inner])] = np.arange(len(used) + len(inner))
    legend = inclusion_legend(problem, units, tables)
    return inner, [
        (words, colour, row[one.facets]) for one, (words, colour) in zip(found, legend, strict=True)
    ]
