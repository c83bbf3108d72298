"""Time integration schemes and their numerical damping; importable without FEniCSx.

All solve u' = v, v' = a(u, t) - lambda v with a = M^-1 (F - R) and lumped M. A plus marks the state
at the end of a step dt from a state at t:

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
Differential Equations I, 2nd ed. 1993: eq. III.1.22' (BDF2). Mass damping is evaluated at the time
of the forces, but in semi-implicit Euler at the end, so that no lambda makes it unstable. Stiffness
damping is evaluated with the forces in all schemes, with the velocity at their time; in the
explicit ones with that of the step before, from the last state to this one.

Projective dynamics, XPBD, vertex block descent and other minimisers of an incremental potential
are backward Euler, solved more or less exactly.

The reference for motions is the generalised-alpha method (J. Chung, G. M. Hulbert, J. Appl. Mech.
60 (1993) 371-375): forces at t + (1 - alpha_f) dt, accelerations at t + (1 - alpha_m) dt, with
Newmark's formulas

    u+ = u + dt v + dt^2 ((1/2 - beta) a + beta a+),   v+ = v + dt ((1 - gamma) a + gamma a+).

A step of any implicit scheme is one balance for the displacement u+ at its end,

    M (acceleration + lambda velocity) = F(t + theta dt, u_f) - R(u_f),
    u_f = theta u+ + (1 - theta) u,   acceleration = A (u+ - u) - p,   velocity = B (u+ - u) - q,

where R depends on the velocity too if there is stiffness damping.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, TimeSpan


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
        """Order in the time step of the error of a smooth motion."""
        return 1 if self in (Integrator.SEMI_IMPLICIT_EULER, Integrator.BACKWARD_EULER) else 2

    @property
    def is_implicit(self) -> bool:
        """Whether a step solves equations; the others are stable only for omega dt < 2."""
        return self not in (Integrator.CENTRAL_DIFFERENCES, Integrator.SEMI_IMPLICIT_EULER)


@dataclass(frozen=True)
class Steps:
    """The scheme of a simulator and its time step.

    Args:
        integrator: The scheme.
        time_step: [s], > 0.

    Raises:
        InputError: The step is not above 0.
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
        """The problem with this time step.

        Raises:
            InputError: The problem has no time span.
        """
        if problem.time is None:
            raise InputError(f"{self}: a case without [time] takes no steps; leave them out")
        return replace(problem, time=replace(problem.time, time_step=self.time_step))


def stated_steps(problem: Problem, method: str) -> tuple[TimeSpan, float, int]:
    """Time span, time step [s], and whole steps from one output to the next.

    Raises:
        InputError: There is no time step, which `method` needs, or outputs are not whole steps
            apart.
    """
    span = problem.time
    if span is None or span.time_step is None:
        raise InputError(f"{method} needs a time span with its time_step given")
    dt = span.time_step
    per_output = round(span.end_time / span.num_outputs / dt)
    if not are_whole_steps_apart(span, dt):
        raise InputError(
            f"{span.num_outputs} outputs to {span.end_time:g} s are not whole steps of {dt:g} s "
            "apart; choose end_time as num_outputs times a multiple of time_step"
        )
    return span, dt, per_output


def are_whole_steps_apart(span: TimeSpan, time_step: float) -> bool:
    """Whether the outputs of a time span are one whole number of steps [s] apart, at least one."""
    per_output = round(span.end_time / span.num_outputs / time_step)
    off = abs(per_output * time_step * span.num_outputs - span.end_time)
    return per_output >= 1 and off <= 1e-9 * time_step


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
    """Amplification factor z of an undamped oscillation u'' = -omega^2 u: states go as z^n [-].

    Of the two factors of a second-order equation the one with arg z > 0; of the four of BDF2 that
    which tends to exp(i omega dt), for an angle of a step omega dt > 0 [rad].

    Raises:
        InputError: The step is not above 0, or an explicit scheme is unstable.
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

    It is -ln|z| / arg z, as for a damped oscillator: T. J. R. Hughes, The Finite Element Method,
    1987, eq. 9.1.30 with arg z for the frequency. It is about omega dt / 2 for backward Euler,
    (omega dt)^3 / 4 for BDF2, and 0 for the others.

    Raises:
        InputError: As `amplification`.
    """
    z = amplification(integrator, omega_dt)
    if integrator not in (Integrator.BACKWARD_EULER, Integrator.BDF2):
        return 0.0  # |z| = 1 except for rounding
    return -math.log(abs(z)) / cmath.phase(z)


def frequency_ratio(integrator: Integrator, omega_dt: float) -> float:
    """Frequency of the computed oscillation over the exact one, arg z / (omega dt) [-].

    Raises:
        InputError: As `amplification`.
    """
    return float(np.angle(amplification(integrator, omega_dt))) / omega_dt


