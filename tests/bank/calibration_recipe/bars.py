"""Bars between smooth walls, whose answer is a function of one coordinate and of time.

At rest, pulled or pushed by its own weight and at its end, Green strain: with sigma(x) what hangs
beyond x, M a (a^2 - 1) / 2 = sigma, M = lmbda + 2 mu, u = integral of a - 1; the real root is
a = 2 / sqrt(3) cos(arccos(3 sqrt(3) sigma / M) / 3). Layers of another stiffness are other M. A
pressed column gives way sideways, by shear, where mu a^2 + M (a^2 - 1) / 2 is no longer above 0.

In motion: rho (u'' + c u') = dP/dx + f A(t), u = 0 at x = 0 or moved there, P = M a (a^2 - 1) / 2
under Green strain, M (a - 1) under linear strain, mu du_y/dx of a bar that is sheared. By
Galerkin's method with polynomials over the whole bar and Runge-Kutta's in time; what more
polynomials change is how well the answer is known.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from calibration_recipe.answers import Answer, answer_of
from calibration_recipe.shapes import confined_modulus
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.problem import Inclusion, Material, Problem, Strain, TimeSpan
from palpate.validation.metrics.difference import make_state
from palpate.validation.states import Trajectory

_LENGTH = 1.0
_GAUSS = np.polynomial.legendre.leggauss(24)  # type: ignore[no-untyped-call]


def column_problem(
    *, nu: float, weight: float, end: float, stiffer: float, bricks: int
) -> tuple[Problem, Strain, Answer]:
    """A column at rest and its answer.

    Args:
        nu: Poisson's ratio.
        weight: Of the whole column over its section, along x: over what it bears where it is
            pressed, < 0, and over M or 3 mu, the smaller of them, where it is pulled.
        end: Traction at x = L along x, likewise; the two together above -1.
        stiffer: Young's modulus of the outer half over that of the inner one.
        bricks: Along x, even.
    """
    is_even = stiffer == 1.0
    mesh = brick_box((bricks, 2, 2), (_LENGTH, 0.4, 0.4), ragged=0.25 if is_even else 0.0)
    material = Material(1.0, nu, 1.0)
    outer = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5 * _LENGTH
    M = confined_modulus(material)
    weight, end = (_size_of(load, nu) for load in (weight, end))
    problem = Problem(
        mesh,
        material,
        rollers(mesh, ((0, 0.0), (1, 0.0), (1, 0.4), (2, 0.0), (2, 0.4))),
        (
            BodyForce((weight * M / _LENGTH, 0.0, 0.0)),
            Traction(side(mesh, 0, _LENGTH), (end * M, 0.0, 0.0)),
        ),
        inclusions=()
        if is_even
        else (Inclusion(np.flatnonzero(outer).astype(np.int32), Material(stiffer, nu, 1.0)),),
    )

    def exact(positions: Points) -> Points:
        x, of = np.unique(np.append(positions[:, 0], 0.5 * _LENGTH), return_inverse=True)
        start = np.append(0.0, x[:-1])
        inside = start[:, None] + (x - start)[:, None] * 0.5 * (1.0 + _GAUSS[0])
        load = end + weight * (1.0 - inside / _LENGTH)
        load = np.where(inside > 0.5 * _LENGTH, load / stiffer, load)
        steps = 0.5 * (x - start) * ((_stretch(load) - 1.0) @ _GAUSS[1])
        u = np.zeros_like(positions)
        u[:, 0] = np.cumsum(steps)[of.ravel()[:-1]]
        return u

    return problem, Strain.GREEN, answer_of(mesh, exact, Strain.GREEN, "quadrature", 1e-8)


def _size_of(load: float, nu: float) -> float:
    """A load of a column over M."""
    shear = (1.0 - 2.0 * nu) / (2.0 - 2.0 * nu)
    if load > 0.0:
        return load * min(1.0, 3.0 * shear)
    squared = max(0.5 / (0.5 + shear), 1.0 / 3.0)
    return load * math.sqrt(squared) * (1.0 - squared) / 2.0


def _stretch(load: Floats) -> Floats:
    """The stable root of a (a^2 - 1) / 2 = load."""
    angle = np.arccos(3.0 * np.sqrt(3.0) * load + 0j) / 3.0
    root: Floats = 2.0 / np.sqrt(3.0) * np.cos(angle).real
    return root


def motion_problem(
    *, kind: str, strain: str, nu: float, drive: str, size: float, damping: float,
    outputs: int = 24,
) -> tuple[Problem, Strain, Answer]:  # fmt: skip
    """A bar in motion and its answer.

    Args:
        kind: "stretch" or "shear" (linear strain).
        strain: "green" or "linear".
        nu: Poisson's ratio.
        drive: "weight", "end" (traction) or "shake" (the held end is moved), switched on smoothly.
        size: Of the drive: strain at the held end, or what it is moved by over the length.
        damping: c [1/s]; a wave takes 1 s along the bar.
        outputs: How many, over 6 s; the truth's steps are an eighth to a half of what lies between.
    """
    measure = Strain(strain) if kind == "stretch" else Strain.LINEAR
    width = 0.25
    mesh = brick_box((4, 1, 1), (_LENGTH, width, width))
    plain = Material(1.0, nu, 1.0)
    modulus = confined_modulus(plain) if kind == "stretch" else 0.5 / (1.0 + nu)
    # So that the wave speed is one.
    material = Material(1.0 / modulus, nu, 1.0)
    axis = 0 if kind == "stretch" else 1
    rise = TabularAmplitude((0.0, 1.5), (0.0, 1.0), is_smooth=True)
    along = (size, 0.0, 0.0) if axis == 0 else (0.0, size, 0.0)
    moved = along if drive == "shake" else (0.0, 0.0, 0.0)
    base = Support(np.unique(side(mesh, 0, 0.0)), side(mesh, 0, 0.0), displacement=moved,
                   amplitude=rise if drive == "shake" else None)  # fmt: skip
    walls = rollers(mesh, ((2, 0.0), (2, width)))
    for position in (0.0, width):
        holds = (axis == 1, axis == 0, False)
        walls += (support_of(side(mesh, 1, position), holds),)
    loads: tuple[BodyForce | Traction, ...] = ()
    if drive == "weight":
        loads = (BodyForce(along, rise),)
    elif drive == "end":
        loads = (Traction(side(mesh, 0, _LENGTH), along, rise),)
    span = TimeSpan(end_time=6.0, mass_damping=damping, num_outputs=outputs)
    problem = Problem(mesh, material, (base, *walls), loads, span)
    x = np.unique(np.round(mesh.points[:, 0], 12))
    where = np.searchsorted(x, np.round(mesh.points[:, 0], 12))
    times = np.linspace(0.0, span.end_time, span.num_outputs + 1)
    coarse, fine = (
        _march(measure, drive, size, damping, rise, times, x, number) for number in (14, 20)
    )
    doubt = float(np.abs(fine - coarse).max() / np.abs(fine).max())
    u = np.zeros((len(times), mesh.num_points, 3))
    u[:, :, axis] = fine[:, where]
    state = make_state(
        mesh, u[-1], label="one dimension", simulator="known", strain=measure,
        trajectory=Trajectory(times, u),
    )  # fmt: skip
    return problem, measure, Answer(state, {"": doubt})


def _march(
    strain: Strain,
    drive: str,
    size: float,
    damping: float,
    rise: TabularAmplitude,
    times: Points,
    x: Points,
    number: int,
) -> Floats:
    """Displacement at x over time, (num_times, len(x)), with a number of polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * number)  # type: ignore[no-untyped-call]
    value, slope = _basis(0.5 * (nodes + 1.0), number)
    weights = 0.5 * weights
    mass = (value * weights) @ value.T
    # Of what is known beforehand: a body force, a force at the end, or the frame's inertia.
    end, whole = _basis(np.ones(1), number)[0][:, 0], value @ weights
    forms = {"weight": whole, "end": end, "shake": -whole}
    push = np.linalg.solve(mass, size * forms[drive])
    inner = np.linalg.solve(mass, slope * weights)
    last = rise.times[-1]

    def factor(t: float) -> float:
        if drive != "shake":
            return rise(t)
        s = min(t / last, 1.0)
        rate = 30.0 * (s * (1.0 - s)) ** 2 / last
        return 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / last**2 + damping * rate

    def pull(q: Floats, v: Floats, t: float) -> Floats:
        a = 1.0 + slope.T @ q
        stress = 0.5 * a * (a * a - 1.0) if strain is Strain.GREEN else a - 1.0
        force: Floats = push * factor(t) - damping * v - inner @ stress
        return force

    def rate(t: float, y: Floats) -> Floats:
        q, v = np.split(y, 2)
        return np.concatenate([v, pull(q, v, t)])

    span, rest = (0.0, times[-1]), np.zeros(2 * number)
    found = solve_ivp(rate, span, rest, "DOP853", t_eval=times, rtol=1e-11, atol=1e-14)
    frame = size * np.array([rise(t) for t in times]) if drive == "shake" else np.zeros(len(times))
    out: Floats = found.y[:number].T @ _basis(x, number)[0] + frame[:, None]
    return out


def _basis(x: Points, number: int) -> tuple[Floats, Floats]:
    """Polynomials that vanish at x = 0, and their slopes; shape (number, len(x))."""
    xi = 2.0 * x - 1.0
    legendre = np.polynomial.legendre
    values, slopes = [], []
    for n in range(number):
        series = np.zeros(n + 2)
        series[[n, n + 1]] = 1.0
        values.append(legendre.legval(xi, series))  # type: ignore[no-untyped-call]
        rate = legendre.legder(series)  # type: ignore[no-untyped-call]
        slopes.append(2.0 * legendre.legval(xi, rate))  # type: ignore[no-untyped-call]
    return np.array(values), np.array(slopes)
