"""The judge's own central differences, beside which a stored trajectory is held.

    m (a(t+dt) - 2 a(t) + a(t-dt)) / dt^2 + lambda m (a(t+dt) - a(t-dt)) / (2 dt) = F(t) - R(a(t))

with lumped mass, as eq. 12 should read. Plain NumPy, apart from fastsim and from the reference.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.exchange.nodal_loads import held_components, lumped_mass
from palpate.validation.metrics.elasticity import ElasticForces, load_force


def held_places(problem: Problem, time: float) -> Points:
    """Where held components are at a time [m], 0 where free, (num_points, 3)."""
    placed = np.zeros_like(problem.mesh.points)
    for support in problem.supports:
        factor = 1.0 if support.amplitude is None else support.amplitude(time)
        for axis in np.flatnonzero(support.components):
            placed[support.points, axis] = factor * support.displacement[axis]
    return placed


def replay_motion(
    problem: Problem,
    strain: Strain,
    num_outputs: int,
    element: Element = Element.LINEAR,
) -> NDArray[np.float64]:
    """Step a problem from rest to its first few outputs; tools are left out.

    Args:
        problem: With a time span whose `time_step` divides its outputs.
        strain: Strain measure.
        num_outputs: How many outputs after the initial state.
        element: Linear tetrahedra, plain or smoothed.

    Returns:
        Displacement at rest and at each of the outputs [m], (num_outputs + 1, num_points, 3).
    """
    span = problem.time
    assert span is not None
    assert span.time_step is not None
    dt = span.time_step
    internal = ElasticForces(problem, strain, element)
    dead = [load_force(problem.mesh, k, problem.mesh.points * 0.0, strain) for k in problem.loads]
    mass = lumped_mass(problem)[:, None]
    is_held = held_components(problem)[0].astype(bool)
    half = 0.5 * span.mass_damping * dt
    moves = any(support.amplitude is not None for support in problem.supports)
    held = held_places(problem, 0.0)

    def acceleration(displacement: Points, time: float) -> Points:
        force = -internal(displacement)
        for load, nodal in zip(problem.loads, dead, strict=True):
            factor = 1.0 if load.amplitude is None else load.amplitude(time)
            if isinstance(load, Pressure):
                nodal = load_force(problem.mesh, load, displacement, strain)
            force += factor * nodal
        found: Points = force / mass
        return found

    now = np.where(is_held, held, 0.0)
    before = now + 0.5 * dt**2 * acceleration(now, 0.0)
    outputs = [now]
    steps = steps_per_output(problem)
    for step in range(num_outputs * steps):
        pushed = dt**2 * acceleration(now, step * dt)
        ahead = (pushed + 2.0 * now - (1.0 - half) * before) / (1.0 + half)
        if moves:
            held = held_places(problem, (step + 1) * dt)
        now, before = np.where(is_held, held, ahead), now
        if not np.isfinite(now).all():
            outputs += [np.full(now.shape, math.nan)] * (num_outputs + 1 - len(outputs))
            break
        if (step + 1) % steps == 0:
            outputs.append(now)
    return np.array(outputs)


def steps_per_output(problem: Problem) -> int:
    """Whole steps from one output to the next; 0 where the case states no step."""
    span = problem.time
    if span is None or span.time_step is None:
        return 0
    return round(span.end_time / span.num_outputs / span.time_step)
