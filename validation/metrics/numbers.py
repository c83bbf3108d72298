"""Single numbers of one state, in SI units, to compare with what was published or measured.

Of a motion they are of its last state. Each is worked out in the same way for a candidate's linear
or smoothed tetrahedra, a result on a mesh of its own, and a quadratic truth, whose integrals are
stored beside its displacement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.field_norms import size_of_change
from palpate.meshes.problem import Problem
from palpate.meshes.spring import Spring
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.metrics.body import body_of, forces_at_end
from palpate.validation.metrics.own_mesh import problem_on
from palpate.validation.metrics.stress import (
    Part,
    force_of_part,
    read_stress,
    resultant,
    scale_of_force,
)
from palpate.validation.states import State

# Components of a symmetric tensor by name.
TENSOR = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "yz": (1, 2), "xz": (0, 2), "xy": (0, 1)}
LARGEST_PRINCIPAL, VON_MISES = "largest_principal", "von_mises"
STRESSES = (*TENSOR, LARGEST_PRINCIPAL, VON_MISES)
# |von Mises| <= sqrt(3/2) |sigma|; a component or principal stress is at most |sigma|.
_LIPSCHITZ = math.sqrt(1.5)


@dataclass(frozen=True)
class Number:
    """A number of a state in its SI unit, and what reading on a mesh of its own may add to it.

    `scale` is what errors of the metric that its error bar is of are divided by, in that unit; of a
    mean stress the most that it can be off by where their L2 norm is off by all of it.
    """

    value: float
    doubt: float = 0.0
    scale: float = math.nan


def reaction(problem: Problem, state: State, part: Part, component: str) -> Number:
    """Component of the force that a support exerts on the body [N].

    The sum of the nodal forces of the stress at its fixed components, less every load there,
    pressures on the deformed surface among them; on planes at an angle along their normals. Of a
    quadratic truth the pressure acts on the case's own facets, moved. Where two supports hold the
    same component of a point, its force counts for both.

    Note:
        Of a support that moves in time the inertia of what it holds is left out: not for those.
    """
    integrals, doubt = read_stress(problem, state)
    force = resultant(problem, integrals, part)
    for item, at_points in forces_at_end(problem, state.displacement, state.strain):
        # `resultant` has subtracted the dead loads.
        if isinstance(item, Pressure | Spring):
            force = force - force_of_part(problem, at_points, part)
    axis = "xyz".index(component)
    off = 0.0
    if doubt is not None:
        off = abs(float(force_of_part(problem, doubt.internal_force, part)[axis]))
    return Number(float(force[axis]), off, scale_of_force(problem, state)[0])


def tool_force(problem: Problem, state: State, part: Part, component: str) -> Number | None:
    """Component of the force on a tool [N]: at the end of its path, or its last mean over time.

    None where a simulator does not report the force on each tool.
    """
    forces = state.tool_forces
    if forces is None or part.tool is None or len(forces) != len(problem.tools):
        return None
    last = forces[part.tool] if forces.ndim == 2 else forces[part.tool, -1]
    scale = float(np.linalg.norm(forces, axis=-1).max())
    return Number(float(last["xyz".index(component)]), scale=scale)


def volume_change(problem: Problem, state: State, _part: Part, _component: str) -> Number:
    """Deformed volume less that at rest [m3]; for a result on its own mesh, that mesh's."""
    rest = problem.mesh.volume
    return Number(state.volume - rest, scale=size_of_change(state.volume, rest))


def strain_energy(problem: Problem, state: State, _part: Part, _component: str) -> Number | None:
    """Integral of the strain energy density over the rest volume [J].

    psi = lmbda/2 tr(e)^2 + mu tr(e^2), of engineering strain or Green's. None of a truth that was
    stored without it.
    """
    if state.integrals is not None:
        known = state.integrals.strain_energy
        return None if known is None else Number(known, scale=known)
    if state.own is None:
        own_energy = body_of(problem, state.strain, state.element).energy(state.displacement)
        return Number(own_energy, scale=own_energy)
    own = problem_on(state.own.mesh, problem)
    found = body_of(own, state.strain, state.element).energy(state.own.displacements[-1])
    return Number(found, abs(own.mesh.volume / problem.mesh.volume - 1.0) * found, found)


def mean_stress(problem: Problem, state: State, part: Part, component: str) -> Number:
    """Mean of Cauchy's stress over the part's cells, by rest volume [Pa]; tension positive.

    Of a component along the axes of space; of a principal or von Mises stress the mean of that of
    each cell's mean.
    """
    integrals, doubt = read_stress(problem, state)
    volumes = signed_volumes(problem.mesh.points, problem.mesh.cells)[part.cells]
    weights = volumes / volumes.sum()
    sigma = integrals.cauchy[part.cells]
    value = float(weights @ _component_of(sigma, component))
    most = _LIPSCHITZ if component == VON_MISES else 1.0
    scale = most * math.sqrt(float(weights @ np.einsum("cij,cij->c", sigma, sigma)))
    if doubt is None:
        return Number(value, scale=scale)
    sizes = np.linalg.norm(doubt.cauchy[part.cells], axis=(1, 2))
    return Number(value, most * float(weights @ sizes), scale)


def _component_of(sigma: Floats, component: str) -> Floats:
    """(n,) of symmetric tensors (n, 3, 3); NaN where one is not finite."""
    if component in TENSOR:
        row, column = TENSOR[component]
        found: Floats = sigma[:, row, column]
        return found
    if component == VON_MISES:
        mean = np.trace(sigma, axis1=1, axis2=2) / 3.0
        s = sigma - mean[:, None, None] * np.eye(3)
        return np.asarray(np.sqrt(1.5 * np.einsum("cij,cij->c", s, s)))
    largest: Floats = np.full(len(sigma), np.nan)
    is_finite = np.isfinite(sigma).all(axis=(1, 2))
    largest[is_finite] = np.linalg.eigvalsh(sigma[is_finite])[:, -1]
    return largest
