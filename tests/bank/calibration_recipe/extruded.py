"""Bodies with clamped and re-entrant edges, extruded along y between smooth walls.

Of these the section in plane strain tells all, and that is solved in two dimensions by polynomials
of high degree (`plane`) until the answer is known to some 1e-5; how well is what the last rise of
degree and layers changed, and where such changes fall slowly, all that would follow. Edges and
their singular stresses are those of any clamped or re-entrant body; the corners where three faces
meet are not, as the walls are smooth: those has "slender".

Where a law gives way at a pressed corner (see `plane`) the finest grid that has an equilibrium, and
that the one before led to, has the word: it changes at most half of what that one did.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from calibration_recipe.answers import Answer, reported
from calibration_recipe.plane import (
    Plane,
    PlaneLoads,
    PlaneNotConvergedError,
    Section,
)
from calibration_recipe.shapes import shape_mesh
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.bricks import rollers, side, support_of
from palpate.meshes.field_norms import size_of_change
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

# Height in which a section bends, and the lines between its bricks on which corners lie.
_HEIGHT = {"box": 0.6, "cube": 1.0, "thin": 0.1, "sliver": 0.25, "bracket": 0.5, "notched": 0.5}
_LINES = {
    "bracket": ((0.0, 0.5, 1.0), (0.0, 0.5, 1.0)),
    "notched": ((0.0, 0.5, 0.75, 1.25), (0.0, 0.5, 0.75)),
}
_LEFT_OUT = {"bracket": (1, 1), "notched": (1, 1)}
# Strain far from corners; and degrees with layers, each of which begins where the last one ended.
_STRAIN = {"linear": 0.05, Law.SAINT_VENANT_KIRCHHOFF: 0.015, Law.NEO_HOOKEAN_STABLE: 0.03}
_LINEAR_LEVELS = ((4, 3), (6, 5), (8, 7))
_ROUNDING = 1e-7
_LEVELS = ((4, 2), (6, 3), (6, 4), (6, 5))


@cache
def extruded_problem(
    *, shape: str, nu: float, load: str, law: str, lean: float
) -> tuple[Problem, Strain, Answer | None]:
    """A body of Young's modulus 1 Pa, held where x is smallest, and its answer.

    Args:
        shape: "box", "cube", "thin", "sliver", or with re-entrant edges "bracket", "notched".
        nu: Poisson's ratio.
        load: "pull" or "bend" at the far end, "press" on top, "weight"; "bed": pressed and rubbed
            on top, held below instead; with the far end held as well "sag" (weight), "shift" (that
            end is moved), "turn" (it is turned).
        law: "linear" for linear strain, or that of a `Material`.
        lean: How far x moves by z: angles of 90 degrees become others.

    Returns:
        The problem, its strain measure and its answer: None where the load is more than the
        section bears.
    """
    rest = shape_mesh(shape)
    mesh = TetMesh(rest.points + lean * rest.points[:, 2:] * [1.0, 0.0, 0.0], rest.cells)
    strain = Strain.LINEAR if law == "linear" else Strain.GREEN
    material = Material(1.0, nu, 1.0)
    if law != "linear":
        material = replace(material, law=Law(law))
    top, length, width = (float(rest.points[:, k].max()) for k in (2, 0, 1))
    h, e = _HEIGHT[shape], _STRAIN[law]
    facets = {
        "near": side(rest, 0, 0.0),
        "far": side(rest, 0, length),
        "under": side(rest, 2, 0.0),
        "top": side(rest, 2, top),
    }
    base = "under" if load == "bed" else "near"
    supports: list[Support] = [support_of(facets[base]), *rollers(mesh, ((1, 0.0), (1, width)))]
    loads: tuple[Load, ...] = ()
    plane = PlaneLoads({base: _stay})
    if load in ("pull", "bend", "bed"):
        on, push = {
            "pull": ("far", (e, 0.1 * e * h**2)),
            "bend": ("far", (0.0, -e * h / 6.0)),
            "bed": ("top", (0.5 * e, -0.5 * e)),
        }[load]
        plane.tractions[on] = push
        loads = (Traction(facets[on], (push[0], 0.0, push[1])),)
    elif load == "press":
        plane.pressures["top"] = e * h**2 / 3.0
        loads = (Pressure(facets["top"], plane.pressures["top"]),)
    elif load in ("weight", "sag"):
        weight = (0.0, -e * h * (1.0 if load == "sag" else 1.0 / 3.0))
        plane = PlaneLoads(plane.fixed, body=weight)
        loads = (BodyForce((0.0, 0.0, weight[1])),)
    if load == "sag":
        plane.fixed["far"] = _stay
        supports.append(support_of(facets["far"]))
    elif load == "shift":
        moved = (0.2 * e, -min(e / (3.0 * h), 0.15))
        plane.fixed["far"] = lambda X, s: s * np.broadcast_to(moved, X.shape)
        supports.append(support_of(facets["far"], displacement=(moved[0], 0.0, moved[1])))
    elif load == "turn":
        angle = min(e / (2.0 * h), 0.4)
        on_far = np.unique(facets["far"])
        x, _, z = mesh.points[on_far].mean(axis=0).tolist()
        plane.fixed["far"] = lambda X, s: (X - (x, z)) @ (_turn(s * angle) - np.eye(2)).T
        turn = Rotation((0.0, 1.0, 0.0), (x, 0.0, z), angle)
        supports.append(Support(on_far, facets["far"], rotation=turn))
    problem = Problem(mesh, material, tuple(supports), loads)
    section = _section(shape, rest.points, lean)
    return problem, strain, _answer(section, problem, strain, plane, rest.points[:, ::2], width)


def _stay(X: Floats, factor: float) -> Floats:
    del factor
    return np.zeros_like(X)


def _turn(angle: float) -> Floats:
    """About y, right-handed, of x and z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def _section(shape: str, points: Points, lean: float) -> Section:
    whole = tuple((0.0, float(points[:, k].max())) for k in (0, 2))
    x, z = (np.array(lines) for lines in _LINES.get(shape, whole))
    is_solid = np.ones((len(x) - 1, len(z) - 1), dtype=bool)
    if shape in _LEFT_OUT:
        is_solid[_LEFT_OUT[shape]] = False
    return Section(x, z, is_solid, lambda grid: grid + lean * grid[..., 1:] * [1.0, 0.0])


