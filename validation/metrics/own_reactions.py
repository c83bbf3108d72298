"""Forces of the supports, from an answer on a mesh of the candidate's own.

Which of its points the candidate held is not known exactly: those between held and free points of
the case may be either. In equilibrium a free point is in balance and adds nothing, so that all of
them are summed; in motion they are not, and their forces are the doubt.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Pressure
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.nodal_arrays import fixed_components, nodal_force
from palpate.validation.exchange.point_location import locate, locate_points
from palpate.validation.metrics.body import body_of, factor_at_end, load_force
from palpate.validation.metrics.springs import spring_force
from palpate.validation.states import State

# Fractions of held points below this are rounding.
_ROUNDING = 1e-6


def own_reactions(
    problem: Problem, own: Problem, displacement: Points, candidate: State, reference: State
) -> tuple[float, float]:
    """Largest error of a support's total force, and what it may be off by [N].

    Args:
        problem: The case's.
        own: The own mesh with the case's materials.
        displacement: Of the answer on it [m].
        candidate: The answer at the case's points.
        reference: There too.
    """
    mesh, strain = own.mesh, candidate.strain
    spread = _spread(problem.mesh, mesh)
    force = body_of(own, strain, candidate.element).internal(displacement)
    is_held = fixed_components(problem)[0] > 0
    # Loads near a support, and pressure, may be put in the wrong place.
    loose = np.zeros(mesh.num_points)
    # So may a weight: an answer of the case's mesh, sent on a finer one, is balanced on its own.
    weight = np.zeros(mesh.num_points)
    for load in problem.loads:
        factor = factor_at_end(problem, load)
        if isinstance(load, BodyForce):
            body = factor * nodal_force(mesh, load)
            force -= body
            spread_body = spread(factor * nodal_force(problem.mesh, load))
            weight += np.linalg.norm(body - spread_body, axis=1)
            continue
        at_points = factor * load_force(problem.mesh, load, candidate.displacement, strain)
        loose += spread(np.linalg.norm(at_points, axis=1)[:, None])[:, 0]
        if isinstance(load, Pressure):
            # As `support_reactions` has it: not subtracted where the body is held.
            at_points = np.where(is_held, 0.0, at_points)
        force -= spread(at_points)
    time = None if problem.time is None else problem.time.end_time
    for spring in problem.springs:
        at_points = spring_force(problem.mesh, spring, candidate.displacement, time)
        loose += spread(np.linalg.norm(at_points, axis=1)[:, None])[:, 0]
        force -= spread(at_points)
    size = np.linalg.norm(force, axis=1)
    moving = np.zeros_like(size) if problem.time is None else size
    fractions = np.array([_held_fraction(problem, s.points, mesh) for s in problem.supports])
    expected = body_of(problem, reference.strain, reference.element).support_reactions(
        reference.displacement
    )
    errors, doubts = [0.0], [0.0]
    for number, support in enumerate(problem.supports):
        touched = _with_neighbours(mesh, fractions[number] > _ROUNDING)
        between = touched & (fractions[number] < 1.0 - _ROUNDING)
        onto = support.directions.T @ support.directions
        found = onto @ force[touched].sum(axis=0)
        shifted = min(weight[touched].sum(), size[between].sum())
        doubts.append(float(loose[touched].sum() + moving[between].sum() + shifted))
        # Between two supports a point's force may belong to either.
        for other, rival in enumerate(problem.supports):
            if other != number and np.any(np.abs(support.directions @ rival.directions.T) > 0.0):
                theirs = _with_neighbours(mesh, fractions[other] > _ROUNDING)
                doubts[-1] += float(size[between & theirs].sum())
        errors.append(float(np.linalg.norm(found - expected[number])))
    return float(np.max(errors)), float(np.max(doubts))


def _held_fraction(problem: Problem, points: NDArray[np.int32], own: TetMesh) -> Points:
    """How far each own point is a held one: 1 at held places, 0 where no corner is held."""
    is_held = np.zeros((problem.mesh.num_points, 1))
    is_held[points] = 1.0
    return locate_points(problem.mesh, own).read(problem.mesh.cells, is_held)[:, 0]


def _with_neighbours(own: TetMesh, is_chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A support may reach one cell farther on a coarser mesh: facets are held whole."""
    reached = is_chosen.copy()
    reached[own.cells[is_chosen[own.cells].any(axis=1)]] = True
    return reached


def _spread(case: TetMesh, own: TetMesh) -> Callable[[Points], Points]:
    location = locate(own.points, own.cells, case.points)
    corners = own.cells[location.cells]

    def spread(forces: Points) -> Points:
        """Forces at the case's points, moved to the corners of the own cells that hold them."""
        moved = np.zeros((own.num_points, forces.shape[1]))
        np.add.at(moved, corners, location.weights[:, :, None] * forces[:, None])
        return moved

    return spread
