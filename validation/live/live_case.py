"""A case that is touched: the body of a case file, a tool that the pointer moves, and the clock."""

from __future__ import annotations

import copy
import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import half_thickness
from palpate.fastsim.contact.errors import ToolTooSmallError
from palpate.fastsim.contact.explicit_tools import depth_at_start
from palpate.fastsim.explicit_body import SAFETY
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.load import CaseError, explain
from palpate.validation.case.loading_schema import ToolSpec
from palpate.validation.case.schema import CaseSpec
from palpate.validation.conversions import LENGTH
from palpate.validation.live.pointer import Clock

# The approximate length of a tick [s]: two make a frame.
TICK = 1.0 / 120.0
# Loads of a static case are applied over this time [s].
_RAMP = 0.5
# The radius of a tool where the case has none, as a multiple of the body's longest side, and at
# least of the largest gap between vertices: contact acts on vertices alone, and a ball of 1.5 gaps
# sinks in by little more than a quarter of a gap, a smaller one by far more.
_RADIUS, _GAPS = 0.12, 1.5
# The radius of a patch that is grabbed, in the same terms: it contains some vertices.
_PATCH, _GAPS_OF_PATCH = 0.15, 1.5
# A tool that begins in the body by averages is moved back by so many times its depth, and this part
# of the longest side, so many times at most: averages of distances grow nearly as these do.
_FARTHER, _LEAST_BACK, _MOST_MOVES_BACK = 1.1, 1e-6, 20
# The keys of a case's own tool that the page's tool takes over.
_OF_SHAPE = {"shape", "radius", "half_length", "half_widths", "surface", "contact"}
# Initial distance of the tool from the body, as a fraction of the longest side.
_AWAY = 0.06
# Damping where the case states none, as a fraction of the lowest shear wave's frequency.
_DAMPING_RATIO = 0.5
# Keys of a static case that have no meaning in a motion, or that belong to its own loads.
_LEFT_OUT = ("check", "truth", "evidence", "published", "tool", "time")


@dataclass(frozen=True)
class Touch:
    """How a case is touched.

    Attributes:
        tool: The tool's table of a case file, without poses, in the case's unit; None takes the
            case's own tool at its start, or a sphere as `tool_table` makes it.
        has_loads: Whether the case's own loads act.
        mass_damping: [1/s]; None takes the case's, or half of critical for the lowest shear wave.
        is_condensed: Whether the condensed linear model is touched beside the stepped bodies.
    """

    tool: dict[str, Any] | None = None
    has_loads: bool = False
    mass_damping: float | None = None
    is_condensed: bool = False


@dataclass(frozen=True, eq=False)
class LiveCase:
    """A case that is touched.

    Attributes:
        case: The case as it was read.
        data: The tables of its file, with the page's tool at its start, and a time of one tick.
        problem: The problem in SI units, which is stepped a tick at a time.
        clock: The time step and the tick.
        start: Start of the tool, in the case's unit, shape (3,).
        outwards: Unit vector away from the body there, shape (3,).
        has_loads: Whether the case's own loads and springs act.
        notes: A sentence for each choice that was made for the case.
    """

    case: Case
    data: dict[str, Any]
    problem: Problem
    clock: Clock
    start: Floats
    outwards: Floats
    has_loads: bool
    notes: tuple[str, ...]

    @property
    def unit(self) -> float:
        """The case's unit of length [m]."""
        return LENGTH[self.case.spec.units.length]

    def metres(self, position: Floats) -> Floats:
        """A position in the case's unit as one in metres, shape (3,)."""
        x, y, z = position
        return np.array(self.case.spec.units.lengths((x, y, z)))

    def described(self) -> dict[str, Any]:
        """What the page says of the case."""
        mesh = self.problem.mesh
        return {
            "time_step": self.clock.time_step,
            "tick": self.clock.tick,
            "damping": self.data["time"]["mass_damping"],
            "cells": mesh.num_cells,
            "points": mesh.num_points,
            "notes": list(self.notes),
        }

    def with_path(self, positions: list[Floats]) -> dict[str, Any]:
        """The tables with the tool's positions at each tick from the start, shape (3,) each."""
        data = copy.deepcopy(self.data)
        tick = self.clock.tick
        first = data["tool"][0]["pose"][0]
        data["tool"][0]["pose"] = [
            {**first, "time": number * tick, "position": position.tolist()}
            for number, position in enumerate(positions)
        ]
        data["time"]["end_time"] = (len(positions) - 1) * tick
        return data


