"""The stress of another simulator, by bodies of single cells that it is asked to bring to rest.

Each cell may do all but turn and move: its first corner is fixed, the next along y and z, the third
along z, so that F is upper triangular. The dead forces on its free corners are those of the stated
law at an F; the F of the simulator's result is the one at which its own law has that
stress. A wrong law shows as another F; its error here is that of the stress at the result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.diagnosis.law_checks import (
    Finding,
    compare_stress,
    moduli_of,
    name_of_stress,
    stated_stress,
)
from palpate.validation.diagnosis.law_simulators import (
    moderate_deformations,
    nodal_forces,
    separate_cells,
)
from palpate.validation.metrics.laws import stress_change
from palpate.validation.metrics.smoothing import Array
from palpate.validation.states import Progress

# Edge of the cells [m]: of the size of soft bodies, so that a tolerance of forces that a simulator
# has as an absolute number is within reach.
_EDGE = 0.02
# Components of F that a cell is free to take, row by row.
_FREE = np.array([[1, 1, 1], [0, 1, 1], [0, 0, 1]], dtype=bool)


def check_simulator(
    simulator: OutsideSimulator, material: Material, limit: float, progress: Progress
) -> list[Finding]:
    """Compare a simulator's result with that of the law that was stated, to a limit of stress [-].

    A finding for each kind of deformation; more where it sends stresses of its own.

    Raises:
        CandidateFailedError: It gives no result.
    """
    kinds = {
        kind: stable
        for kind, F in moderate_deformations().items()
        if len(stable := F[_is_stable(F, material)])
    }
    F = np.concatenate(list(kinds.values()))
    if not len(F):
        raise InputError("no cell of this material stays where dead forces hold it")
    mesh = separate_cells(len(F), _EDGE)
    first = 4 * np.arange(len(F), dtype=np.int32)
    supports = (
        Support(first),
        Support(first + 1, components=(False, True, True)),
        Support(first + 2, components=(False, False, True)),
    )
    forces = nodal_forces(stated_stress(material, F), _EDGE)
    load = PointForce(np.arange(mesh.num_points, dtype=np.int32), forces)
    problem = Problem(mesh, material, supports, (load,))
    state = outside_candidate(simulator).solve(problem, Strain.GREEN, progress)
    found_F = _deformations_of(state.displacement / _EDGE)
    asked = stated_stress(material, F)
    found, begin = [], 0
    for kind, of in kinds.items():
        rows = slice(begin, begin + len(of))
        begin += len(of)
        found.append(_compare(asked[rows], found_F[rows], material, kind, limit))
        if state.sent_stress is not None:
            J = np.linalg.det(found_F[rows])[:, None, None]
            inverse = np.linalg.inv(found_F[rows]).transpose(0, 2, 1)
            sent = J * state.sent_stress[rows] @ inverse
            check = "stress sent"
            found.append(compare_stress(sent, material, kind, found_F[rows], limit, check))
    return found


def _compare(asked: Array, found_F: Array, material: Material, kind: str, limit: float) -> Finding:
    """Compare components that are free only: reactions are not known."""
    right = stated_stress(material, found_F)
    off = np.where(_FREE, right - asked, 0.0)
    scale = np.maximum(np.linalg.norm(asked, axis=(1, 2)), 0.01 * material.youngs_modulus)
    errors = np.linalg.norm(off, axis=(1, 2)) / scale
    cell = int(np.argmax(np.where(np.isnan(errors), np.inf, errors)))
    error, message = float(errors[cell]), ""
    if not error <= limit:
        message = name_of_stress(asked, material, found_F, _FREE)
    return Finding("law as stated", kind, error, limit, found_F[cell], message)


def _deformations_of(displacement: Array) -> Array:
    """F of separate cells by where their corners went, over the edge, (n, 3, 3)."""
    edges = displacement.reshape(-1, 4, 3)
    F: Array = np.eye(3) + (edges[:, 1:] - edges[:, :1]).transpose(0, 2, 1)
    return F


def _is_stable(F: Array, material: Material) -> NDArray[np.bool_]:
    """Whether a free cell stays there under dead forces: the free part of dP/dF is positive."""
    components = np.argwhere(_FREE)
    tangent = np.zeros((len(F), len(components), len(components)))
    for column, (i, j) in enumerate(components):
        dF = np.zeros_like(F)
        dF[:, i, j] = 1.0
        change = stress_change(material.law, F - np.eye(3), dF, *moduli_of(material, len(F)))
        tangent[:, :, column] = change[:, components[:, 0], components[:, 1]]
    stable: NDArray[np.bool_] = np.linalg.eigvalsh(tangent)[:, 0] > 0.0
    return stable
