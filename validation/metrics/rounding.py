"""What single precision does to a result: how far from the reference a correct one may be.

A program that stores its numbers in 24 bits makes relative errors of u = 2^-24 = 6e-8.

Statics. A strain E = (F^T F - I) / 2 comes from numbers of size 1, three products and two sums,
each rounded: it is off by up to 4 u, however small it is. So are the stresses, and the nodal
forces; the body responds to the unbalanced rest with its own compliance,

    K du = sum over cells of V (C : dE) grad N,    |dE_ij| <= 4 u at random,

which is where the condition of the case comes in: a slender body, or cells much smaller than the
body, respond with more. K is the stiffness at rest, solved by conjugate gradients. Positions
X + u + du are rounded once more, as a result given in positions would be. Each metric between the
reference and such a result is what rounding does to it.

Motion. Each of n steps rounds the displacement by u |a|, as an acceleration of u |a| / dt^2 would.
A motion of frequency w responds to each with an oscillation of u |a| / (w dt); n of them with
random signs add to sqrt(n) as much: relative to the displacement r = sqrt(n) u / (w dt). (A program
that stores velocities rounds less. One that steps positions X + a, not displacements, rounds
|X| / |a| times more, and is not granted that.) Over time r itself is the error; of the last state
that of a field du scaled to it.

The limit is ten times that, since a solver stops somewhat above its rounding, and signs are not
always random; and never above a tenth of the smallest mistake that every gate must see, a material
2 % too soft, which is 2 % of a displacement.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.validation.exchange.nodal_arrays import fixed_components
from palpate.validation.metrics.audit import solve_scaled
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.catalogue import CATALOGUE, measure
from palpate.validation.metrics.difference import measures_of
from palpate.validation.metrics.numbers import Number
from palpate.validation.metrics.stress import Part
from palpate.validation.states import State

UNIT_ROUNDING = 2.0**-24
SAFETY = 10.0
LARGEST = 2e-3
_ROUNDINGS_OF_A_STRAIN = 4.0
_SAMPLES = 3
# Relative, in the energy norm: a limit needs two digits.
_SOLVED_TO = 1e-4


class SinglePrecision:
    """Limits of a problem for results in single precision."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def limit(self, metric: str, reference: State, part: Part | None = None) -> float:
        """The error that a correct result in single precision may have, over the metric's scale.

        Of a metric that compares with the reference on the same mesh, and of a part; at most
        LARGEST.
        """
        relative = 0.0
        if reference.trajectory is not None:
            relative = rounding_of_motion(self._problem, reference)
        if CATALOGUE[metric].needs_time:
            found = SAFETY * relative
        elif CATALOGUE[metric].needs_tools:
            found = SAFETY * (relative or self._of_tools(reference))
        else:
            rounded = self._rounded(reference, relative)
            found = max(measure(metric, self._problem, a, reference, part).value for a in rounded)
        return min(float(f"{found:.2g}"), LARGEST) if math.isfinite(found) else LARGEST

    def limit_of_number(
        self, read: Callable[[State], Number | None], reference: State, expected: float
    ) -> float:
        """`limit` of a number that is read of a state, relative to the one expected."""
        relative = 0.0
        if reference.trajectory is not None:
            relative = rounding_of_motion(self._problem, reference)
        numbers = [read(state) for state in (reference, *self._rounded(reference, relative))]
        values = [math.inf if number is None else number.value for number in numbers]
        worst = max(abs(value - values[0]) for value in values[1:]) / expected
        return min(float(f"{worst:.2g}"), LARGEST) if math.isfinite(worst) else LARGEST

    def explain(self, reference: State) -> str:
        """The source of the limits, for a check's reason."""
        if reference.trajectory is None:
            words = "strains rounded by 4 x 2^-24 at random, by the stiffness of the case"
        else:
            r = rounding_of_motion(self._problem, reference)
            words = f"every step rounded by 2^-24, sqrt(n) 2^-24 / (w dt) = {r:.2g}"
        return f"{words}; {SAFETY:g} times that, at most {LARGEST:g}"

    @cached_property
    def _fields(self) -> tuple[tuple[Points, Points], ...]:
        """Displacements [m] with which the body responds to rounded strains, and the forces [N]."""
        problem, random = self._problem, np.random.default_rng(0)
        body, free = body_of(problem, Strain.LINEAR), 1.0 - fixed_components(problem)[0]
        found = []
        for _ in range(_SAMPLES):
            strain = random.uniform(-1.0, 1.0, (problem.mesh.num_cells, 3, 3))
            strain = 0.5 * (strain + strain.transpose(0, 2, 1))
            stress = body.stress(_ROUNDINGS_OF_A_STRAIN * UNIT_ROUNDING * strain)
            force = body.force_of(stress)
            moved = solve_scaled(
                lambda u: body.internal(u) * free,
                force * free,
                body.stiffness_diagonal,
                tolerance=_SOLVED_TO,
            )
            found.append((moved, force))
        return tuple(found)

    def _rounded(self, reference: State, relative: float) -> list[State]:
        """Results as far off as SAFETY times rounding may lead."""
        mesh, states = self._problem.mesh, []
        for field, _ in self._fields:
            size = SAFETY
            if reference.trajectory is not None:
                largest = float(np.abs(reference.trajectory.displacements).max())
                size *= relative * largest / max(float(np.abs(field).max()), math.ulp(0.0))
            positions = (mesh.points + reference.displacement + size * field).astype(np.float32)
            measures = measures_of(mesh, positions - mesh.points)
            states.append(dataclasses.replace(reference, simulator="", stresses=None, **measures))
        return states

    def _of_tools(self, reference: State) -> float:
        """Rounded forces at the points that a tool pushes, over the force on the tool."""
        residual, scale = body_of(
            self._problem, reference.strain, reference.element
        ).out_of_balance(reference.displacement)
        is_pushed = (np.abs(residual) > 1e-6 * scale).any(axis=1)
        rounded = max(
            float(np.linalg.norm(force[is_pushed], axis=1).sum()) for _, force in self._fields
        )
        forces = reference.tool_forces
        pushed = 0.0 if forces is None else float(np.linalg.norm(forces, axis=-1).max(initial=0.0))
        return rounded / pushed if pushed else math.inf


def rounding_of_motion(problem: Problem, reference: State) -> float:
    """R = sqrt(n) u / (w dt), with w the trajectory's own: its speed over its displacement [-].

    w^2 is the mean square of the velocity over that of the displacement about its mean.
    """
    span, motion = problem.time, reference.trajectory
    assert span is not None
    assert motion is not None
    if span.time_step is None:
        return LARGEST
    steps = span.end_time / span.time_step
    about = motion.displacements - motion.displacements.mean(axis=0)
    speed = np.diff(motion.displacements, axis=0) / np.diff(motion.times)[:, None, None]
    spread = float((about**2).mean())
    if spread == 0.0:
        return 0.0
    frequency = math.sqrt(float((speed**2).mean()) / spread)
    return math.sqrt(steps) * UNIT_ROUNDING / (frequency * span.time_step)
