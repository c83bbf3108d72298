"""Small undamped swings about an equilibrium: K x = w^2 M x of the lowest frequencies.

K is the tangent at the equilibrium, M the lumped mass. Subspace iteration (K.-J. Bathe, Finite
Element Procedures, 2nd ed. 2014, section 11.6): each pass solves the tangent for M times every
vector and turns the vectors into the modes of the small problem that they span. Valid for swings
that leave the tangent as it is; a finite swing of a stiffening body is faster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim.errors import FastsimError
from palpate.fastsim.newton import smooth_direction
from palpate.fastsim.sensitivities import SoftTangentError, tangent_at
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain

# Relative change of every eigenvalue that is asked for, at which iteration ends.
_SETTLED = 1e-8
_MOST_PASSES = 60
# Bathe, section 11.6.2: min(2 p, p + 8) vectors for p modes.
_MORE_VECTORS = 8


class UnsettledSwingError(FastsimError):
    """Subspace iteration did not settle on the modes that were asked for."""

    def __init__(self, change: float) -> None:
        super().__init__(
            f"the lowest frequencies still change by {change:.1g} of themselves after "
            f"{_MOST_PASSES} passes; ask for more or fewer of them: two may be nearly the same"
        )


@dataclass(frozen=True, eq=False)
class Swings:
    """Modes of the lowest frequencies.

    Attributes:
        frequencies: [Hz], shape (count,), rising.
        modes: Shape (count, num_points, 3), with x^T M x = 1 kg m2.
        mass: Lumped at each point [kg], shape (num_points,).
    """

    frequencies: Floats
    modes: Floats
    mass: Floats

    def swings_from(self, displacement: Points) -> Floats:
        """The part of each mode in the swing of a body that is let go.

        Args:
            displacement: From equilibrium to where it is let go [m], shape (num_points, 3).

        Returns:
            The modes times their amplitude x^T M u [m], shape (count, num_points, 3).
        """
        amplitudes = np.tensordot(self.modes, self.mass[:, None] * displacement, 2)
        return np.asarray(amplitudes[:, None, None] * self.modes)


def find_swings(
    problem: Problem,
    displacement: Points,
    count: int = 3,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
) -> Swings:
    """Lowest frequencies of small swings about an equilibrium, and their modes.

    Args:
        problem: Static, without tools and without pressure that follows the body.
        displacement: Its equilibrium [m], shape (num_points, 3).
        count: How many, at least 1.
        strain: Strain measure of the equilibrium.
        element: Its tetrahedra.

    Returns:
        Frequencies and modes.

    Raises:
        InputError: A count below 1 or above the free components, or a problem with tools or with
            pressure that follows the body.
        SoftTangentError: The state is no stable equilibrium.
        UnsettledSwingError: Iteration did not settle.
    """
    newton, u = tangent_at(problem, displacement, strain, element, "small swings")
    mass = newton.body.lumped_mass[:, None]
    num_free = int(np.count_nonzero(newton.free_components))
    if not 1 <= count <= num_free:
        raise InputError(f"count = {count}: needs 1 to {num_free}, the number of free components")
    size = min(2 * count, count + _MORE_VECTORS, num_free)
    rng = np.random.default_rng(0)
    start = [smooth_direction(problem.mesh), *rng.standard_normal((size - 1, *u.shape))]
    still = np.zeros_like(u)
    vectors, values, change = np.array(start), np.full(count, np.inf), np.inf
    for _ in range(_MOST_PASSES):
        forces = mass * vectors
        solved = newton.responses_at(u, [(force, still) for force in forces])
        if any(x is None for x in solved):
            raise SoftTangentError
        shapes = np.array(solved)
        found = shapes.reshape(size, -1)
        stiffness = found @ forces.reshape(size, -1).T
        inertia = found @ (mass * shapes).reshape(size, -1).T
        eigenvalues, turn = _small_problem(stiffness, inertia)
        vectors = (turn.T @ found).reshape(size, *u.shape)
        change = float(np.max(np.abs(eigenvalues[:count] / values - 1.0)))
        values = eigenvalues[:count]
        if change < _SETTLED:
            return Swings(np.sqrt(values) / (2.0 * np.pi), vectors[:count], mass[:, 0])
    raise UnsettledSwingError(change)


def rayleigh_quotient(
    problem: Problem,
    displacement: Points,
    mode: Points,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
) -> float:
    """x^T K x / x^T M x of the tangent at a displacement: w^2 [rad2/s2] where x is a mode there.

    Args:
        problem: As in `find_swings`.
        displacement: Where the tangent is taken [m], shape (num_points, 3).
        mode: x, shape (num_points, 3), 0 where supports fix.
        strain: Strain measure.
        element: Its tetrahedra.

    Returns:
        The quotient: that of a mode moves with a number of the problem as its eigenvalue does.
    """
    newton, u = tangent_at(problem, displacement, strain, element, "small swings")
    mass = newton.body.lumped_mass[:, None]
    return float(np.sum(mode * newton.stiffness_times(u, mode)) / np.sum(mass * mode * mode))


def _small_problem(stiffness: Floats, inertia: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues, rising, and vectors x with x^T inertia x = 1 of a small symmetric problem."""
    lower = np.linalg.cholesky(0.5 * (inertia + inertia.T))
    half = np.linalg.solve(lower, 0.5 * (stiffness + stiffness.T))
    values, vectors = np.linalg.eigh(np.linalg.solve(lower, half.T))
    return values, np.linalg.solve(lower.T, vectors)
