"""A picture of a case before it is solved: body, supports, loads and tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
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
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.report.acting import Acting, acting
from palpate.validation.report.scene import (
    BLUE,
    DRAWN_BY,
    GREEN,
    OCHRE,
    RED,
    Marks,
    Panel,
    Surface,
    boundary,
    draw,
    joined,
)

# Lines of a path that is drawn.
_POSES = 60
# Arrows on a face whose traction varies.
_MOST_ARROWS = 60
_SIDES = ((1.0, -1.3, 0.7), (-1.0, 1.3, -0.7))


def draw_case(case: Case, path: Path, *, by: Sequence[str] = DRAWN_BY) -> None:
    """Write a .png; pyvista draws it where it can, matplotlib elsewhere.

    Args:
        case: To be drawn.
        path: A file of that name is replaced.
        by: Who may draw, in this order.

    Raises:
        InputError: Neither can.
    """
    made = draw({"case": _panels(case)}, by=by)
    if "case" not in made:
        raise InputError(f"{path}: no picture could be drawn; install pyvista or matplotlib")
    with atomic_path(path) as temporary:
        temporary.write_bytes(made["case"])


def _panels(case: Case) -> list[Panel]:
    """The case from two sides, in its length unit."""
    problem, unit = case.problem, case.spec.units.length
    points = problem.mesh.points / LENGTH[unit]
    loads = [acting(problem, load) for load in problem.loads]
    held = joined([support.facets for support in problem.supports])
    pushed = joined([*(load.facets for load in loads), *(s.facets for s in problem.springs)])
    surfaces = boundary(points, problem.mesh.boundary_facets, held, pushed)
    marks, legend = [], []
    single = [support.points for support in problem.supports if not len(support.facets)]
    if single:
        marks.append(Marks(points[np.concatenate(single)], BLUE))
    if problem.supports:
        legend.append(("held", BLUE))
    marks += _ways_of_supports(problem, points, LENGTH[unit])
    if any(support.normal is not None for support in problem.supports):
        legend.append(("arrows on it: held along these alone, it slides across them", BLUE))
    if any(support.rotation is not None for support in problem.supports):
        legend.append(("line: axis of a support that turns", BLUE))
    if problem.initial_velocity is not None:
        marks.append(_velocities(problem, points))
        legend.append(("velocity at the start", GREEN))
    if loads:
        marks.append(force_arrows(points, loads, LENGTH[unit]))
        what = "the whole force of a load"
        if any(load.spread is not None for load in loads):
            what += ", or many the force per area where it varies"
        legend.append((f"pushed or pulled; an arrow is {what}", RED))
    if problem.springs:
        marks += [spring_arrow(spring, points, LENGTH[unit]) for spring in problem.springs]
        legend.append(("spring over a patch; an arrow is its anchor's way", RED))
    if problem.tools:
        legend.append(("tool, pale where it starts", OCHRE))
        for placed, path in _tools(problem, LENGTH[unit]):
            surfaces += placed
            marks.append(path)
    size = " x ".join(f"{side:.4g}" for side in np.ptp(points, axis=0))
    return [
        Panel(f"{case.name}: {case.title}", surfaces, _SIDES[0], marks, unit, legend),
        Panel(f"{size} {unit}, from the other side and below", surfaces, _SIDES[1], marks),
    ]


def _ways_of_supports(problem: Problem, points: Points, scale: float) -> list[Marks]:
    """Normals of what slides, and axes of what turns."""
    reach = float(np.ptp(points, axis=0).max())
    found = []
    for support in problem.supports:
        if support.normal is not None:
            rows = support.points[:: -(-len(support.points) // _MOST_ARROWS)]
            arrow = 0.08 * reach * support.directions
            vectors = np.repeat(arrow, len(rows), axis=0)
            found.append(Marks(points[rows] - vectors, BLUE, vectors=vectors))
        if support.rotation is not None:
            middle, axis = np.array(support.rotation.center) / scale, support.rotation.axis
            ends = 0.4 * reach * np.outer([-1.0, 1.0], axis)
            found.append(Marks(middle + ends, BLUE, is_path=True))
    return found


def _velocities(problem: Problem, points: Points) -> Marks:
    """The initial velocity at some points of the boundary, the fastest as long as a fifth."""
    assert problem.initial_velocity is not None
    outer = np.unique(problem.mesh.boundary_facets)
    rows = outer[:: -(-len(outer) // _MOST_ARROWS)]
    speed = problem.initial_velocity.at(problem.mesh.points[rows])
    largest = float(np.linalg.norm(speed, axis=1).max()) or 1.0
    reach = float(np.ptp(points, axis=0).max())
    return Marks(points[rows], GREEN, vectors=0.2 * reach / largest * speed)


def _tools(problem: Problem, scale: float) -> list[tuple[list[Surface], Marks]]:
    """Each tool where it starts and where it ends, and its path."""
    reach = float(np.ptp(problem.mesh.points, axis=0).max())
    found = []
    for tool in problem.tools:
        own, facets = tool_surface(tool, reach)
        times = np.linspace(tool.path.times[0], tool.path.times[-1], _POSES)
        poses = [tool.path.pose_at(float(time)) for time in times]
        placed = [
            Surface((own @ turn.T + place) / scale, facets, OCHRE, opacity=opacity)
            for (place, turn), opacity in ((poses[0], 0.35), (poses[-1], 1.0))
        ]
        path = np.array([place for place, _ in poses]) / scale
        found.append((placed, Marks(path, "black", is_path=True)))
    return found


def spring_arrow(spring: Spring, points: Points, scale: float) -> Marks:
    """The way of a spring's anchor, or a short arrow where it stays."""
    way = (spring.path.end - spring.path.displacements[0] * (len(spring.path.times) > 1)) / scale
    start = np.array(spring.center) / scale
    if not way.any():
        way = 1e-3 * np.ptp(points, axis=0)
    return Marks(start[None], RED, vectors=way[None])