def tool_table(case: Case, shape: str | None, radius: float | None) -> dict[str, Any] | None:
    """The table of a tool, from the name of its shape or from a file; None for the case's own.

    Args:
        case: The case; a surface file lies beside the case's file.
        shape: "sphere", "capsule" (six times as long as thick), or a file of a closed surface.
        radius: In the case's unit; None takes 0.12 of the body's longest side,
            or 1.5 times the largest gap between vertices where that is larger.

    Raises:
        InputError: The radius is not a positive number, or is given together with a surface.
    """
    if radius is not None and not (math.isfinite(radius) and radius > 0.0):
        raise InputError(f"radius = {radius:g}: needs a value above 0")
    if shape is None and radius is None:
        return None
    if shape not in (None, "sphere", "capsule"):
        if radius is not None:
            raise InputError(f"a radius goes with a sphere or a capsule, not with {shape}")
        return {"shape": "surface", "surface": shape}
    if radius is None:
        radius = _default_radius(case)
    if shape == "capsule":
        return {"shape": shape, "radius": radius, "half_length": 5.0 * radius}
    return {"shape": "sphere", "radius": radius}


def _default_radius(case: Case) -> float:
    """The radius of a tool where none is given, in the case's unit."""
    mesh = case.mesh.mesh
    side = float(np.ptp(mesh.points, axis=0).max())
    radius = max(_RADIUS * side, _GAPS * _largest_gap(mesh)) / LENGTH[case.spec.units.length]
    unit = 10.0 ** (math.floor(math.log10(radius)) - 1)
    return float(f"{math.ceil(radius / unit) * unit:.2g}")


def patch_radius(mesh: TetMesh) -> float:
    """The radius of a patch that is grabbed, unless the page states another [m]."""
    side = float(np.ptp(mesh.points, axis=0).max())
    return max(_PATCH * side, _GAPS_OF_PATCH * _largest_gap(mesh))


def _largest_gap(mesh: TetMesh) -> float:
    """The largest circumradius of a boundary facet [m]."""
    corners = mesh.points[mesh.boundary_facets]
    a, b, c = (np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(3))
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float((a * b * c / (2.0 * np.linalg.norm(sides, axis=1))).max())


def live_case(case: Case, touch: Touch, elements: tuple[Element, ...]) -> LiveCase:
    """Prepare a case to be touched.

    Args:
        case: Static or a motion; of its own tools only the shape is used.
        touch: The page's tool, and what else acts.
        elements: The elements that are stepped; all take the shortest of their stable steps.

    Raises:
        InputError: The case cannot be touched; it has slanted supports, for instance.
        ToolTooSmallError: The tool would pass between the vertices of the surface.
    """
    _require_touchable(case)
    unit = LENGTH[case.spec.units.length]
    data = parse_toml(case.text)
    span, notes = case.spec.time, []
    given = case.spec.tool[0] if case.spec.tool else None
    for key in _LEFT_OUT:
        data.pop(key, None)
    if not touch.has_loads:
        data.pop("load", None)
        data.pop("spring", None)
    elif span is None:
        ramp = {"times": [0.0, _RAMP], "factors": [0.0, 1.0], "smooth": True}
        data["load"] = [{"amplitude": ramp, **load} for load in data.get("load", [])]
    points = case.mesh.mesh.points / unit
    low, high = points.min(axis=0), points.max(axis=0)
    side = float((high - low).max())
    axis = _free_side(case.problem)
    outwards = np.eye(3)[axis]
    tool, turn = touch.tool, None
    if tool is None and given is not None:
        tool = given.model_dump(mode="json", exclude_unset=True, include=_OF_SHAPE)
        start, turn, outwards = _begin_of(given, outwards)
    else:
        tool = tool or {"shape": "sphere", "radius": _default_radius(case)}
        away = 0.5 * (high - low) + _reach(tool, axis, side) + _AWAY * side
        start = 0.5 * (low + high) + outwards * away
    start = np.round(start, 9)
    pose = {"time": 0.0, "position": start.tolist(), **({"rotation": turn} if turn else {})}
    tool = {**tool, "pose": [pose]}
    damping = touch.mass_damping
    if damping is None and span is not None:
        damping = span.mass_damping
    if damping is None:
        damping = _damping_of(case.problem)
        notes.append(
            f"The case says no damping: {damping:g} /s here, half of critical for a shear wave "
            "across the body."
        )
    if span is not None and span.stiffness_damping:
        notes.append("The case's stiffness damping is left out here.")
    data["tool"] = [tool]
    data["time"] = {"end_time": 1.0, "mass_damping": damping}
    trial = problem_of(case, data)
    largest = min(
        Body.of(trial, Strain.GREEN, element=element).critical_time_step() for element in elements
    )
    clock = Clock.of(SAFETY * largest, TICK)
    data["time"] = {
        "end_time": clock.tick,
        "time_step": clock.time_step,
        "mass_damping": damping,
        "num_outputs": 1,
    }
    problem = problem_of(case, data)
    # A case's own tool may begin at the body, as deep in it by averages over facets.
    for _ in range(_MOST_MOVES_BACK):
        depth = depth_at_start(problem)
        if not depth > 0.0:
            break
        start = np.round(start + outwards * (_FARTHER * depth / unit + _LEAST_BACK * side), 9)
        pose["position"] = start.tolist()
        problem = problem_of(case, data)
    thin, gap = half_thickness(problem.tools[0].shape), _largest_gap(case.mesh.mesh)
    if thin < gap:
        raise ToolTooSmallError(0, thin, gap)
    return LiveCase(case, data, problem, clock, start, outwards, touch.has_loads, tuple(notes))


