"""Ever finer runs on smooth problems with known answers: the order in h, p and dt that they show.

The wave (linear strain): u = A sin(pi x / 2 L) cos(w t), w = (pi / 2 L) sqrt((lmbda + 2 mu) / rho),
held at x = 0, free at x = L, rollers on the sides.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, held, rollers, side
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.validation.states import Progress
from palpate.validation.studies.bodies import Solve
from palpate.validation.studies.closed_forms import confined_modulus
from palpate.validation.studies.convergence.problems import (
    column,
    errors,
    exact_column,
    manufactured_problem,
)

# Refinements of the column for each degree: more would take minutes, and drown in rounding.
LEVELS = {1: 3, 2: 3, 3: 2}
# Of the order of a field: 0.1 where three meshes are near the limit, 0.2 where two must do.
_TOLERANCES = {1: 0.1, 2: 0.1, 3: 0.2}
MATERIAL = Material(1.0, 0.3, 1.0)
_AMPLITUDE = 1e-3
_WIDTH = 0.1
_OUTPUTS = 20
_TIME_TOLERANCE = 0.1


@dataclass(frozen=True)
class ErrorFamily:
    """Relative errors of ever finer runs against an exact answer, or one that is far better.

    `what` is varied: "h", "p" or "dt"; sizes are cell sizes or time steps in any unit; the last
    observed order may be `tolerance` off the expected one; notes say cells or time step.
    """

    name: str
    label: str
    what: str
    sizes: tuple[float, ...]
    errors: tuple[float, ...]
    expected_order: float
    tolerance: float
    notes: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[float, ...]:
        """Observed order between neighbours [-], the last between the two finest."""
        pairs = pairwise(zip(self.sizes, self.errors, strict=True))
        return tuple(math.log(e / f) / math.log(h / g) for (h, e), (g, f) in pairs)

    @property
    def is_as_expected(self) -> bool:
        """Does the order between the two finest runs agree with theory?"""
        return abs(self.orders[-1] - self.expected_order) <= self.tolerance


def follow_manufactured(
    bricks: tuple[int, ...] = (6, 12, 24), *, solve: Solve = solve_static
) -> list[ErrorFamily]:
    """Fastsim's P1 on uniform meshes of the cube, bricks along an edge: L2 order 2, H1 order 1."""
    found, notes = [], []
    for count in bricks:
        problem = manufactured_problem(count)
        found.append(errors(problem.mesh, solve(problem).displacement))
        notes.append(_cells(problem))
    sizes = tuple(1.0 / n for n in bricks)
    return [
        ErrorFamily(f"manufactured solution, {norm} of P1 (fastsim)", f"P1, {norm} norm", "h",
                    sizes, tuple(pair[k] for pair in found), order, tolerance, tuple(notes))
        for k, (norm, order, tolerance) in enumerate((("L2", 2.0, 0.2), ("H1", 1.0, 0.1)))
    ]  # fmt: skip


