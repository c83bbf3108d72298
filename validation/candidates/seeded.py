"""Any candidate with a fault seeded into what it is given, or into what it answers.

The spoiled answer goes the way of every outside result: from points or a mesh of its own to the
case's, measured anew. So a fault spoils every state that was sent, and nothing else.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.candidates.faults import (
    CannotShowError,
    Fault,
    spoil_displacement,
    spoil_problem,
    spoil_strain,
    spoil_tool_forces,
)
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.result_files import ResultFile
from palpate.validation.states import Progress, State


def with_fault(candidate: Candidate, fault: Fault) -> Candidate:
    """The candidate with a fault; the same one where the fault is none."""
    if fault is Fault.NONE:
        return candidate

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        given = spoil_problem(problem, fault)
        right = candidate.solve(given, spoil_strain(strain, fault), progress)
        result = as_result(right)
        mesh = problem.mesh if right.own is None else right.own.mesh
        if fault is Fault.INNER_NODES:
            spoiled = _spoil_inner_nodes(problem, right, result.values)
        else:
            spoiled = spoil_displacement(mesh, result.values, fault)
        forces = spoil_tool_forces(right.tool_forces, fault)
        changed = dataclasses.replace(
            result,
            values=spoiled,
            points=None if right.own is None else mesh.points,
            about=_about(dataclasses.replace(right, tool_forces=forces)),
        )
        return state_of_result(
            changed, problem, candidate.name, strain, seconds=right.seconds, details=right.details
        )

    note = f"A fault is seeded into the candidate: {fault}, {fault.meaning}."
    return dataclasses.replace(candidate, solve=solve, notes=(*candidate.notes, note))


def _spoil_inner_nodes(
    problem: Problem, right: State, values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Garbage of the size of the displacement wherever no point of the case lies."""
    if right.own is None:
        raise CannotShowError(
            f"fault {Fault.INNER_NODES}: the answer is at the case's own points and has no others"
        )
    known = {point.tobytes() for point in problem.mesh.points + 0.0}
    inner = np.array([point.tobytes() not in known for point in right.own.mesh.points + 0.0])
    spoiled = values.copy()
    size = float(np.abs(values).max())
    shape = (len(values), int(inner.sum()), 3)
    spoiled[:, inner] = np.random.default_rng(11).uniform(-size, size, shape)
    return spoiled


def on_own_mesh(candidate: Candidate) -> Candidate:
    """The candidate on the case's mesh cut in eight, which it sends with its answer.

    Its points are numbered from the last to the first: nothing but their places tells where
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
        return state_of_result(result, problem, candidate.name, strain)

    return dataclasses.replace(
        candidate, name=f"{candidate.name}, own mesh", solve=solve, notes=candidate.notes
    )


def as_result(state: State) -> ResultFile:
    """A state as a simulator would send it."""
    motion, own = state.given, state.own
    values = state.displacement[None] if motion is None else motion.displacements
    return ResultFile(
        Path("answer"),
        values if own is None else own.displacements,
        are_positions=False,
        times=None if motion is None else motion.times,
        points=None if own is None else own.mesh.points,
        cells=None if own is None else own.mesh.cells.astype(np.int64),
        about=_about(state),
    )


def _about(state: State) -> dict[str, object]:
    """What a simulator says of itself that matters to how its answer is judged."""
    about: dict[str, object] = {}
    if state.tool_forces is not None:
        about["tool_forces"] = state.tool_forces
    if state.steps is not None:
        about |= {"integrator": state.steps.integrator, "time_step": state.steps.time_step}
    if state.element is not Element.LINEAR:
        about["element"] = state.element.value
    return about
