"""How far stress, forces and energy of the true body are from those of the case's polyhedron.

Stress by means over the case's cells, those of the true body over the cells that were cut from
them and moved; the force of a support, or through a cut, of each body by its own loads.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Problem
from palpate.meshes.refinement import at_refined_points, mean_over_parents
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.metrics import Part, measure, stress_integrals
from palpate.validation.metrics.numbers import reaction, strain_energy
from palpate.validation.metrics.stress import resultant, scale_of_force
from palpate.validation.references.adaptive_truth import ENERGY
from palpate.validation.references.sequences import at_points_of
from palpate.validation.states import State, StressIntegrals

Solved = tuple[Problem, State]


def compare_stresses(
    problem: Problem, base: Solved, other: Solved, named: Mapping[str, Part]
) -> dict[str, float]:
    """By name of a part, and for the energy, the difference over the metric's scale [-].

    Args:
        problem: The case's.
        base: The polyhedron, on the case's cells or on those cut in eight, and its state there.
        other: The true body on the same cells.
        named: Parts of the case's mesh by the name of their bar.
    """
    pair = [_told(*solved) for solved in (base, other)]
    energies = [_energy(*solved) for solved in pair]
    found = {ENERGY: _ratio(abs(energies[1] - energies[0]), energies[0])}
    for name, part in named.items():
        if len(part.cells):
            states = [_over_cells(problem, *solved) for solved in pair]
            found[name] = measure("stress_l2", problem, states[1], states[0], part).value
        else:
            forces = [_force(problem, *solved, part) for solved in pair]
            scale, _ = scale_of_force(*pair[0])
            found[name] = _ratio(float(np.linalg.norm(forces[1] - forces[0])), scale)
    return found


def _told(problem: Problem, state: State) -> Solved:
    """With integrals where the state has stresses only."""
    if state.integrals is not None or state.stresses is None:
        return problem, state
    return problem, dataclasses.replace(
        state, integrals=stress_integrals(problem.mesh, state.stresses)
    )


def _energy(problem: Problem, state: State) -> float:
    of_cells = dataclasses.replace(state, integrals=None) if state.degree == 1 else state
    found = strain_energy(problem, of_cells, Part(np.zeros(0, np.int32), np.zeros((0, 3))), "")
    return 0.0 if found is None else found.value


def _over_cells(problem: Problem, own: Problem, state: State) -> State:
    """The state at the case's points, its stress by means over the case's cells."""
    assert state.integrals is not None
    sigma: Floats = state.integrals.cauchy
    if len(sigma) != problem.mesh.num_cells:
        volumes = signed_volumes(own.mesh.points, own.mesh.cells)[:, None, None]
        sigma = mean_over_parents(volumes * sigma) / mean_over_parents(volumes)
    kept = StressIntegrals(sigma, np.zeros_like(problem.mesh.points))
    return dataclasses.replace(at_points_of(problem.mesh, state, state.label), integrals=kept)


def _force(problem: Problem, own: Problem, state: State, part: Part) -> Floats:
    """Of a support what it exerts on the body, pressures on its points left out; of a cut [N]."""
    assert state.integrals is not None
    if part.support is not None:
        return np.array([reaction(own, state, part, axis).value for axis in "xyz"])
    is_cut = len(part.weights) != own.mesh.num_points
    weights = at_refined_points(problem.mesh, part.weights) if is_cut else part.weights
    force: Floats = resultant(own, state.integrals, dataclasses.replace(part, weights=weights))
    return force


def _ratio(apart: float, scale: float) -> float:
    return apart / scale if scale > 0.0 else (0.0 if apart == 0.0 else float("inf"))
