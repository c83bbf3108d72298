"""Convergence in time: a wave along a confined bar, and a block let go with Green strain.

The wave (linear strain): u = A sin(pi x / 2 L) cos(w t), w = (pi / 2 L) sqrt((lmbda + 2 mu) / rho),
held at x = 0, free at x = L, rollers on the sides.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.validation.metrics.pairs import l2_norm
from palpate.validation.studies.error_family import ErrorFamily

MATERIAL = Material(1.0, 0.3, 1.0)
_AMPLITUDE = 1e-3
_WIDTH = 0.1
_OUTPUTS = 20
# Of the observed order.
TOLERANCE = 0.1


def wave_bar(bricks: int) -> Problem:
    """The confined bar, 1 x 0.1 x 0.1 m, a quarter wave long.

    Args:
        bricks: Along the bar; a tenth as many across.
    """
    across = max(1, bricks // 10)
    mesh = brick_box((bricks, across, across), (1.0, _WIDTH, _WIDTH))
    supports = []
    for axis, places in ((0, (0.0,)), (1, (0.0, _WIDTH)), (2, (0.0, _WIDTH))):
        for place in places:
            points = np.flatnonzero(np.abs(mesh.points[:, axis] - place) < 1e-12)
            held = (axis == 0, axis == 1, axis == 2)
            supports.append(Support(points.astype(np.int32), components=held))
    return Problem(mesh, MATERIAL, tuple(supports), ())


def wave_frequency() -> float:
    """Angular frequency of the wave [1/s]."""
    E, nu, rho = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio, MATERIAL.density
    modulus = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return 0.5 * math.pi * math.sqrt(modulus / rho)


def follow_wave(bricks: tuple[int, ...] = (10, 20, 40)) -> ErrorFamily:
    """The wave against its closed form over a period, step and mesh refined together."""
    omega = wave_frequency()
    end = 2.0 * math.pi / omega
    # One share of the critical step on every mesh: sizes in proportion.
    first = wave_bar(bricks[0])
    steps = math.ceil(
        end / _OUTPUTS / (0.5 * Body(first.mesh, MATERIAL).critical_time_step_bound())
    )
    sizes, errors, counts = [], [], []
    for count in bricks:
        problem = wave_bar(count)
        dt = end / _OUTPUTS / (steps * count / bricks[0])
        shape = np.zeros_like(problem.mesh.points)
        shape[:, 0] = _AMPLITUDE * np.sin(0.5 * math.pi * problem.mesh.points[:, 0])
        run = simulate(
            dataclasses.replace(problem, time=TimeSpan(end, dt, num_outputs=_OUTPUTS)),
            strain=Strain.LINEAR,
            displacement=shape,
        )
        exact = np.cos(omega * run.times)[:, None, None] * shape
        sizes.append(dt)
        errors.append(_largest_error(problem, run.displacements, exact))
        counts.append(problem.mesh.num_cells)
    return ErrorFamily(
        name="P-wave over a period against its closed form, h and dt together (fastsim)",
        label="P-wave, closed form",
        what="dt",
        sizes=tuple(sizes),
        errors=tuple(errors),
        expected_order=2.0,
        tolerance=TOLERANCE,
        notes=tuple(f"{cells} cells" for cells in counts),
    )


def block_let_go(bricks: int) -> Problem:
    """A block 2 x 1 x 1 m that a traction sets swinging, far beyond small rotations."""
    mesh = brick_box((2 * bricks, bricks, bricks), (2.0, 1.0, 1.0), ragged=0.1)
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    clamped = facets[(x < 1e-12).all(axis=1)]
    end = facets[(x > 2.0 - 1e-12).all(axis=1)]
    return Problem(
        mesh,
        MATERIAL,
        (Support(np.unique(clamped).astype(np.int32), clamped),),
        (Traction(end, (0.0, 0.01, -0.02)),),
    )


def follow_block(
    bricks: int = 2, *, halvings: int = 3, end_time: float = 6.0, damping: float = 0.1
) -> ErrorFamily:
    """The block on one mesh, the step halved, against a step a sixteenth of the last.

    Args:
        bricks: Over the height.
        halvings: Of the step, from about 0.8 of the critical one.
        end_time: [s].
        damping: Mass damping [1/s].
    """
    problem = block_let_go(bricks)
    longest = 0.8 * Body(problem.mesh, MATERIAL).critical_time_step_bound()
    steps = math.ceil(end_time / _OUTPUTS / longest)

    def states(per_output: int) -> Points:
        span = TimeSpan(end_time, end_time / _OUTPUTS / per_output, damping, _OUTPUTS)
        return simulate(dataclasses.replace(problem, time=span)).displacements

    counts = [steps * 2**k for k in range(halvings + 1)]
    truth = states(16 * counts[-1])
    errors = [_largest_error(problem, states(count), truth) for count in counts]
    return ErrorFamily(
        name="block let go, Green strain, damped: dt alone, against a small step (fastsim)",
        label="block, small step",
        what="dt",
        sizes=tuple(end_time / _OUTPUTS / count for count in counts),
        errors=tuple(errors),
        expected_order=2.0,
        tolerance=TOLERANCE,
        notes=tuple(f"dt = {end_time / _OUTPUTS / count:.4g} s" for count in counts),
    )


def _largest_error(problem: Problem, found: Points, exact: Points) -> float:
    scale = max(l2_norm(problem.mesh, u) for u in exact)
    return max(l2_norm(problem.mesh, u - v) for u, v in zip(found, exact, strict=True)) / scale