def problem_of(case: Case, data: dict[str, Any]) -> Problem:
    """The problem of changed tables, on the case's own mesh.

    Raises:
        CaseError: The tables do not describe a case.
    """
    try:
        spec = CaseSpec.model_validate(data)
    except ValidationError as error:
        raise CaseError(explain(case.path, case.text, data, error)) from error
    changed = dataclasses.replace(case, spec=spec)
    changed.__dict__["mesh"] = case.mesh
    return changed.problem


def _free_side(problem: Problem) -> int:
    """The axis on whose upper end the fewest points are fixed; the first view is across it."""
    points = problem.mesh.points
    fixed = [support.points for support in problem.supports]
    if not fixed:
        return 2
    low, high = points.min(axis=0), points.max(axis=0)
    position = (points[np.concatenate(fixed)].mean(axis=0) - low) / (high - low)
    return 2 if position[2] < 0.45 else int(np.argmin(position))


def _begin_of(tool: ToolSpec, outwards: Floats) -> tuple[Floats, dict[str, Any] | None, Floats]:
    """Start and rotation of a case's own tool, and the outward direction from there."""
    first = np.array(tool.pose[0].position)
    turn = tool.pose[0].rotation
    ways = [first - np.array(pose.position) for pose in tool.pose[1:]]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    back = next((way / length for way, length in zip(ways, lengths, strict=True) if length), None)
    table = None if turn is None else turn.model_dump(mode="json")
    return first, table, outwards if back is None else back


def _reach(tool: dict[str, Any], axis: int, side: float) -> float:
    """How far a tool reaches from its origin along an axis, in the case's unit."""
    match tool:
        case {"shape": "box", "half_widths": widths}:
            return float(widths[axis])
        case {"shape": "capsule", "radius": radius, "half_length": half}:
            return float(radius + (half if axis == 2 else 0.0))
        case {"radius": radius}:
            return float(radius)
        case _:
            return 0.5 * side


def _damping_of(problem: Problem) -> float:
    """Half of critical, 2 zeta omega, for a shear wave of twice the body's longest side [1/s]."""
    material = problem.material
    mu = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))
    side = float(np.ptp(problem.mesh.points, axis=0).max())
    omega = math.pi * math.sqrt(mu / material.density) / side
    return float(f"{2.0 * _DAMPING_RATIO * omega:.2g}")


def _require_touchable(case: Case) -> None:
    """Refuse a case that no tool can touch."""
    if any(support.normal is not None for support in case.problem.supports):
        raise InputError(
            f"{case.name}: a tool and a support along a slanted normal do not go together; turn "
            "the body so that the plane's normal is x, y or z"
        )
