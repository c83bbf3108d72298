"""Metrics of stress in a part of the body, and of the force through a support or a cut.

Stress is compared by means over the case's rest cells, volume by volume: of a linear or smoothed
tetrahedron its own constant, of a quadratic or finer reference the mean of its field. What varies
inside a cell does not count: a mesh of that size cannot say it. Nor are pressures of nodes ever
looked at: those of smoothed tetrahedra may checkerboard from node to node, their cells' averages
do not.

Cauchy's stress is turned back into the rest frame by the rotation of its cell, R^T sigma R with
F = R U (J. Bonet, R. D. Wood, 2nd ed. 2008, sections 3.5 and 5.5), so that a body that was turned
too far as a whole has the right stress: how far it is turned is what displacements show. Linear
strain knows no rotation, and is compared as it is.

The force through a surface is a sum of nodal forces, integral of P grad w over the body with w = 1
at the points of the surface and 0 one layer of cells beyond, not an integral of traction: its
error goes with the square of that of stress (I. Babuska, A. Miller, Int. J. Numer. Meth. Engng 20,
1984, 1085-1109, "extraction"; T. J. R. Hughes et al., J. Comput. Phys. 163, 2000, 467-488).

Note:
    At clamped edges and reentrant corners stress grows without end as the mesh is refined: take
    parts away from there.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import mean_over_parents, refine_uniformly
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import pushes_of_supports
from palpate.validation.exchange.point_location import locate
from palpate.validation.metrics.body import (
    Body,
    body_of,
    dead_force,
    forces_at_end,
    shape_gradients,
    sum_at_points,
)
from palpate.validation.metrics.difference import Difference, are_measurable, ratio
from palpate.validation.metrics.laws import rotation_of
from palpate.validation.metrics.own_mesh import problem_on
from palpate.validation.states import CellStresses, OwnMesh, State, StressIntegrals

# A resultant below this part of the sum of all nodal forces' sizes is none: a pressure all around,
# read on the flat facets of the case. A plate bent over a span of 100 times its height has 3e-3.
_NO_FORCE = 1e-4
# Relative to the largest component: seven digits, and sums.
_SAME = 1e-4


@dataclass(frozen=True, eq=False)
class Part:
    """The part of the body that a check looks at.

    Attributes:
        cells: Cells whose stress is compared, (n,); none for a force.
        weights: How much of each component of a nodal force counts, 0 or 1, (num_points, 3).
        support: Number of the support from 0, whose own force it is; None of a cut or of cells.
        tool: Number of the tool from 0; None where it is of none.
        says: A description of the part, for people.
    """

    cells: Indices
    weights: Points
    support: int | None = None
    tool: int | None = None
    says: str = ""


def is_stress_known(state: State) -> bool:
    """Whether a state's stress is known: a quadratic displacement at corners does not give it."""
    return state.degree == 1 or state.integrals is not None


def stress_integrals(
    mesh: TetMesh, stresses: CellStresses, strain_energy: float | None = None
) -> StressIntegrals | None:
    """Means over the case's cells with the nodal forces they make; None where P is not known."""
    sigma, P = stresses.cauchy, stresses.first_piola_kirchhoff
    if P is None:
        return None
    return StressIntegrals(sigma, _nodal_force(mesh, P), strain_energy)


def stress_l2(problem: Problem, candidate: State, reference: State, part: Part) -> Difference:
    """L2 norm over the part of the error of Cauchy's stress, over that of the reference's stress.

    Frobenius norms |sigma|^2 = sigma : sigma of the cells' means, weighted by rest volume.
    """
    volumes = signed_volumes(problem.mesh.points, problem.mesh.cells)[part.cells]

    def norm(stress: Floats) -> float:
        return math.sqrt(float(volumes @ np.einsum("cij,cij->c", stress, stress)))

    doubt = read_stress(problem, candidate)[1]
    found, expected = (_turned_back(problem, s)[part.cells] for s in (candidate, reference))
    if not are_measurable(found):
        return Difference(math.inf, math.nan)
    compared = ratio(norm(found - expected), norm(expected))
    if candidate.sent_stress is not None and candidate.own is None:
        body = body_of(problem, candidate.strain, candidate.element)
        mistake = mistaken_stress(body, candidate.displacement, candidate.sent_stress, part.cells)
        compared = dataclasses.replace(compared, remark=mistake)
    if doubt is None or not compared.scale > 0.0:
        return compared
    off = norm(doubt.cauchy[part.cells]) / compared.scale
    return dataclasses.replace(compared, uncertainty=off)


