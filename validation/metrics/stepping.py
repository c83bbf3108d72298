"""The judge's own explicit motion, as stated or with one mistake: central differences in NumPy.

    (1/dt^2 + d/(2 dt)) a(t + dt) = (F - R(a(t))) / m + 2/dt^2 a(t) - (1/dt^2 - d/(2 dt)) a(t - dt)

from rest, a(-dt) = a(0) + dt^2/2 a''(0); lumped m, D = d M. Stiffness damping b adds to R the
forces of b C : (E(a(t)) - E(a(t - dt))) / dt. Only the first part of a motion is
stepped, as far as NumPy goes in a blink, to be compared with a stored trajectory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem
from palpate.validation.exchange.nodal_arrays import fixed_components, lumped_mass, sliding_points
from palpate.validation.metrics.body import Body, Mask
from palpate.validation.metrics.laws import LawOfCells
from palpate.validation.metrics.smoothing import Array

# Displacements beyond so many body sizes are a blow-up.
_FAR = 10.0


@dataclass(frozen=True, eq=False)
class MotionHypothesis:
    """A motion as the candidate may have understood it; the default is the problem as stated.

    Attributes:
        law: The law; None for the one asked for.
        lame: Lamé's parameters by cell; None for those asked for.
        mass: Lumped [kg], (num_points,); None for the right one.
        inverse_mass: Inverse of a full mass matrix [1/kg], (num_points, num_points); None: lumped.
        stiffness_factor: Factor of the internal force [-].
        load_factors: Factor of each load [-]; None for 1.
        is_other_pressure: Pressures follow the surface where they should not, or the reverse.
        damping: lambda of D = lambda M [1/s]; None for what was asked.
        viscosity: Factor of the stiffness damping [-].
        start: Factor of dt^2 a''(0) in the displacement a step before the first [-].
        is_semi_implicit: Semi-implicit Euler in the place of central differences.
        is_damped_at_end: With it, damping by the velocity at the end of a step.
        is_explicit_euler: Explicit Euler in the place of central differences.
        step_factor: Length of a step over what was asked, with as many steps.
        pieces: Steps for each that was asked.
        late: Steps that every stored state comes late.
        released: Fixed components that are not fixed.
        with_amplitudes: Whether loads and supports follow their amplitudes.
    """

    law: LawOfCells | None = None
    lame: tuple[Array, Array] | None = None
    mass: Points | None = None
    inverse_mass: Array | None = None
    stiffness_factor: float = 1.0
    load_factors: tuple[float, ...] | None = None
    is_other_pressure: bool = False
    damping: float | None = None
    viscosity: float = 1.0
    start: float = 0.5
    is_semi_implicit: bool = False
    is_damped_at_end: bool = False
    is_explicit_euler: bool = False
    step_factor: float = 1.0
    pieces: int = 1
    late: int = 0
    released: Mask | None = None
    with_amplitudes: bool = True


@dataclass(frozen=True, eq=False)
class Stepper:
    """Steps a body's motion to its first outputs, by `per_output` steps [s] to each."""

    body: Body
    step: float
    per_output: int
    num_outputs: int
    _mass: Points = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_mass", lumped_mass(self.body.problem))

    def outputs(self, hypothesis: MotionHypothesis) -> Iterator[Points]:
        """The state at each output after the first [m], (num_points, 3); ends at a blow-up."""
        body, span = self.body, self.body.problem.time
        assert span is not None
        dt = self.step * hypothesis.step_factor / hypothesis.pieces
        fixed = body.fixed if hypothesis.released is None else body.fixed & ~hypothesis.released
        damping = span.mass_damping if hypothesis.damping is None else hypothesis.damping
        size = float(np.ptp(body.mesh.points, axis=0).max())
        now = self._slid(np.where(fixed, self._prescribed(0.0, hypothesis), 0.0), 0.0, hypothesis)
        speed = self._speed_at_start(fixed)
        beta = hypothesis.viscosity * span.stiffness_damping / dt
        acceleration = self._acceleration(now, 0.0, hypothesis, beta, now - dt * speed)
        bend = hypothesis.start * dt**2 * (acceleration - damping * speed)
        before = np.where(fixed, now, now - dt * speed + bend)
        left, right = 1.0 / dt**2 + damping / (2.0 * dt), 1.0 / dt**2 - damping / (2.0 * dt)
        velocity = speed
        every = self.per_output * hypothesis.pieces
        for step in range(1, every * self.num_outputs + 1 + max(-hypothesis.late, 0)):
            acceleration = self._acceleration(now, (step - 1) * dt, hypothesis, beta, before)
            if hypothesis.is_explicit_euler:
                after = now + dt * velocity
                velocity = velocity + dt * (acceleration - damping * velocity)
            elif hypothesis.is_semi_implicit:
                if hypothesis.is_damped_at_end:
                    velocity = (velocity + dt * acceleration) / (1.0 + dt * damping)
                else:
                    velocity = velocity + dt * (acceleration - damping * velocity)
                after = now + dt * velocity
            else:
                after = (acceleration + 2.0 / dt**2 * now - right * before) / left
            after = np.where(fixed, self._prescribed(step * dt, hypothesis), after)
            after = self._slid(after, step * dt, hypothesis)
            if not np.abs(after).max() < _FAR * size:
                return
            before, now = now, after
            stored = step + hypothesis.late
            if stored > 0 and stored % every == 0:
                yield now

    def _acceleration(
        self,
        displacement: Points,
        time: float,
        hypothesis: MotionHypothesis,
        beta: float,
        before: Points,
    ) -> Points:
        """External less internal force over the mass [m/s2]; beta over the step [-]."""
        force = self.body.external(
            displacement,
            time if hypothesis.with_amplitudes else None,
            factors=hypothesis.load_factors,
            is_other=hypothesis.is_other_pressure,
        )
        force -= hypothesis.stiffness_factor * self.body.internal(
            displacement, hypothesis.law, hypothesis.lame
        )
        if beta:
            force -= beta * self.body.viscous(displacement, before)
        if hypothesis.inverse_mass is not None:
            solved: Points = hypothesis.inverse_mass @ force
            return solved
        mass = self._mass if hypothesis.mass is None else hypothesis.mass
        return force / mass[:, None]

    def _speed_at_start(self, fixed: Mask) -> Points:
        """The initial velocity of free components [m/s]."""
        problem = self.body.problem
        if problem.initial_velocity is None:
            return np.zeros_like(self.body.mesh.points)
        speed = np.where(fixed, 0.0, problem.initial_velocity.at(self.body.mesh.points))
        slopes = self.body.slopes
        return speed if slopes is None else slopes.without(speed)

    def _slid(self, displacement: Points, time: float, hypothesis: MotionHypothesis) -> Points:
        """The displacement with sliding points moved onto their planes [m]."""
        slopes, problem = self.body.slopes, self.body.problem
        if slopes is None:
            return displacement
        if hypothesis.with_amplitudes and any(s.amplitude for s in problem.supports):
            slopes = sliding_points(problem, time)
            assert slopes is not None
        return slopes.placed(displacement)

    def _prescribed(self, time: float, hypothesis: MotionHypothesis) -> Points:
        """Prescribed displacement of the fixed components [m]."""
        problem = self.body.problem
        is_moving = hypothesis.with_amplitudes and any(s.amplitude for s in problem.supports)
        return fixed_components(problem, time)[1] if is_moving else self.body.prescribed


def steps_per_output(problem: Problem) -> int:
    """Whole steps from one output to the next; 0 where the case states no step."""
    span = problem.time
    if span is None or span.time_step is None:
        return 0
    return round(span.end_time / span.num_outputs / span.time_step)