def force_arrows(points: Points, loads: Sequence[Acting], scale: float) -> Marks:
    """An arrow for each load, longer for more force, but the smallest is seen too."""
    reach = float(np.ptp(points, axis=0).max())
    varying = [_spread_arrows(points, load, reach) for load in loads if load.spread is not None]
    loads = [load for load in loads if load.spread is None]
    forces = np.array([load.force for load in loads]).reshape(-1, 3)
    lengths = np.linalg.norm(forces, axis=1, keepdims=True)
    largest = lengths.max(initial=0.0) or 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        arrows = reach * np.nan_to_num(forces / lengths) * (0.12 + 0.18 * lengths / largest)
    starts = [
        _start(points, found, found.center / scale, arrow)
        for found, arrow in zip(loads, arrows, strict=True)
    ]
    places = [np.reshape(starts, (-1, 3)), *(places for places, _ in varying)]
    vectors = [arrows, *(vectors for _, vectors in varying)]
    return Marks(np.vstack(places), RED, vectors=np.vstack(vectors))


def _spread_arrows(points: Points, load: Acting, reach: float) -> tuple[Points, Points]:
    """Starts and arrows over a face whose traction varies: a push ends on it, a pull begins."""
    assert load.spread is not None
    rows = np.arange(0, len(load.facets), -(-len(load.facets) // _MOST_ARROWS))
    places, traction = points[load.facets[rows]].mean(axis=1), load.spread[rows]
    largest = float(np.linalg.norm(traction, axis=1).max(initial=0.0)) or 1.0
    arrows = 0.2 * reach / largest * traction
    outward = area_vectors(points, load.facets[rows])
    is_push = np.einsum("ij,ij->i", outward, arrows) < 0.0
    return np.where(is_push[:, None], places - arrows, places), arrows


def _start(points: Points, load: Acting, center: Points, arrow: Points) -> Points:
    """Where an arrow begins that is clear of the body: a push ends on it, a pull begins there."""
    length = float(np.linalg.norm(arrow))
    if length == 0.0:
        return center
    direction = arrow / length
    if load.kind == "point force":
        return center - arrow
    outward = area_vectors(points, load.facets).sum(axis=0)
    is_pull = bool(outward @ arrow > 0.0)
    # Where the line of the force meets the loaded part, about: what is nearest to the line.
    places = points[load.facets].mean(axis=1) if len(load.facets) else points
    along = (places - center) @ direction
    beside = np.linalg.norm(places - center - along[:, None] * direction, axis=1)
    beside[along < -1e-9 * length if is_pull else along > 1e-9 * length] = np.inf
    met = center + direction * float(along[beside.argmin()])
    return met if is_pull else met - arrow


_BOX_FACETS = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip


def tool_surface(tool: RigidTool, reach: float) -> tuple[Points, Indices]:
    """Points in the tool's frame [m] and triangles; of a plane a square of this size [m]."""
    match tool.shape:
        case SphereShape(radius):
            ball = shape_sphere(radius, edge_length=0.3 * radius)
            return ball.points, ball.facets
        case CapsuleShape(radius, half_length):
            ball = shape_sphere(radius, edge_length=0.3 * radius)
            drawn_out = np.zeros_like(ball.points)
            drawn_out[:, 2] = np.sign(np.round(ball.points[:, 2] / radius, 6)) * half_length
            return ball.points + drawn_out, ball.facets
        case BoxShape(half_widths):
            corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
            return corners * np.array(half_widths), _BOX_FACETS
        case SurfaceShape(surface):
            return surface.points, surface.facets
        case PlaneShape():
            square = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
            return 0.5 * reach * square, np.array([[0, 1, 2], [1, 3, 2]])
