"""Linear systems of the judge's own bodies, without a matrix: gradients scaled by the diagonal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from palpate.meshes.arrays import Points
from palpate.reference.errors import ReferenceFailedError

Product: TypeAlias = Callable[[Points], Points]

# Rounding ends any hope of convergence long before.
_MOST_ITERATIONS = 20_000


class NotPositiveDefiniteError(ArithmeticError):
    """A symmetric matrix has a direction of no or negative curvature, or one has no inverse."""


def conjugate_gradients(
    product: Product, right: Points, diagonal: Points, *, tolerance: float
) -> Points:
    """Solve A x = b for a symmetric A, or find that it is not positive definite.

    J. R. Shewchuk, An introduction to the conjugate gradient method without the agonizing pain,
    1994, section B3, with the diagonal as preconditioner.

    Args:
        product: A x.
        right: b, (num_points, 3); as x, 0 where held.
        diagonal: Positive, near A's own.
        tolerance: Of the residual over b, both scaled by the diagonal.

    Raises:
        NotPositiveDefiniteError: A direction p on the way has p . A p <= 0. From a random b any
            negative eigenvalue shows before the residual is small.
        ReferenceFailedError: No convergence.
    """
    solution, residual = np.zeros_like(right), right.copy()
    scaled = residual / diagonal
    direction, size = scaled, float(np.vdot(residual, scaled))
    wanted = tolerance**2 * size
    for _ in range(_MOST_ITERATIONS):
        if size <= wanted:
            return solution
        image = product(direction)
        curvature = float(np.vdot(direction, image))
        if not curvature > 0.0:
            raise NotPositiveDefiniteError
        step = size / curvature
        solution += step * direction
        residual -= step * image
        scaled = residual / diagonal
        before, size = size, float(np.vdot(residual, scaled))
        direction = scaled + size / before * direction
    raise _no_convergence()


def stabilised_gradients(
    product: Product, right: Points, diagonal: Points, *, tolerance: float
) -> Points:
    """Solve A x = b where A is not symmetric: the stabilised bi-conjugate gradients.

    H. A. van der Vorst, SIAM J. Sci. Stat. Comput. 13 (1992) 631-644. Arguments and errors are
    those of `conjugate_gradients`; NotPositiveDefiniteError where the recurrence breaks down.
    """
    root = np.sqrt(diagonal)
    solution, residual = np.zeros_like(right), right / root
    shadow, direction = residual, residual
    product_of_both = wanted = float(np.vdot(shadow, residual))
    wanted *= tolerance**2
    for _ in range(_MOST_ITERATIONS):
        if float(np.vdot(residual, residual)) <= wanted:
            found: Points = solution / root
            return found
        image = product(direction / root) / root
        step = product_of_both / float(np.vdot(shadow, image))
        half = residual - step * image
        image_of_half = product(half / root) / root
        turn = float(np.vdot(image_of_half, half)) / float(np.vdot(image_of_half, image_of_half))
        solution = solution + step * direction + turn * half
        residual = half - turn * image_of_half
        before, product_of_both = product_of_both, float(np.vdot(shadow, residual))
        grown = product_of_both / before * step / turn
        if not np.isfinite(grown):
            raise NotPositiveDefiniteError
        direction = residual + grown * (direction - turn * image)
    raise _no_convergence()


def _no_convergence() -> ReferenceFailedError:
    return ReferenceFailedError(
        f"the audit's linear solver found nothing in {_MOST_ITERATIONS} iterations: the mesh or "
        "material is too badly conditioned for it; audit on degree 2, which needs FEniCSx"
    )