def _answer(
    section: Section,
    problem: Problem,
    strain: Strain,
    loads: PlaneLoads,
    grid: Floats,
    width: float,
) -> Answer | None:
    levels = _LINEAR_LEVELS if strain is Strain.LINEAR else _LEVELS
    return answer_of_levels(section, problem, strain, loads, grid, width, levels, Plane.solve)


def answer_of_levels(
    section: Section,
    problem: Problem,
    strain: Strain,
    loads: PlaneLoads,
    grid: Floats,
    width: float,
    levels: Sequence[tuple[int, int]],
    solve: Callable[[Plane, Floats | None], Floats],
) -> Answer | None:
    """The last two levels that have an equilibrium, and what is between them; None of fewer."""
    mesh = problem.mesh
    found: list[tuple[Floats, float, float]] = []
    steps: list[float] = []
    start: tuple[Plane, Floats] | None = None
    for degree, layers in levels:
        plane = Plane(section, problem.material, strain, loads, degree=degree, layers=layers)
        near = None
        if start is not None:
            near = start[0].at(start[1], plane.grid)
        try:
            start = plane, solve(plane, near)
        except PlaneNotConvergedError:
            break
        area, outline = plane.sizes(start[1])
        moved = plane.at(start[1], grid)
        step = _apart(moved, found[-1][0]) if found else math.inf
        if len(steps) > 1 and step > max(0.5 * steps[-1], _ROUNDING):
            break
        steps.append(step)
        found.append((moved, width * area, 2.0 * area + width * outline))
    if len(found) < 2:
        return None
    moved, volume, surface_area = found[-1]
    displacements = ("displacement_l2", "displacement_max", "max_displacement")
    doubts = dict.fromkeys(displacements, _left(steps[1:]))
    for metric, rest, sizes in (
        ("volume", mesh.volume, [each[1] for each in found]),
        ("surface_area", mesh.surface_area, [each[2] for each in found]),
    ):
        scale = size_of_change(sizes[-1], rest)
        doubts[metric] = _left((np.abs(np.diff(sizes)) / scale).tolist())
    return reported(mesh, np.insert(moved, 1, 0.0, axis=1), (volume, surface_area), strain, doubts)


def _left(steps: Sequence[float]) -> float:
    """What may be left after the last step: at least that, more where they fall slowly."""
    last = steps[-1]
    if len(steps) == 1 or last <= _ROUNDING:
        return last
    fall = last / max(steps[-2], _ROUNDING)
    return last * max(1.0, fall / (1.0 - fall)) if fall < 1.0 else math.inf


def _apart(new: Floats, old: Floats) -> float:
    """Largest difference of a point over the largest displacement."""
    return float(np.linalg.norm(new - old, axis=1).max() / np.linalg.norm(new, axis=1).max())
