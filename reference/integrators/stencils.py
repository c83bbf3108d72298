"""The implicit schemes of `schemes` as one balance for the displacement at the end of a step.

With u+ that displacement and lumped M:

    M (acceleration(u+) + lambda velocity(u+)) = F(t + theta dt, u_f) - R(u_f),
    u_f = theta u+ + (1 - theta) u,   acceleration = A u+ - p,   velocity = B u+ - q,

R that of the velocity too where stiffness damping adds to it.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.arrays import Floats
from palpate.reference.integrators.schemes import Integrator


@dataclass(frozen=True, eq=False)
class State:
    """Where a motion is: flat displacement [m], velocity [m/s] and acceleration [m/s2].

    Attributes:
        u: Displacement.
        v: Velocity.
        a: Acceleration, damping included; read by the trapezoidal rule.
        before: The state a step earlier; None at the start.
    """

    u: Floats
    v: Floats
    a: Floats
    before: State | None = None


@dataclass(frozen=True, eq=False)
class Stencil:
    """The numbers and vectors of the balance above; `after` makes the state from its solution."""

    theta: float
    A: float
    p: Floats
    B: float
    q: Floats
    integrator: Integrator
    state: State
    time_step: float

    def acceleration(self, u: Floats) -> Floats:
        """Rate of the velocity that the balance has where forces act [m/s2]."""
        return self.A * u - self.p

    def velocity(self, u: Floats) -> Floats:
        """That damping acts on [m/s]."""
        return self.B * u - self.q

    def place(self, u: Floats) -> Floats:
        """The displacement where forces act [m]."""
        return u if self.theta == 1.0 else self.theta * u + (1.0 - self.theta) * self.state.u

    def after(self, u: Floats) -> State:
        """The state at the end of the step from its displacement."""
        old, velocity = self.state, self.velocity(u)
        if self.integrator is Integrator.IMPLICIT_MIDPOINT:
            velocity = 2.0 * velocity - old.v
        last = State(old.u, old.v, old.a)  # no longer a history than a scheme reads
        return State(u, velocity, self.acceleration(u), last)


def stencil_of(integrator: Integrator, state: State, time_step: float) -> Stencil:
    """A step of an implicit scheme from a state; the equations stand in `schemes`."""
    u, v, dt = state.u, state.v, time_step
    old = state.before
    match integrator:
        case Integrator.BDF2 if old is not None:
            B, q = 1.5 / dt, (4.0 * u - old.u) / (2.0 * dt)
            given = 1.0, 1.5 * B / dt, 1.5 * q / dt + (4.0 * v - old.v) / (2.0 * dt), B, q
        case Integrator.BACKWARD_EULER | Integrator.BDF2:
            B, q = 1.0 / dt, u / dt
            given = 1.0, B / dt, (q + v) / dt, B, q
        case Integrator.TRAPEZOIDAL:
            B, q = 2.0 / dt, 2.0 * u / dt + v
            given = 1.0, 2.0 * B / dt, 2.0 * (q + v) / dt + state.a, B, q
        case Integrator.IMPLICIT_MIDPOINT:
            B, q = 1.0 / dt, u / dt
            given = 0.5, 2.0 * B / dt, 2.0 * (q + v) / dt, B, q
        case _:
            raise ValueError(f"{integrator} solves no equations")
    return Stencil(*given, integrator, state, dt)
