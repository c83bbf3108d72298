"""Layers that a rigid body is pressed into without friction, in plane strain: a plate and a
cylinder.

The section is solved in two dimensions (`plane`), with contact at Gauss's points of its edges, by
penalty with augmentation, on quadrilaterals graded to where the contact ends; the truth has a tool
that its nodes touch, in three dimensions between smooth walls. The plate covers the whole top of a
body that is bonded below and free beside: there the answer is that of a side whose height is given.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration_recipe.answers import Answer
from calibration_recipe.extruded import answer_of_levels
from calibration_recipe.plane import Cylinder, Plane, PlaneLoads, PlaneNotConvergedError, Section
from palpate.meshes.arrays import Floats
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import CapsuleShape, PlaneShape, RigidTool, ToolPath

_LENGTH, _WIDTH, _HEIGHT = 1.0, 0.25, 0.5
# Of the contact's pressure per depth, over E; steps down, and rounds at the end.
_PENALTY, _STEPS, _ROUNDS, _CLOSED = 1e4, 8, 10, 1e-6
_LEVELS = ((4, 2), (5, 3), (6, 4))
_LEVELS_OF_CONTACT = ((4, 1), (5, 2))
_HALF = np.sqrt(0.5)


def pressed_problem(
    *, tool: str, law: str, nu: float, depth: float, radius: float
) -> tuple[Problem, Strain, Answer | None]:
    """A layer of Young's modulus 1 Pa, bonded below, and its answer.

    Args:
        tool: "plate" on the whole top, the far side free; or "cylinder", with a smooth wall there.
        law: "linear" for linear strain, or that of a `Material`.
        nu: Poisson's ratio.
        depth: That it is pressed in [m], of a height of 0.5 m.
        radius: Of the cylinder [m].
    """
    mesh = brick_box((6, 1, 3), (_LENGTH, _WIDTH, _HEIGHT))
    strain = Strain.LINEAR if law == "linear" else Strain.GREEN
    material = Material(1.0, nu, 1.0)
    if law != "linear":
        material = replace(material, law=Law(law))
    is_plate = tool == "plate"
    walls = ((0, 0.0), (1, 0.0), (1, _WIDTH), *(() if is_plate else ((0, _LENGTH),)))
    supports = (support_of(side(mesh, 2, 0.0)), *rollers(mesh, walls))
    top = side(mesh, 2, _HEIGHT)
    if is_plate:
        # Turned about x: its outward normal, z of its frame, looks down.
        rotation, start = [0.0, 1.0, 0.0, 0.0], _HEIGHT
        shape: PlaneShape | CapsuleShape = PlaneShape()
    else:
        # Its axis, z of its frame, along y.
        rotation, start = [_HALF, -_HALF, 0.0, 0.0], _HEIGHT + radius
        shape = CapsuleShape(radius, 4.0)
    middle = 0.5 * _WIDTH
    path = ToolPath(
        np.array([0.0, 1.0]),
        np.array([[0.0, middle, start + 1e-6], [0.0, middle, start - depth]]),
        np.array([rotation, rotation]),
    )
    problem = Problem(
        mesh, material, supports, (), tools=(RigidTool(shape, path, contact_facets=top),)
    )
    fixed, slides, lines = {"under": _stay, "near": _stay}, {"near": 0}, [0.0, _LENGTH]
    cylinder = None
    if is_plate:
        fixed["top"] = lambda X, s: np.broadcast_to([0.0, -s * depth], X.shape)
        slides["top"] = 1
    else:
        fixed["far"], slides["far"] = _stay, 0
        cylinder = Cylinder(np.array([0.0, _HEIGHT + radius - depth]), radius, _PENALTY)
    loads = PlaneLoads(fixed, slides=slides, cylinder=cylinder)
    if cylinder is not None:
        lines.insert(1, _end_of_contact(material, strain, loads))
    section = _section(np.array(lines))

    def solve(plane: Plane, start: Floats | None) -> Floats:
        return settled(plane) if loads.cylinder is not None else plane.solve(start)

    grid, levels = mesh.points[:, ::2], _LEVELS if is_plate else _LEVELS_OF_CONTACT
    answer = answer_of_levels(section, problem, strain, loads, grid, _WIDTH, levels, solve)
    return problem, strain, answer


def _stay(X: Floats, factor: float) -> Floats:
    del factor
    return np.zeros_like(X)


def _section(lines: Floats) -> Section:
    is_solid = np.ones((len(lines) - 1, 1), dtype=bool)
    return Section(lines, np.array([0.0, _HEIGHT]), is_solid, lambda grid: grid)


def settled(plane: Plane, height: float = _HEIGHT) -> Floats:
    """Equilibrium without a place inside the cylinder, which comes down in steps."""
    cylinder = plane.loads.cylinder
    assert cylinder is not None
    u, goal = np.zeros_like(plane.positions), cylinder.centre.copy()
    cylinder.pressure = None
    for part in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
        lifted = (1.0 - part) * (height + cylinder.radius - goal[1])
        cylinder.centre = goal + np.array([0.0, lifted])
        u = plane.solve(u)
    for _ in range(_ROUNDS):
        if plane.augment(u) < _CLOSED:
            return u
        u = plane.solve(u)
    raise PlaneNotConvergedError(f"places are inside the cylinder after {_ROUNDS} rounds")


def _end_of_contact(material: Material, strain: Strain, loads: PlaneLoads) -> float:
    """Where on the top the contact ends, by an even grid without corners there [m]."""
    lines = np.linspace(0.0, _LENGTH, 21)
    plane = Plane(_section(lines), material, strain, loads, degree=3, layers=1)
    plane.augment(settled(plane))
    assert loads.cylinder is not None
    assert loads.cylinder.pressure is not None
    of = plane.elements[plane.on["top"]][:, plane.edges["top"]]
    x = (plane.touch_value @ plane.positions[of])[:, :, 0]
    return float(x[loads.cylinder.pressure > 0.0].max())
