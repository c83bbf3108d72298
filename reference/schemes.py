"""Which schemes there are, and what each does to an oscillation; importable without FEniCSx.

All solve u' = v, v' = a(u, t) - lambda v with a = M^-1 (F - R) and lumped M. From a state at t to
one a step dt later, which is marked by a plus:

    central differences    (u+ - 2 u + u-) / dt^2 = a(u, t) - lambda (u+ - u-) / (2 dt)
    semi-implicit Euler    v+ = v + dt (a(u, t) - lambda v+),          u+ = u + dt v+
    backward Euler         v+ = v + dt (a(u+, t+) - lambda v+),        u+ = u + dt v+
    BDF2                   3 v+ - 4 v + v- = 2 dt (a(u+, t+) - lambda v+),
                           3 u+ - 4 u + u- = 2 dt v+;                  first by backward Euler
    trapezoidal rule       v+ = v + dt/2 (a - lambda v + a+ - lambda v+),  u+ = u + dt/2 (v + v+)
    implicit midpoint      v+ = v + dt (a((u + u+)/2, t + dt/2) - lambda (v + v+)/2),
                           u+ = u + dt/2 (v + v+)

E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2nd ed. 2006: I.1.1 (explicit,
implicit and symplectic Euler, midpoint), I.1.4 (central differences, there called Störmer and
Verlet), II.1.1 (trapezoidal rule); E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary
Differential Equations I, 2nd ed. 1993: eq. III.1.22' (BDF2). Damping is taken where forces are,
but in semi-implicit Euler at the end, so that no lambda makes it unstable. Stiffness damping is
taken where forces are in all, with the velocity there; in the explicit ones with that of the step
before, which is that from the last state to this.

Projective dynamics, XPBD, vertex block descent and other minimisers of an incremental potential
are backward Euler, solved more or less well.

An implicit scheme is one balance for the displacement at the end of a step.

With u+ that displacement and lumped M:

    M (acceleration(u+) + lambda velocity(u+)) = F(t + theta dt, u_f) - R(u_f),
    u_f = theta u+ + (1 - theta) u,   acceleration = A u+ - p,   velocity = B u+ - q,

R that of the velocity too where stiffness damping adds to it.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem


class Integrator(StrEnum):
    """A scheme of this module, by its name.

    >>> Integrator("bdf2").order
    2
    """

    CENTRAL_DIFFERENCES = "central-differences"
    SEMI_IMPLICIT_EULER = "semi-implicit-euler"
    BACKWARD_EULER = "backward-euler"
    BDF2 = "bdf2"
    TRAPEZOIDAL = "trapezoidal"
    IMPLICIT_MIDPOINT = "implicit-midpoint"

    @property
    def order(self) -> int:
        """Of the error of a smooth motion in the time step."""
        return 1 if self in (Integrator.SEMI_IMPLICIT_EULER, Integrator.BACKWARD_EULER) else 2

    @property
    def is_implicit(self) -> bool:
        """Whether a step solves equations; the others are stable only for omega dt < 2."""
        return self not in (Integrator.CENTRAL_DIFFERENCES, Integrator.SEMI_IMPLICIT_EULER)


@dataclass(frozen=True)
class Steps:
    """How a simulator steps: its scheme and its time step.

    Args:
        integrator: The scheme.
        time_step: [s], > 0.

    Raises:
        InputError: A step that is not above 0.
    """

    integrator: Integrator
    time_step: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "integrator", read_integrator(self.integrator))
        if not (math.isfinite(self.time_step) and self.time_step > 0.0):
            raise InputError(f"time_step = {self.time_step:g} s: needs a finite value above 0")

    def __str__(self) -> str:
        return f"{self.integrator}, steps of {self.time_step:g} s"

    def of(self, problem: Problem) -> Problem:
        """The motion with this time step.

        Raises:
            InputError: The problem is no motion.
        """
        if problem.time is None:
            raise InputError(f"{self}: a case without [time] takes no steps; leave them out")
        return replace(problem, time=replace(problem.time, time_step=self.time_step))


def read_integrator(name: str) -> Integrator:
    """A scheme by its name.

    Raises:
        InputError: There is none of that name; the message lists them.
    """
    try:
        return Integrator(name)
    except ValueError:
        raise InputError(f"integrator {name!r}: known are {', '.join(Integrator)}") from None


def amplification(integrator: Integrator, omega_dt: float) -> complex:
    """Factor z of a step on an undamped oscillation u'' = -omega^2 u: states go as z^n [-].

    Of the two of a second-order equation the one that turns forwards; of BDF2, which has two more,
    the one that tends to exp(i omega dt).

    Args:
        integrator: The scheme.
        omega_dt: Angle of a step omega dt [rad], > 0.

    Raises:
        InputError: A step that is not above 0, or at which an explicit scheme is unstable.
    """
    w = omega_dt
    if not (math.isfinite(w) and w > 0.0):
        raise InputError(f"omega_dt = {w:g}: needs a finite value above 0")
    if not integrator.is_implicit and w >= 2.0:
        raise InputError(f"omega_dt = {w:g}: {integrator} is stable below 2 only; shorten the step")
    match integrator:
        case Integrator.CENTRAL_DIFFERENCES | Integrator.SEMI_IMPLICIT_EULER:
            return cmath.exp(2j * math.asin(0.5 * w))  # z - 2 + 1/z = -w^2
        case Integrator.BACKWARD_EULER:
            return 1.0 / (1.0 - 1j * w)
        case Integrator.BDF2:
            return complex((2.0 + cmath.sqrt(1.0 + 2j * w)) / (3.0 - 2j * w))
        case Integrator.TRAPEZOIDAL | Integrator.IMPLICIT_MIDPOINT:
            return (1.0 + 0.5j * w) / (1.0 - 0.5j * w)


def numerical_damping_ratio(integrator: Integrator, omega_dt: float) -> float:
    """Damping ratio with which an undamped oscillation decays by the scheme alone [-], >= 0.

    -ln|z| / arg z, as of a damped oscillator: T. J. R. Hughes, The Finite Element Method, 1987,
    eq. 9.1.30 with arg z for the frequency. About omega dt / 2 for backward Euler,
    (omega dt)^3 / 4 for BDF2, 0 for the others.

    Args:
        integrator: The scheme.
        omega_dt: Angle of a step omega dt [rad], > 0.

    Raises:
        InputError: As `amplification`.
    """
    z = amplification(integrator, omega_dt)
    if integrator not in (Integrator.BACKWARD_EULER, Integrator.BDF2):
        return 0.0  # |z| = 1 but for rounding
    return -math.log(abs(z)) / cmath.phase(z)


def frequency_ratio(integrator: Integrator, omega_dt: float) -> float:
    """Frequency of the oscillation by the scheme over the true one, arg z / (omega dt) [-].

    Args:
        integrator: The scheme.
        omega_dt: Angle of a step omega dt [rad], > 0.

    Raises:
        InputError: As `amplification`.
    """
    return float(np.angle(amplification(integrator, omega_dt))) / omega_dt


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
    """A step of an implicit scheme from a state; the equations stand above."""
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
