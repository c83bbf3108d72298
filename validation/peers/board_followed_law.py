"""Which law an answer is an equilibrium of, where it is not one of the law that was stated.

Every law that the judge knows is tried on the answer, by what it leaves of the equations. Newton's
method then goes from the answer to the equilibrium of the best one near it: what lies between that
and the equilibrium of the stated law is the law's, and what is left to the answer its solver's.
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.reference.errors import ReferenceFailedError
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.metrics.body import Body, imbalance
from palpate.validation.metrics.finite_laws import laws_instead_of_law
from palpate.validation.metrics.laws import Law
from palpate.validation.metrics.linear_solver import (
    NotPositiveDefiniteError,
    conjugate_gradients,
)

# Another law must leave at most this part of what the stated one leaves, of forces and of distance.
_EXPLAINS = 0.1
# Of complex steps, which cost no digits; see `finite_laws`.
_STEP = 1e-100
_TOLERANCE = 1e-6
_MOST_STEPS = 8


def followed_law(
    problem: Problem, strain: Strain, displacement: Points, stated: Points
) -> tuple[str, Points] | None:
    """The law and its equilibrium near an answer with plain linear tetrahedra.

    Args:
        problem: As stated, without tools.
        strain: As stated.
        displacement: The answer [m], (num_points, 3).
        stated: The equilibrium of the stated law on the same mesh [m].

    Returns:
        Its name and displacement; None where none explains the answer better than the stated law.
    """
    body = Body(problem, strain)
    external = body.external(displacement)
    own = imbalance(body.internal(displacement), external, body.free)
    left = {}
    for name, law in laws_instead_of_law(strain, body.law).items():
        found = imbalance(body.internal(displacement, law), external, body.free)
        if found <= _EXPLAINS * own:
            left[name] = found, law
    for name in sorted(left, key=lambda each: left[each][0]):
        near = _equilibrium(body, displacement, left[name][1])
        if near is not None and distance(displacement, near) <= _EXPLAINS * distance(
            displacement, stated
        ):
            return name, near
    return None


def _equilibrium(body: Body, displacement: Points, law: Law) -> Points | None:
    """Of another law, by Newton's method from nearby; None where it does not get there."""
    u = displacement + body.to_supports(displacement)
    for _ in range(_MOST_STEPS):
        internal, external = body.internal(u, law), body.external(u)
        if imbalance(internal, external, body.free) <= _TOLERANCE:
            return u
        H = body.gradient(u)

        def product(change: Points, H: Points = H) -> Points:
            stepped = H + 1j * _STEP * body.gradient(change)
            stress = np.imag(law(stepped, body.lmbda, body.mu)) / _STEP
            return body.freed(body.force_of(stress))

        try:
            right = body.freed(external - internal)
            u = u + conjugate_gradients(product, right, body.stiffness_diagonal, tolerance=1e-3)
        except (NotPositiveDefiniteError, ReferenceFailedError, np.linalg.LinAlgError):
            return None
    return None