def traction_resultant(
    problem: Problem, candidate: State, reference: State, part: Part
) -> Difference:
    """Size of the error of the force through a support or a cut.

    Over the largest resultant of a load or support in the reference; of 1 N where each is balanced.
    """
    ours, doubt = read_stress(problem, candidate)
    theirs, _ = read_stress(problem, reference)
    error = resultant(problem, ours, part) - resultant(problem, theirs, part)
    scale, name = scale_of_force(problem, reference)
    compared = ratio(float(np.linalg.norm(error)), scale, name)
    if doubt is None:
        return compared
    off = float(np.linalg.norm(force_of_part(problem, doubt.internal_force, part)))
    return dataclasses.replace(compared, uncertainty=off / scale)


def scale_of_force(problem: Problem, state: State) -> tuple[float, str]:
    """The scale that errors of forces are divided by [N], and its name."""
    largest = _largest_resultant(problem, state, read_stress(problem, state)[0])
    if largest > 0.0:
        return largest, "the reference's largest force of a load or support"
    return 1.0, "1 N, since no load or support has a force of its own"


def resultant(problem: Problem, integrals: StressIntegrals, part: Part) -> NDArray[np.float64]:
    """Force through a support or a cut [N], (3,).

    Of a support what it exerts on the body in its fixed components, follower pressure on its points
    counted in, as `reaction_force` has it; of a cut what acts on the part in the region from
    outside of the body, which is minus the force that the rest of the body pulls on it with.
    """
    force = integrals.internal_force
    if part.support is not None:
        force = force - dead_force(problem)
    return force_of_part(problem, force, part)


def force_of_part(problem: Problem, forces: Points, part: Part) -> NDArray[np.float64]:
    """What of nodal forces goes through a cut, or is a support's own [N], (3,)."""
    if part.support is not None:
        pushed: NDArray[np.float64] = pushes_of_supports(problem, forces)[part.support]
        return pushed
    total: NDArray[np.float64] = (part.weights * forces).sum(axis=0)
    return total


# Each state is looked at in several parts, and beside several others.
@lru_cache(maxsize=4)
def _turned_back(problem: Problem, state: State) -> Floats:
    """R^T sigma R of each cell, R its rotation by the state's displacement."""
    sigma, mesh = read_stress(problem, state)[0].cauchy, problem.mesh
    if state.strain is Strain.LINEAR:
        return sigma
    corners = state.displacement[mesh.cells].transpose(0, 2, 1)
    F = np.eye(3) + corners @ shape_gradients(mesh)
    R = rotation_of(F)
    turned: Floats = R.transpose(0, 2, 1) @ sigma @ R
    return turned


def _largest_resultant(problem: Problem, state: State, integrals: StressIntegrals) -> float:
    """Largest total force of a load or a support [N]; 0 where each is balanced in itself."""
    force = integrals.internal_force
    totals = [np.zeros(3)]
    left = force.copy()
    for _, at_points in forces_at_end(problem, state.displacement, state.strain):
        totals.append(at_points.sum(axis=0))
        left -= at_points
    for support in problem.supports:
        onto = support.directions.T @ support.directions
        totals.append(onto @ left[support.points].sum(axis=0))
    found = float(np.linalg.norm(totals, axis=1).max())
    return found if found > _NO_FORCE * float(np.linalg.norm(force, axis=1).sum()) else 0.0


