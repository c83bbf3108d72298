"""A ring that a pressure sets swinging, and a bar that flies against a wall: motions in one
dimension.

The ring is a tube in plane strain that breathes under linear strain: with u of the radius,
rho R u'' = d(R s_r)/dR - s_t, s_r = (lmbda + 2 mu) u' + lmbda u / R, s_t with the two exchanged, by
Galerkin's method with polynomials of the radius and Runge-Kutta's in time. The eighth of it that is
solved has flat facets, which are the geometry part of its bars.

The bar moves between smooth walls under linear strain. It meets a rigid wall with the velocity v,
and by d'Alembert a front runs through it at the speed c of waves, behind which it rests; from the
free end a second one comes back, behind which it flies off with v. After 2 L / c it has left the
wall, as a whole: no motion has sharper fronts.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from calibration_recipe.answers import Answer
from calibration_recipe.round import wedge_of_tube
from calibration_recipe.shapes import confined_modulus
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.bricks import brick_box, rollers, side
from palpate.meshes.problem import InitialVelocity, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.validation.metrics.difference import make_state
from palpate.validation.states import Trajectory

_INNER = 1.0
_END, _RISE, _PRESSURE = 6.0, 1.5, 0.02
_NUMBERS = (6, 8)  # of polynomials


def ring_problem(
    *, nu: float, outer: float, damping: float, outputs: int
) -> tuple[Problem, Strain, Answer]:
    """An eighth of a tube of Young's modulus 1 Pa between smooth walls, and its answer.

    Args:
        nu: Poisson's ratio.
        outer: Radius over the inner one, 1 m.
        damping: By mass [1/s].
        outputs: How many, over 6 s; a thin ring breathes in 2 pi s.
    """
    material = Material(1.0, nu, 1.0)
    rise = TabularAmplitude((0.0, _RISE), (0.0, 1.0), is_smooth=True)
    mesh, supports, inside = wedge_of_tube(outer, 3)
    span = TimeSpan(end_time=_END, num_outputs=outputs, mass_damping=damping)
    problem = Problem(mesh, material, supports, (Pressure(inside, _PRESSURE, rise),), span)
    times, lengths = span.output_times, np.linalg.norm(mesh.points[:, :2], axis=1)
    coarse, fine = (breathe(material, outer, damping, rise, times, lengths, n) for n in _NUMBERS)
    doubt = float(np.abs(fine - coarse).max() / np.abs(fine).max())
    along = mesh.points * [1.0, 1.0, 0.0] / lengths[:, None]
    u = fine[:, :, None] * along
    state = make_state(
        mesh, u[-1], label="radial", simulator="known", strain=Strain.LINEAR,
        trajectory=Trajectory(times, u),
    )  # fmt: skip
    answer = Answer(state, {"": doubt}, surface="cylinders", radii=(_INNER, outer))
    return problem, Strain.LINEAR, answer


def breathe(
    material: Material,
    outer: float,
    damping: float,
    rise: TabularAmplitude,
    times: Floats,
    radii: Floats,
    number: int,
) -> Floats:
    """u at radii over time, (num_times, n), with a number of polynomials."""  # fmt: skip
    nodes, weights = np.polynomial.legendre.leggauss(2 * number)  # type: ignore[no-untyped-call]
    half = 0.5 * (outer - _INNER)
    R = _INNER + half * (nodes + 1.0)
    value, slope = _basis(nodes, number)
    slope, hoop = slope / half, value / R
    weights = weights * half * R
    stiff, mu = confined_modulus(material), 0.5 / (1.0 + material.poissons_ratio)
    cross = (slope * weights) @ hoop.T
    stiffness = stiff * ((slope * weights) @ slope.T + (hoop * weights) @ hoop.T)
    stiffness += (stiff - 2.0 * mu) * (cross + cross.T)
    back = np.linalg.inv((value * weights) @ value.T)
    push = back @ (_PRESSURE * _INNER * _basis(np.array([-1.0]), number)[0][:, 0])
    inner = back @ stiffness

    def rate(t: float, y: Floats) -> Floats:
        q, v = np.split(y, 2)
        return np.concatenate([v, rise(t) * push - inner @ q - damping * v])

    found = solve_ivp(
        rate, (0.0, times[-1]), np.zeros(2 * number), "DOP853", t_eval=times, rtol=1e-10, atol=1e-14
    )
    at = (np.clip(radii, _INNER, outer) - _INNER) / half - 1.0
    out: Floats = found.y[:number].T @ _basis(at, number)[0]
    return out


def _basis(xi: Floats, number: int) -> tuple[Floats, Floats]:
    """Legendre's polynomials and their slopes, shape (number, len(xi))."""
    legendre = np.polynomial.legendre
    one = np.eye(number)
    return (
        legendre.legval(xi, one),  # type: ignore[no-untyped-call]
        legendre.legval(xi, legendre.legder(one)),  # type: ignore[no-untyped-call]
    )


def impact_problem(
    *, nu: float, speed: float, gap: float, outputs: int
) -> tuple[Problem, Strain, Answer]:
    """A bar that meets a wall with a velocity along itself, and its answer.

    Args:
        nu: Poisson's ratio.
        speed: Its own over that of waves.
        gap: To the wall at the start, over what it flies while a wave runs along it.
        outputs: How many, until twice the time that it touches the wall.
    """
    length, width, apart = 1.0, 0.25, gap * speed
    mesh = brick_box((8, 1, 1), (length, width, width))
    plain = Material(1.0, nu, 1.0)
    # So that the speed of waves is one.
    material = Material(1.0 / confined_modulus(plain), nu, 1.0)
    walls = rollers(mesh, ((1, 0.0), (1, width), (2, 0.0), (2, width)))
    half = np.sqrt(0.5)
    # The plane's normal, z of its frame, along x.
    path = ToolPath(np.array([0.0]), np.array([[-apart, 0.0, 0.0]]),
                    np.array([[half, 0.0, half, 0.0]]))  # fmt: skip
    wall = RigidTool(PlaneShape(), path, contact_facets=side(mesh, 0, 0.0))
    span = TimeSpan(end_time=gap + 4.0, num_outputs=outputs)
    problem = Problem(
        mesh, material, walls, (), span, tools=(wall,),
        initial_velocity=InitialVelocity((-speed, 0.0, 0.0)),
    )  # fmt: skip
    times = span.output_times
    u = np.zeros((len(times), mesh.num_points, 3))
    u[:, :, 0] = flight(times[:, None], mesh.points[:, 0], speed, gap)
    state = make_state(
        mesh, u[-1], label="d'Alembert", simulator="known", strain=Strain.LINEAR,
        trajectory=Trajectory(times, u),
    )  # fmt: skip
    return problem, Strain.LINEAR, Answer(state, {"": 1e-12})


def flight(times: Floats, x: Points, speed: float, gap: float) -> Floats:
    """Displacement along x; a wave takes 1 s along the bar, and the wall is met at t = gap."""
    arrives, leaves = gap + x, gap + 2.0 - x
    u: Floats = -speed * np.minimum(times, arrives) + speed * np.maximum(times - leaves, 0.0)
    return u