def follow_degrees(progress: Progress) -> list[ErrorFamily]:
    """The reference's P1, P2 and P3 on the column: energy, whose order is twice the field's.

    The difference of strain energy at equilibrium is the square of the energy norm of the error,
    to leading order, so half its order is that of the displacement in the energy norm: p.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    exact = exact_column()
    families = []
    for degree, count in LEVELS.items():
        found, notes = [], []
        for level in range(count):
            problem = column(level)
            progress(f"column, P{degree}, {_cells(problem)}")
            result = run_task(StaticTask(degree=degree, relative_tolerance=1e-12), problem)
            found.append(abs(result.strain_energy / exact.strain_energy - 1.0) ** 0.5)
            notes.append(_cells(problem))
        name = f"confined column, energy norm of P{degree} (reference)"
        sizes = tuple(0.5**level for level in range(count))
        families.append(
            ErrorFamily(name, f"P{degree}, energy norm", "p", sizes, tuple(found), float(degree),
                        _TOLERANCES[degree], tuple(notes))
        )  # fmt: skip
    return families


def wave_bar(bricks: int) -> Problem:
    """The confined bar, 1 x 0.1 x 0.1 m, a quarter wave long; a tenth as many bricks across."""
    across = max(1, bricks // 10)
    mesh = brick_box((bricks, across, across), (1.0, _WIDTH, _WIDTH))
    sides = ((0, 0.0), (1, 0.0), (1, _WIDTH), (2, 0.0), (2, _WIDTH))
    return Problem(mesh, MATERIAL, rollers(mesh, sides), ())


def wave_frequency() -> float:
    """Angular frequency of the wave [1/s]."""
    return 0.5 * math.pi * math.sqrt(confined_modulus(MATERIAL) / MATERIAL.density)


def follow_wave(bricks: tuple[int, ...] = (10, 20, 40)) -> ErrorFamily:
    """The wave against its closed form over a period, step and mesh refined together."""
    omega = wave_frequency()
    end = 2.0 * math.pi / omega
    # One part of the critical step on every mesh: sizes in proportion.
    longest = 0.5 * Body(wave_bar(bricks[0]).mesh, MATERIAL).critical_time_step_bound()
    steps = math.ceil(end / _OUTPUTS / longest)
    sizes, found, notes = [], [], []
    for count in bricks:
        problem = wave_bar(count)
        dt = end / _OUTPUTS / (steps * count / bricks[0])
        shape = np.zeros_like(problem.mesh.points)
        shape[:, 0] = _AMPLITUDE * np.sin(0.5 * math.pi * problem.mesh.points[:, 0])
        timed = dataclasses.replace(problem, time=TimeSpan(end, dt, num_outputs=_OUTPUTS))
        run = simulate(timed, strain=Strain.LINEAR, displacement=shape)
        exact = np.cos(omega * run.times)[:, None, None] * shape
        sizes.append(dt)
        found.append(_largest_error(problem, run.displacements, exact))
        notes.append(_cells(problem))
    name = "P-wave over a period against its closed form, h and dt together (fastsim)"
    return ErrorFamily(name, "P-wave, closed form", "dt", tuple(sizes), tuple(found), 2.0,
                       _TIME_TOLERANCE, tuple(notes))  # fmt: skip


def block_let_go(bricks: int) -> Problem:
    """A block 2 x 1 x 1 m that a traction sets swinging, far beyond small rotations."""
    mesh = brick_box((2 * bricks, bricks, bricks), (2.0, 1.0, 1.0), ragged=0.1)
    load = Traction(side(mesh, 0, 2.0), (0.0, 0.01, -0.02))
    return Problem(mesh, MATERIAL, (held(side(mesh, 0, 0.0)),), (load,))


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
    between = end_time / _OUTPUTS
    counts = [math.ceil(between / longest) * 2**k for k in range(halvings + 1)]

    def states(per_output: int) -> Points:
        span = TimeSpan(end_time, between / per_output, damping, _OUTPUTS)
        return simulate(dataclasses.replace(problem, time=span)).displacements

    truth = states(16 * counts[-1])
    found = tuple(_largest_error(problem, states(count), truth) for count in counts)
    name = "block let go, Green strain, damped: dt alone, against a small step (fastsim)"
    sizes = tuple(between / count for count in counts)
    notes = tuple(f"dt = {size:.4g} s" for size in sizes)
    return ErrorFamily(name, "block, small step", "dt", sizes, found, 2.0, _TIME_TOLERANCE, notes)


def _largest_error(problem: Problem, found: Points, exact: Points) -> float:
    scale = max(l2_norm(problem.mesh, u) for u in exact)
    return max(l2_norm(problem.mesh, u - v) for u, v in zip(found, exact, strict=True)) / scale


def _cells(problem: Problem) -> str:
    return f"{problem.mesh.num_cells} cells"
