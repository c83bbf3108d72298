"""Metrics of strain, local volume, forces and energy between two states on the case's mesh."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.field_norms import SMALLEST_CHANGE
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics.body import body_of, shape_gradients
from palpate.validation.metrics.finite import measurable_rows, smallest
from palpate.validation.metrics.pairs import Difference, ratio
from palpate.validation.states import State


def gradient_norm(mesh: TetMesh, displacement: Points) -> float:
    """H1 seminorm: L2 norm of the displacement gradient over the rest volume [m^1.5]."""
    gradients = displacement[mesh.cells].transpose(0, 2, 1) @ shape_gradients(mesh)
    squared = np.einsum("cij,cij->c", gradients, gradients)
    return math.sqrt(float(signed_volumes(mesh.points, mesh.cells) @ squared))


def displacement_h1(problem: Problem, candidate: State, reference: State) -> Difference:
    """Relative H1 error: of the displacement's gradient, so of local strain and rotation."""
    scale = gradient_norm(problem.mesh, reference.displacement)
    error = gradient_norm(problem.mesh, candidate.displacement - reference.displacement)
    return ratio(error, scale, "H1 seminorm of the reference's displacement")


def energy_norm(problem: Problem, candidate: State, reference: State) -> Difference:
    """Error in the energy norm of linear elasticity: strain errors weighted by stiffness."""
    error = candidate.displacement - reference.displacement
    energy_of = body_of(problem, Strain.LINEAR).energy
    scale, value = (math.sqrt(2.0 * energy_of(u)) for u in (reference.displacement, error))
    return ratio(value, scale, "energy norm of the reference's displacement")


def local_volume(problem: Problem, candidate: State, reference: State) -> Difference:
    """Root mean square error of det F over the cells, by rest volume.

    Total volume can be right where half of the body is swollen and half is squeezed.
    """
    mesh = problem.mesh
    rest = signed_volumes(mesh.points, mesh.cells)
    found = det_f(mesh, candidate.displacement) - det_f(mesh, reference.displacement)
    change = det_f(mesh, reference.displacement) - 1.0
    error = math.sqrt(float(rest @ found**2 / rest.sum()))
    scale = math.sqrt(float(rest @ change**2 / rest.sum()))
    name = "root mean square of the reference's det F - 1"
    if scale < SMALLEST_CHANGE:
        scale, name = SMALLEST_CHANGE, "0.1 % of the rest volume"
    return ratio(error, scale, name)


def tool_force(problem: Problem, candidate: State, reference: State) -> Difference:
    """Largest error of the force on a tool: at the end of its path, or over time.

    In motion of its means from output to output: with rigid contact the force of a single step
    chatters. Infinite where a simulator does not tell the force on each tool of the problem.
    """
    del problem
    name = "largest force of the reference on a tool"
    ours, theirs = candidate.tool_forces, reference.tool_forces
    if ours is None or theirs is None or ours.shape != theirs.shape or not len(theirs):
        return Difference(math.inf, math.nan, name)
    error = np.linalg.norm(ours - theirs, axis=-1).max()
    return ratio(float(error), float(np.linalg.norm(theirs, axis=-1).max()), name)


def det_f(mesh: TetMesh, displacement: Points) -> Points:
    """Volume ratio of each cell [-], (num_cells,); NaN where a corner cannot be measured."""
    rest = signed_volumes(mesh.points, mesh.cells)
    with np.errstate(over="ignore", invalid="ignore"):
        moved: Points = signed_volumes(mesh.points + displacement, mesh.cells) / rest
    moved[~measurable_rows(displacement)[mesh.cells].all(axis=1)] = math.nan
    return moved


@dataclass(frozen=True)
class Worst:
    """A count or a ratio of the worst of all states that were given, and its time [s]."""

    value: float
    time: float | None = None

    @property
    def when(self) -> str:
        """Where in time, for people; "" in statics."""
        return "" if self.time is None else f" at {self.time:.4g} s"


def shapes(mesh: TetMesh, state: State) -> Iterator[tuple[float | None, TetMesh, Points]]:
    """Every state that was given, not the compared ones alone: its time, mesh and displacement.

    On the mesh it was given on: the candidate's own, or else the case's.
    """
    motion = state.given
    own = state.own
    where = mesh if own is None else own.mesh
    if motion is None:
        yield None, where, state.displacement if own is None else own.displacements[-1]
        return
    displacements = motion.displacements if own is None else own.displacements
    for time, displacement in zip(motion.times, displacements, strict=True):
        yield float(time), where, displacement


def inverted_cells(mesh: TetMesh, displacement: Points) -> int:
    """Cells whose det F is not above 0, or no number."""
    return int((~(det_f(mesh, displacement) > 0.0)).sum())


def most_inverted(mesh: TetMesh, state: State) -> Worst:
    """Most cells turned inside out in any state that was given."""
    most = max(
        (Worst(inverted_cells(where, u), time) for time, where, u in shapes(mesh, state)),
        key=lambda worst: worst.value,
    )
    return most if most.value else Worst(0)


def smallest_det_f(mesh: TetMesh, state: State) -> Worst:
    """Smallest volume ratio of a cell in any state; minus infinity where one is no number."""
    return min(
        (Worst(smallest(det_f(where, u)), time) for time, where, u in shapes(mesh, state)),
        key=lambda worst: worst.value,
    )


def energy(problem: Problem, candidate: State, reference: State) -> Difference:
    """Error of the strain energy by the case's law."""
    of = [
        body_of(problem, s.strain, s.element).energy(s.displacement) for s in (candidate, reference)
    ]
    return ratio(abs(of[0] - of[1]), of[1], "the reference's strain energy")


def reaction_force(problem: Problem, candidate: State, reference: State) -> Difference:
    """Largest error of a support's total force, over the largest force of a support."""
    of = [
        body_of(problem, s.strain, s.element).support_reactions(s.displacement)
        for s in (candidate, reference)
    ]
    error = float(np.linalg.norm(of[0] - of[1], axis=1).max(initial=0.0))
    scale = float(np.linalg.norm(of[1], axis=1).max(initial=0.0))
    return ratio(error, scale, "the largest support force of the reference")
