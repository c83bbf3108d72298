"""Faults that are seeded into a candidate, to show that the gates see them.

Each is one slip that simulators are known for: in the problem, in the law, or in the answer.
"""

from __future__ import annotations

import dataclasses
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Traction,
)
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes


class Fault(StrEnum):
    """Faults that can be seeded into the candidate."""

    NONE = "none"
    SOFTER = "softer"
    SWAPPED_LAME = "swapped-lame"
    WRONG_MASS = "wrong-mass"
    NO_DAMPING = "no-damping"
    DROPPED_LOAD = "dropped-load"
    DROPPED_TOOL = "dropped-tool"
    REVERSED_LOAD = "reversed-load"
    MIRRORED = "mirrored"
    MIRRORED_MESH = "mirrored-mesh"
    LINEAR_INSTEAD_OF_GREEN = "linear-instead-of-green"
    TRANSPOSED_GRADIENT = "transposed-gradient"
    INVERTED_CELL = "inverted-cell"
    UNIT_ERROR = "unit-error"
    SHIFTED_NUMBERS = "shifted-numbers"
    NAN = "nan"


# What each does, a line.
FAULTS = {
    Fault.NONE: "healthy",
    Fault.SOFTER: "Young's modulus 2 % lower",
    Fault.SWAPPED_LAME: "Lame's two parameters exchanged",
    Fault.WRONG_MASS: "inertia 2 % larger, weight as it was",
    Fault.NO_DAMPING: "the damping of a motion left out",
    Fault.DROPPED_LOAD: "the last load left out",
    Fault.DROPPED_TOOL: "the last tool left out",
    Fault.REVERSED_LOAD: "every load the other way",
    Fault.MIRRORED: "the answer's y turned round",
    Fault.MIRRORED_MESH: "solved on the mirror image of the body",
    Fault.LINEAR_INSTEAD_OF_GREEN: "linear strain where Green strain is asked for",
    Fault.TRANSPOSED_GRADIENT: "the displacement gradient of a motion transposed",
    Fault.INVERTED_CELL: "one corner moved until a cell turns inside out",
    Fault.UNIT_ERROR: "the answer in millimetres, said to be metres",
    Fault.SHIFTED_NUMBERS: "the answer's rows moved on by one point",
    Fault.NAN: "one number is none",
}

# They spoil what only a motion has.
_OF_MOTION = (Fault.WRONG_MASS, Fault.NO_DAMPING, Fault.TRANSPOSED_GRADIENT)


def spoil_problem(problem: Problem, fault: Fault) -> Problem:
    """The problem as the faulty candidate understands it.

    Raises:
        InputError: A fault of motion in a static problem, or of loads or tools where there are
            none: nothing would be spoiled.
    """
    if fault in _OF_MOTION and problem.time is None:
        raise InputError(
            f"fault {fault}: a case without [time] cannot show it; try block-motion or wave"
        )
    if fault in (Fault.DROPPED_LOAD, Fault.REVERSED_LOAD) and not problem.loads:
        raise InputError(f"fault {fault}: a case without [[load]] cannot show it; try beam")
    if fault is Fault.DROPPED_TOOL and not problem.tools:
        raise InputError(f"fault {fault}: a case without [tool] cannot show it; try press or slide")
    material = problem.material
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    match fault:
        case Fault.SOFTER:
            return dataclasses.replace(problem, material=Material(0.98 * E, nu, rho))
        case Fault.SWAPPED_LAME:
            # E = mu (3 lmbda + 2 mu)/(lmbda + mu), nu = lmbda/2/(lmbda + mu), the two exchanged.
            mu, lmbda = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
            total = lmbda + mu
            swapped = Material(mu * (3.0 * lmbda + 2.0 * mu) / total, 0.5 * lmbda / total, rho)
            return dataclasses.replace(problem, material=swapped)
        case Fault.WRONG_MASS:
            # Weight is a load of its own here: only inertia changes.
            return dataclasses.replace(problem, material=Material(E, nu, 1.02 * rho))
        case Fault.NO_DAMPING:
            assert problem.time is not None
            span = dataclasses.replace(problem.time, mass_damping=0.0)
            return dataclasses.replace(problem, time=span)
        case Fault.DROPPED_LOAD:
            return dataclasses.replace(problem, loads=problem.loads[:-1])
        case Fault.DROPPED_TOOL:
            return dataclasses.replace(problem, tools=problem.tools[:-1])
        case Fault.REVERSED_LOAD:
            return dataclasses.replace(problem, loads=tuple(map(_reversed, problem.loads)))
        case Fault.MIRRORED_MESH:
            points = problem.mesh.points * np.array([1.0, -1.0, 1.0])
            cells = problem.mesh.cells[:, [0, 2, 1, 3]]
            return dataclasses.replace(problem, mesh=TetMesh(points, cells))
        case _:
            return problem


def _reversed(load: Load) -> Load:
    match load:
        case BodyForce():
            x, y, z = load.force_density
            return dataclasses.replace(load, force_density=(-x, -y, -z))
        case Traction():
            x, y, z = load.traction
            return dataclasses.replace(load, traction=(-x, -y, -z))
        case PointForce():
            return dataclasses.replace(load, forces=-load.forces)
        case Pressure():
            return dataclasses.replace(load, pressure=-load.pressure)


def spoil_strain(strain: Strain, fault: Fault) -> Strain:
    """The strain measure that the faulty candidate uses."""
    return Strain.LINEAR if fault is Fault.LINEAR_INSTEAD_OF_GREEN else strain


def spoil_displacement(
    mesh: TetMesh, displacement: NDArray[np.float64], fault: Fault
) -> NDArray[np.float64]:
    """The answer as the faulty candidate writes it; one state or many, (..., num_points, 3)."""
    match fault:
        case Fault.MIRRORED:
            mirrored: NDArray[np.float64] = displacement * np.array([1.0, -1.0, 1.0])
            return mirrored
        case Fault.UNIT_ERROR:
            return 1000.0 * displacement
        case Fault.SHIFTED_NUMBERS:
            rolled: NDArray[np.float64] = np.roll(displacement, 1, axis=-2)
            return rolled
        case Fault.NAN:
            spoiled = displacement.copy()
            spoiled[..., displacement.shape[-2] // 2, 0] = np.nan
            return spoiled
        case Fault.INVERTED_CELL:
            spoiled = displacement.copy()
            cell = int(signed_volumes(mesh.points, mesh.cells).argmin())
            corner, *others = mesh.cells[cell]
            # A little beyond the opposite facet: that cell alone has to turn inside out.
            moved = (mesh.points + displacement)[..., others, :].mean(axis=-2)
            own = (mesh.points + displacement)[..., corner, :]
            spoiled[..., corner, :] += 1.05 * (moved - own)
            return spoiled
        case _:
            return displacement
