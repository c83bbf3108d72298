"""Faults that are seeded into a candidate, to show that the gates see them.

Each is one mistake that simulators are known for: in the problem, in the law, or in the result. The
corrupted result goes the way of every outside result: from points or a mesh of its own to the
case's, measured anew. So a fault corrupts every state that was sent, and nothing else.
"""

from __future__ import annotations

import dataclasses
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.rigid_tool import ContactRule
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import scale_loads
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.result_files import ResultFile
from palpate.validation.states import Progress, State


class CannotShowError(InputError):
    """A fault of what a case or its result has not; the message says where it shows."""


class Fault(StrEnum):
    """Faults that can be seeded into a candidate; each has its `meaning`."""

    meaning: str

    NONE = "none", "nothing is corrupted"
    SOFTER = "softer", "Young's modulus 2 % too small"
    SWAPPED_LAME = "swapped-lame", "Lame's two parameters exchanged"
    WRONG_MASS = "wrong-mass", "density 2 % too large, the weight as it was"
    NO_DAMPING = "no-damping", "damping left out"
    DROPPED_LOAD = "dropped-load", "the last load left out"
    REVERSED_LOAD = "reversed-load", "every load the other way"
    DROPPED_TOOL = "dropped-tool", "the last tool left out"
    REVERSED_TOOL_FORCE = "reversed-tool-force", "the force on each tool the other way"
    VERTICES_ONLY = "vertices-only", "contact at vertices in place of facets"
    MIRRORED = "mirrored", "y of the result has the wrong sign"
    MIRRORED_MESH = "mirrored-mesh", "the body solved in the mirror"
    LINEAR_INSTEAD_OF_GREEN = "linear-instead-of-green", "linear strain in place of Green's"
    INVERTED_CELL = "inverted-cell", "one cell of the result turned inside out"
    INNER_NODES = "inner-nodes", "garbage between the points of the case"
    UNIT_ERROR = "unit-error", "millimetres sent as metres"
    SHIFTED_NUMBERS = "shifted-numbers", "points numbered one off"
    LAST_STATE_REPEATED = "last-state-repeated", "the last state sent for every time"
    EVERY_SECOND_STATE = "every-second-state", "every second state is the body at rest"
    LATE = "late", "every state sent one output too late"
    NAN = "nan", "not a number at one point"

    def __new__(cls, value: str, meaning: str) -> Fault:
        """A fault by its name, with one line on what it is."""
        fault = str.__new__(cls, value)
        fault._value_ = value
        fault.meaning = meaning
        return fault


# They corrupt what only a motion has.
OF_MOTION = (
    Fault.WRONG_MASS, Fault.NO_DAMPING, Fault.LAST_STATE_REPEATED, Fault.EVERY_SECOND_STATE,
    Fault.LATE,
)  # fmt: skip
OF_LOADS = (Fault.DROPPED_LOAD, Fault.REVERSED_LOAD)
OF_TOOLS = (Fault.DROPPED_TOOL, Fault.REVERSED_TOOL_FORCE)
OF_FACETS = (Fault.VERTICES_ONLY,)


def corrupt_problem(problem: Problem, fault: Fault) -> Problem:
    """The problem as the faulty candidate understands it.

    Raises:
        CannotShowError: A fault of motion in a static problem, or of loads or tools where there
            are none: nothing would be corrupted.
    """
    over_facets = any(tool.contact is ContactRule.FACETS for tool in problem.tools)
    for faults, is_there, key, others in (
        (OF_MOTION, problem.time, "[time]", "block-motion or wave"),
        (OF_LOADS, problem.loads, "[[load]]", "beam"),
        (OF_TOOLS, problem.tools, "[tool]", "press or slide"),
        (OF_FACETS, over_facets, 'contact = "facets"', "press or slide"),
    ):
        if fault in faults and not is_there:
            raise CannotShowError(
                f"fault {fault}: a case without {key} cannot show it; try {others}"
            )
    material = problem.material
    E, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    match fault:
        case Fault.SOFTER:
            return dataclasses.replace(problem, material=Material(0.98 * E, nu, rho))
        case Fault.SWAPPED_LAME:
            if not nu > 0.0:
                raise CannotShowError(
                    f"fault {fault}: at a Poisson's ratio of {nu:g} lmbda is not above 0, "
                    "which as mu makes no body; try block"
                )
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
            span = dataclasses.replace(problem.time, mass_damping=0.0, stiffness_damping=0.0)
            return dataclasses.replace(problem, time=span)
        case Fault.DROPPED_LOAD:
            return dataclasses.replace(problem, loads=problem.loads[:-1])
        case Fault.DROPPED_TOOL:
            return dataclasses.replace(problem, tools=problem.tools[:-1])
        case Fault.VERTICES_ONLY:
            at = ContactRule.VERTICES
            tools = tuple(dataclasses.replace(tool, contact=at) for tool in problem.tools)
            return dataclasses.replace(problem, tools=tools)
        case Fault.REVERSED_LOAD:
            return scale_loads(problem, -1.0)
        case Fault.MIRRORED_MESH:
            points = problem.mesh.points * np.array([1.0, -1.0, 1.0])
            cells = problem.mesh.cells[:, [0, 2, 1, 3]]
            return dataclasses.replace(problem, mesh=TetMesh(points, cells))
        case _:
            return problem


def corrupt_strain(strain: Strain, fault: Fault) -> Strain:
    """The strain measure that the faulty candidate uses."""
    return Strain.LINEAR if fault is Fault.LINEAR_INSTEAD_OF_GREEN else strain


