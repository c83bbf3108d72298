"""Dynamics by central differences with a lumped mass: eq. 11-13 of the paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.forces import (
    STRAIN_MEASURE,
    checked_displacement,
    constraints,
    external_force,
    lame_parameters,
    lumped_mass,
)
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

# Share of the critical step used when none is chosen: Green strain stiffens under stretch.
SAFETY = 0.8


@dataclass(frozen=True, eq=False)
class DynamicResult:
    """A trajectory.

    Attributes:
        times: [s], shape (num_outputs + 1,), from 0.
        displacements: [m], shape (num_outputs + 1, num_points, 3).
        velocity: At the last time [m/s], shape (num_points, 3), by a one-sided difference.
        time_step: [s].
        critical_time_step: [s].
        num_steps: Steps done.
    """

    times: Points
    displacements: Points
    velocity: Points
    time_step: float
    critical_time_step: float
    num_steps: int


def critical_time_step(mesh: TetMesh, material: Material) -> float:
    """Largest stable step of central differences about the rest state [s], a safe bound.

    dt = 2 / omega, with omega^2 bounded by the largest eigenvalue of any single cell's
    stiffness over its own lumped mass (Fried's theorem); for one cell that is
    4/rho times the largest eigenvalue of B^T D B, found here from its 6 x 6 twin.

    Args:
        mesh: Rest mesh [m].
        material: Isotropic solid with a density.

    Note:
        Stretched Green-strain cells are stiffer than at rest: keep a margin.
    """
    lmbda, mu = lame_parameters(material)
    # Square root of D in Voigt order (xx, yy, zz, xy, yz, zx).
    elasticity = np.diag([2.0 * mu] * 3 + [mu] * 3)
    elasticity[:3, :3] += lmbda
    values, vectors = np.linalg.eigh(elasticity)
    root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    gradients = _shape_gradients(mesh)
    strain = np.zeros((mesh.num_cells, 6, 12))
    for a in range(4):
        gx, gy, gz = gradients[:, a].T
        strain[:, 0, 3 * a], strain[:, 1, 3 * a + 1], strain[:, 2, 3 * a + 2] = gx, gy, gz
        strain[:, 3, 3 * a], strain[:, 3, 3 * a + 1] = gy, gx
        strain[:, 4, 3 * a + 1], strain[:, 4, 3 * a + 2] = gz, gy
        strain[:, 5, 3 * a], strain[:, 5, 3 * a + 2] = gz, gx
    half = root @ strain
    largest = np.linalg.eigvalsh(half @ half.transpose(0, 2, 1))[:, -1].max()
    return float(2.0 / np.sqrt(4.0 * largest / material.density))


def _shape_gradients(mesh: TetMesh) -> Points:
    """Gradients of the four shape functions [1/m], shape (num_cells, 4, 3)."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    rest = inverse.transpose(0, 2, 1)
    gradients: Points = np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)
    return gradients


def simulate(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    displacement: Points | None = None,
    velocity: Points | None = None,
    progress: Callable[[str], None] | None = None,
) -> DynamicResult:
    """Run the explicit scheme over the problem's time span.

    Loads act with their full value from the start; held components jump to theirs at once.

    Args:
        problem: With `time` set; its `time_step` None takes 0.8 of the critical one.
        strain: Engineering or Green strain.
        displacement: Initial [m], shape (num_points, 3); None is rest.
        velocity: Initial [m/s], shape (num_points, 3); None is zero.
        progress: Called with one line per stored state.

    Raises:
        InputError: No time span, a follower pressure, or arrays of the wrong shape.
        UnstableStepError: The chosen step is above the critical one.
        BlowUpError: The run left the finite numbers; carries the last good state.
    """
    if problem.time is None:
        raise InputError("a dynamic run needs a time span; add [time] to the case")
    if any(isinstance(load, Pressure) for load in problem.loads):
        raise InputError("pressure is not supported in dynamics; use a traction")
    span, mesh = problem.time, problem.mesh
    critical = critical_time_step(mesh, problem.material)
    if span.time_step is not None and span.time_step > critical:
        raise UnstableStepError(span.time_step, critical)
    wanted = span.time_step if span.time_step is not None else SAFETY * critical
    per_output = max(1, int(np.ceil(span.end_time / span.num_outputs / wanted * (1 - 1e-12))))
    dt = span.end_time / (span.num_outputs * per_output)

    lmbda, mu = lame_parameters(problem.material)
    solid = _core.Solid.make(mesh.points, mesh.cells)
    is_free, held = constraints(problem)
    load = external_force(problem)
    mass = lumped_mass(mesh, problem.material.density)
    zero = np.zeros_like(mesh.points)
    now = checked_displacement(mesh, zero if displacement is None else displacement).copy()
    speed = checked_displacement(mesh, zero if velocity is None else velocity)
    now[is_free == 0] = held[is_free == 0]
    internal = np.zeros_like(now)
    solid.internal_force(now, lmbda, mu, STRAIN_MEASURE[strain], internal)
    acceleration = (load - internal) / mass[:, None] - span.mass_damping * speed
    # Start-up value a(-dt), eq. 13.
    previous = now - dt * speed + 0.5 * dt**2 * acceleration
    limit = 1e3 * float(np.ptp(mesh.points, axis=0).max())
    states, times = [now.copy()], [0.0]
    done = 0
    for output in range(1, span.num_outputs + 1):
        steps, is_blown_up = solid.central_difference(
            lmbda,
            mu,
            STRAIN_MEASURE[strain],
            mass,
            load,
            is_free,
            dt,
            span.mass_damping,
            limit,
            per_output,
            now,
            previous,
        )
        done += steps
        if is_blown_up:
            values = np.empty(mesh.num_cells)
            solid.det_f(now, values)
            cell = int(np.argmin(values))
            raise BlowUpError(
                step=done,
                time=done * dt,
                cell=cell,
                smallest_det_f=float(values[cell]),
                displacement=now,
            )
        states.append(now.copy())
        times.append(output * span.end_time / span.num_outputs)
        if progress:
            progress(f"t = {times[-1]:.4g} s of {span.end_time:.4g} s")
    return DynamicResult(
        times=np.array(times),
        displacements=np.array(states),
        velocity=(now - previous) / dt,
        time_step=dt,
        critical_time_step=critical,
        num_steps=done,
    )
