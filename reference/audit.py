"""How far a given displacement is from equilibrium, measured without solving the problem.

One linear solve with the elasticity operator measures the residual in the norm dual to energy;
one with the tangent at the displacement, a single Newton step, estimates the errors of the
displacement and of the volume. On the displacement's own degree 1 this shows whether the discrete
equations were solved; on degree 2 it also shows the error of the linear tetrahedra themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain, require_no_tools
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference import fenicsx
from palpate.reference.deformed_state import DetFSampler, measure_state
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.laws import engineering_strain, strain_energy_density
from palpate.reference.linear_solver import LinearSolveError, LinearSolver
from palpate.reference.result import Audit

# The norm is reported to a few digits; the tolerance of the solve applies to its square.
_SOLVE_TOLERANCE = 1e-8
# Volume is a cubic of the displacement: a central difference of this part of a step is good to
# its square, and loses five digits of sixteen to rounding.
_SMALL = 1e-4


def audit_displacement(
    problem: Problem,
    displacement: Points,
    *,
    strain: Strain = Strain.GREEN,
    degree: int = 2,
    element: Element = Element.LINEAR,
    progress: Callable[[str], None] | None = None,
) -> Audit:
    """Measure a displacement [m], linear between the mesh's points, against its equations.

    `degree` is that of the equations, 1 to 3: 1 judges the solver, 2 the mesh too; smoothed
    tetrahedra are of degree 1.

    Raises:
        InputError: The problem cannot be used, or the displacement has the wrong shape or a value
            that is not finite.

    Note:
        The estimates are those of one Newton step: too small where the error is large, and blind
        to a limit point.
    """
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: needs 1, 2 or 3")
    require_supported(problem)
    require_no_tools(problem, "the audit")
    discrete = DiscreteProblem(
        problem, strain=Strain(strain), degree=degree, element=Element(element)
    )
    u = discrete.to_local(discrete.space.from_points(displacement))
    if progress:
        num_dofs = 3 * discrete.space.num_global_blocks
        progress(f"audit on degree {degree}: {num_dofs} degrees of freedom")
    sampler = DetFSampler(discrete)
    smallest_det_f = sampler.smallest(u)
    internal, external = discrete.internal_force(u), discrete.external_force(u)
    residual = external - internal
    residual_norm, lifted = _dual_norm(discrete, residual)
    state = measure_state(discrete, u)
    scale = math.sqrt(2.0 * state.strain_energy) if state.strain_energy > 0.0 else 0.0
    force, moment = _imbalance(discrete, u, residual)
    gaps = np.abs(u[discrete.fixed.dofs] - discrete.fixed.values)
    errors = _estimate_errors(discrete, u, residual, smallest_det_f, problem.mesh.volume)
    cell_errors = _cell_errors(discrete, lifted)
    if element is Element.SMOOTHED:
        # The energy of averaged strains belongs to no single cell: scale the cells' own energies.
        cell_errors *= residual_norm / (np.linalg.norm(cell_errors) or 1.0)
    return Audit(
        degree=degree,
        strain=discrete.strain,
        residual_norm=residual_norm,
        relative_residual_norm=residual_norm / scale if scale else math.inf,
        support_gap=fenicsx.largest(float(np.max(gaps, initial=0.0))),
        largest_displacement=float(np.linalg.norm(displacement, axis=1).max(initial=0.0)),
        force_imbalance=force,
        moment_imbalance=moment,
        strain_energy=state.strain_energy,
        volume=state.volume,
        smallest_det_f=smallest_det_f,
        is_stable=_is_stable(discrete, u, smallest_det_f),
        displacement_error=errors[0],
        volume_error=errors[1],
        cell_errors=cell_errors,
    )


def _solver(discrete: DiscreteProblem, *, is_symmetric: bool) -> LinearSolver:
    return LinearSolver(discrete.space, is_symmetric=is_symmetric, frames=discrete.frames)


def _dual_norm(discrete: DiscreteProblem, residual: Floats) -> tuple[float, Floats]:
    """sqrt(r . K^-1 r) over the free entries, with the stiffness at rest."""
    rest = np.zeros(discrete.num_dofs)
    matrix = discrete.tangent(rest, 0.0)
    fixed = discrete.fixed.dofs
    lifted = _solver(discrete, is_symmetric=True).solve(
        matrix, residual, fixed, np.zeros(len(fixed)), tolerance=_SOLVE_TOLERANCE
    )
    free = discrete.free
    work = fenicsx.total(float(residual[free] @ lifted[free]))
    return math.sqrt(max(work, 0.0)), lifted


def _cell_errors(discrete: DiscreteProblem, lifted: Floats) -> Floats:
    """Root of twice each cell's elastic energy in a displacement, in the TetMesh's order."""
    transferred = discrete.space.transferred
    density = strain_energy_density(engineering_strain(discrete.u), *discrete.lame)
    # Four points, exact for quadratics (Hammer, Marlowe, Stroud 1956).
    a, b = (5.0 + 3.0 * math.sqrt(5.0)) / 20.0, (5.0 - math.sqrt(5.0)) / 20.0
    positions = np.array([[b, b, b], [a, b, b], [b, a, b], [b, b, a]])
    sample = fenicsx.evaluate_in_cells(transferred.mesh, density, positions)
    discrete.set_displacement(lifted)
    mean = np.asarray(sample()).reshape(len(transferred.cell_of_cell), -1).mean(axis=1)
    source = transferred.source
    squared = np.zeros(source.num_cells)
    volumes = signed_volumes(source.points, source.cells)
    squared[transferred.cell_of_cell] = 2.0 * mean * volumes[transferred.cell_of_cell]
    errors: Floats = np.sqrt(np.maximum(fenicsx.total(squared), 0.0))
    return errors


def _imbalance(discrete: DiscreteProblem, u: Floats, residual: Floats) -> tuple[float, float]:
    """Norms of the sums of the residual forces [N] and of their moments [N m].

    Only free entries count: at fixed ones the reactions balance the residual.
    """
    loose = np.zeros_like(residual)
    loose[discrete.free] = residual[discrete.free]
    forces = discrete.to_global(loose).reshape(-1, 3)
    positions = discrete.space.coordinates
    if discrete.strain is Strain.GREEN:
        positions = positions + discrete.to_global(u).reshape(-1, 3)
    total = np.linalg.norm(fenicsx.total(forces.sum(axis=0)))
    moment = np.linalg.norm(fenicsx.total(np.cross(positions, forces).sum(axis=0)))
    return float(total), float(moment)


def _is_stable(discrete: DiscreteProblem, u: Floats, smallest_det_f: float) -> bool | None:
    if discrete.strain is Strain.LINEAR or discrete.has_followers or not smallest_det_f > 0.0:
        return None
    solver = _solver(discrete, is_symmetric=True)
    return solver.is_positive_definite(discrete.tangent(u, 1.0), discrete.fixed.dofs)


def _estimate_errors(
    discrete: DiscreteProblem,
    u: Floats,
    residual: Floats,
    smallest_det_f: float,
    rest_volume: float,
) -> tuple[float | None, float | None]:
    """Estimate the errors of displacement and volume by one Newton step from the displacement."""
    if discrete.strain is Strain.GREEN and not smallest_det_f > 0.0:
        return None, None
    fixed = discrete.fixed
    matrix = discrete.tangent(u, 1.0)
    solver = _solver(discrete, is_symmetric=not discrete.has_followers)
    try:
        step = solver.solve(
            matrix, residual, fixed.dofs, fixed.values - u[fixed.dofs], tolerance=_SOLVE_TOLERANCE
        )
    except LinearSolveError:
        return None, None
    at_points = discrete.at_points
    size = float(np.linalg.norm(at_points(u + step)))
    displacement_error = float(np.linalg.norm(at_points(step))) / size if size else None
    before = measure_state(discrete, u).volume - rest_volume
    if discrete.strain is Strain.LINEAR:
        after = measure_state(discrete, u + step).volume - rest_volume
    else:
        # To first order: a finite step turns sections along their tangent, which adds volume that
        # the body does not gain.
        ends = [measure_state(discrete, u + t * _SMALL * step).volume for t in (1.0, -1.0)]
        after = before + (ends[0] - ends[1]) / (2.0 * _SMALL)
    return displacement_error, before / after - 1.0 if after else None