@lru_cache(maxsize=4)
def read_stress(problem: Problem, state: State) -> tuple[StressIntegrals, StressIntegrals | None]:
    """A state's stress over the case's cells; on a mesh of its own what that may be off by too."""
    if state.integrals is not None:
        return state.integrals, None
    if state.own is not None:
        return _read_own(problem, state, state.own)
    body = body_of(problem, state.strain, state.element)
    sigma, P = body.stresses(state.displacement)
    if state.sent_stress is not None:
        sigma = state.sent_stress
    elif state.stresses is not None:
        sigma = state.stresses.cauchy
    return StressIntegrals(sigma, body.force_of(P)), None


def _read_own(
    problem: Problem, state: State, own: OwnMesh
) -> tuple[StressIntegrals, StressIntegrals]:
    """Means over the case's cells of stresses by own cells, read at eight points of each.

    They are the middles of the eight that the cell is cut into. The doubt is half of how far apart
    the means of two sets of four are, whose own mean the reading is.
    """
    sigma, P = Body(problem_on(own.mesh, problem), state.strain, state.element).stresses(
        own.displacements[-1]
    )
    if own.sent_stress is not None:
        sigma = own.sent_stress
    cells = _own_cells(problem.mesh, own.mesh)
    # Two of the four at the corners and two of the four inside, and the others.
    is_first = np.concatenate(
        [np.repeat([True, True, False, False], len(cells) // 8), np.arange(len(cells) // 2) % 4 < 2]
    )
    sign = np.where(is_first, 1.0, -1.0)[:, None, None]
    means, halves = (
        StressIntegrals(
            mean_over_parents(weights * sigma[cells]),
            _nodal_force(problem.mesh, mean_over_parents(weights * P[cells])),
        )
        for weights in (np.ones_like(sign), sign)
    )
    return means, halves


@lru_cache(maxsize=2)
def _own_cells(case: TetMesh, own: TetMesh) -> NDArray[np.int64]:
    """Which own cell holds the middle of each of the eight cut from a cell, (8 num_cells,)."""
    finer = refine_uniformly(case)
    return locate(own.points, own.cells, finer.points[finer.cells].mean(axis=1)).cells


def _nodal_force(mesh: TetMesh, P: Floats) -> Points:
    volumes = signed_volumes(mesh.points, mesh.cells)
    by_corner = volumes[:, None, None] * shape_gradients(mesh) @ P.transpose(0, 2, 1)
    return sum_at_points(mesh.cells, by_corner, mesh.num_points)


def mistaken_stress(body: Body, displacement: Points, sent: Floats, cells: Indices) -> str:
    """What would explain a stress that is not that of the displacement sent with it; else "".

    `sent` was taken for Cauchy's [Pa], (num_cells, 3, 3), and is compared in some cells.
    """
    sigma, P = body.stresses(displacement)
    known = {
        "with compression positive": -sigma,
        "in kPa": 1e-3 * sigma,
        "in MPa": 1e-6 * sigma,
        "without its mean (the deviator)": sigma
        - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3),
    }
    known = {f"Cauchy's stress {how}": stress for how, stress in known.items()}
    if body.strain is Strain.GREEN:
        F = np.eye(3) + body.gradient(displacement)
        J = np.linalg.det(F)[:, None, None]
        known["the second Piola-Kirchhoff stress"] = _solved(F, P)
        known["the Kirchhoff stress, det F times Cauchy's"] = J * sigma
    if _are_same(sent[cells], sigma[cells]):
        return ""
    for name, stress in known.items():
        if _are_same(sent[cells], stress[cells]):
            return f"what was sent is {name}, by the displacement sent with it"
    return ""


def _solved(F: Floats, P: Floats) -> Floats:
    """S = F^-1 P; NaN where a cell is flat."""
    S: Floats = np.full_like(P, np.nan)
    is_solid = np.abs(np.linalg.det(F)) > 0.0
    S[is_solid] = np.linalg.solve(F[is_solid], P[is_solid])
    return S


def _are_same(one: Floats, other: Floats) -> bool:
    scale = float(np.abs(other).max(initial=0.0))
    return bool(np.abs(one - other).max(initial=0.0) <= _SAME * scale)