@dataclass(frozen=True)
class AlphaMethod:
    """The parameters of the generalised-alpha method.

    Args:
        spectral_radius: Value at infinite frequency [-], 0 to 1 (eq. 25 of Chung and Hulbert).
    """

    spectral_radius: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise InputError(f"spectral_radius = {self.spectral_radius:g}: needs 0 to 1")

    @property
    def alpha_m(self) -> float:
        """Accelerations are evaluated at t + (1 - alpha_m) dt."""
        return (2.0 * self.spectral_radius - 1.0) / (self.spectral_radius + 1.0)

    @property
    def alpha_f(self) -> float:
        """Forces are balanced at t + (1 - alpha_f) dt."""
        return self.spectral_radius / (self.spectral_radius + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma, for second order (eq. 17)."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's beta, for the most damping at high frequencies (eq. 20)."""
        return 0.25 * (1.0 - self.alpha_m + self.alpha_f) ** 2


@dataclass(frozen=True, eq=False)
class State:
    """The state of a motion; all vectors are flat.

    Attributes:
        u: Displacement [m].
        v: Velocity [m/s].
        a: Acceleration [m/s2], damping included.
        before: The state a step earlier; None at the start.
        external_work: Work of external forces since the start [J].
        damping_work: Energy dissipated by damping since the start [J].
    """

    u: Floats
    v: Floats
    a: Floats
    before: State | None = None
    external_work: float = 0.0
    damping_work: float = 0.0


@dataclass(frozen=True, eq=False)
class Stencil:
    """The numbers and vectors of the balance above, for a step from a state.

    `alpha_m` of the generalised-alpha method; 0 for the other schemes.
    """

    state: State
    time_step: float
    theta: float
    A: float
    p: Floats
    B: float
    q: Floats | float
    alpha_m: float = 0.0

    def acceleration(self, u: Floats) -> Floats:
        """Acceleration in the balance of forces [m/s2]."""
        return self.A * (u - self.state.u) - self.p

    def velocity(self, u: Floats) -> Floats:
        """Velocity that damping acts on [m/s]."""
        return self.B * (u - self.state.u) - self.q

    def middle(self, u: Floats) -> Floats:
        """The displacement at which forces are evaluated [m]."""
        return u if self.theta == 1.0 else self.theta * u + (1.0 - self.theta) * self.state.u

    def after(self, u: Floats) -> State:
        """The state at the end of the step from its displacement."""
        old, theta, alpha_m = self.state, self.theta, self.alpha_m
        v = (self.velocity(u) - (1.0 - theta) * old.v) / theta
        a = (self.acceleration(u) - alpha_m * old.a) / (1.0 - alpha_m)
        # Store no longer a history than a scheme needs.
        return State(u, v, a, State(old.u, old.v, old.a))


def stencil_of(scheme: Integrator | AlphaMethod, state: State, time_step: float) -> Stencil:
    """The step of an implicit scheme from a state; the equations are in the module's docstring."""
    v, a, dt = state.v, state.a, time_step
    old = state.before
    match scheme:
        case AlphaMethod():
            alpha_m, theta, beta, gamma = (
                scheme.alpha_m, 1.0 - scheme.alpha_f, scheme.beta, scheme.gamma,
            )  # fmt: skip
            # a+ = (u+ - u) / (beta dt^2) - known.
            known = v / (beta * dt) + (0.5 / beta - 1.0) * a
            A, B = (1.0 - alpha_m) / (beta * dt**2), theta * gamma / (beta * dt)
            p = (1.0 - alpha_m) * known - alpha_m * a
            q = theta * dt * (gamma * known - (1.0 - gamma) * a) - v
            return Stencil(state, dt, theta, A, p, B, q, alpha_m)
        case Integrator.BDF2 if old is not None:
            B, q = 1.5 / dt, (state.u - old.u) / (2.0 * dt)
            p = 1.5 * q / dt + (4.0 * v - old.v) / (2.0 * dt)
            return Stencil(state, dt, 1.0, 1.5 * B / dt, p, B, q)
        case Integrator.BACKWARD_EULER | Integrator.BDF2:
            return Stencil(state, dt, 1.0, 1.0 / dt**2, v / dt, 1.0 / dt, 0.0)
        case Integrator.TRAPEZOIDAL:
            return Stencil(state, dt, 1.0, 4.0 / dt**2, 4.0 * v / dt + a, 2.0 / dt, v)
        case Integrator.IMPLICIT_MIDPOINT:
            return Stencil(state, dt, 0.5, 2.0 / dt**2, 2.0 * v / dt, 1.0 / dt, 0.0)
    raise ValueError(f"{scheme} solves no equations")