def corrupt_displacement(
    mesh: TetMesh, displacement: NDArray[np.float64], fault: Fault
) -> NDArray[np.float64]:
    """The displacement as the faulty candidate writes it, (num_times, num_points, 3)."""
    corrupted = displacement.copy()
    match fault:
        case Fault.MIRRORED:
            corrupted[..., 1] *= -1.0
        case Fault.UNIT_ERROR:
            corrupted *= 1000.0
        case Fault.SHIFTED_NUMBERS:
            corrupted = np.roll(displacement, 1, axis=-2)
        case Fault.NAN:
            corrupted[..., displacement.shape[-2] // 2, 0] = np.nan
        case Fault.LAST_STATE_REPEATED:
            corrupted[:] = displacement[-1]
        case Fault.EVERY_SECOND_STATE:
            corrupted[1:-1:2] = 0.0
        case Fault.LATE:
            corrupted[1:] = displacement[:-1]
        case Fault.INVERTED_CELL:
            cell = int(signed_volumes(mesh.points, mesh.cells).argmin())
            corner, *others = mesh.cells[cell]
            # A little beyond the opposite facet: that cell alone has to turn inside out.
            moved = (mesh.points + displacement)[..., others, :].mean(axis=-2)
            own = (mesh.points + displacement)[..., corner, :]
            corrupted[..., corner, :] += 1.05 * (moved - own)
        case _:
            pass
    return corrupted


def corrupt_tool_forces(
    forces: NDArray[np.float64] | None, fault: Fault
) -> NDArray[np.float64] | None:
    """The forces on the tools as the faulty candidate writes them."""
    if forces is None:
        return None
    corrupted = forces.copy()
    match fault:
        case Fault.REVERSED_TOOL_FORCE:
            corrupted *= -1.0
        case Fault.LAST_STATE_REPEATED:
            corrupted[:] = forces[:, -1:]
        case Fault.LATE:
            corrupted[:, 1:], corrupted[:, 0] = forces[:, :-1], 0.0
        case _:
            pass
    return corrupted


def with_fault(candidate: Candidate, fault: Fault) -> Candidate:
    """The candidate with a fault; the same one where the fault is none."""
    if fault is Fault.NONE:
        return candidate

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        given = corrupt_problem(problem, fault)
        right = candidate.solve(given, corrupt_strain(strain, fault), progress)
        result = as_result(right)
        mesh = problem.mesh if right.own is None else right.own.mesh
        if fault is Fault.INNER_NODES:
            corrupted = _corrupt_inner_nodes(problem, right, result.values)
        else:
            corrupted = corrupt_displacement(mesh, result.values, fault)
        forces = corrupt_tool_forces(right.tool_forces, fault)
        changed = dataclasses.replace(
            result,
            values=corrupted,
            points=None if right.own is None else mesh.points,
            about=_about(dataclasses.replace(right, tool_forces=forces)),
        )
        return state_of_result(
            changed,
            problem,
            candidate.name,
            strain,
            element=candidate.element,
            asked=candidate.asked,
            seconds=right.seconds,
            details=right.details,
        )

    note = f"A fault is seeded into the candidate: {fault}, {fault.meaning}."
    return dataclasses.replace(candidate, solve=solve, notes=(*candidate.notes, note))


def _corrupt_inner_nodes(
    problem: Problem, right: State, values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Garbage of the size of the displacement wherever no point of the case lies."""
    if right.own is None:
        raise CannotShowError(
            f"fault {Fault.INNER_NODES}: the result is at the case's own points and has no others"
        )
    known = {point.tobytes() for point in problem.mesh.points + 0.0}
    inner = np.array([point.tobytes() not in known for point in right.own.mesh.points + 0.0])
    corrupted = values.copy()
    size = float(np.abs(values).max())
    shape = (len(values), int(inner.sum()), 3)
    corrupted[:, inner] = np.random.default_rng(11).uniform(-size, size, shape)
    return corrupted


def on_own_mesh(candidate: Candidate) -> Candidate:
    """The candidate on the case's mesh cut in eight, which it sends with its result.

    Its points are numbered from the last to the first: nothing but their positions shows which
    they are.
    """

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        finer = refine_problem(problem)
        right = as_result(candidate.solve(finer, strain, progress))
        last = finer.mesh.num_points - 1
        result = dataclasses.replace(
            right,
            values=right.values[:, ::-1],
            points=finer.mesh.points[::-1].copy(),
            cells=(last - finer.mesh.cells).astype(np.int64),
        )
        return state_of_result(
            result, problem, candidate.name, strain,
            element=candidate.element, asked=candidate.asked,
        )  # fmt: skip

    return dataclasses.replace(
        candidate, name=f"{candidate.name}, own mesh", solve=solve, notes=candidate.notes
    )


def as_result(state: State) -> ResultFile:
    """A state as a simulator would send it."""
    motion, own = state.given, state.own
    values = state.displacement[None] if motion is None else motion.displacements
    return ResultFile(
        Path("result"),
        values if own is None else own.displacements,
        are_positions=False,
        times=None if motion is None else motion.times,
        points=None if own is None else own.mesh.points,
        cells=None if own is None else own.mesh.cells.astype(np.int64),
        about=_about(state),
    )


def _about(state: State) -> dict[str, object]:
    """A simulator's statements of itself that matter to how its result is judged."""
    about: dict[str, object] = dict(state.says)
    if state.tool_forces is not None:
        about["tool_forces"] = state.tool_forces
    if state.element is not Element.LINEAR:
        about.setdefault("element", state.element.value)
    return about
