"""A load whose direction follows the body, in one form for statics, pressures apart, and motion."""

from __future__ import annotations

from typing import Any

from palpate.meshes.arrays import Floats
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, fem, ufl


class FollowerLoad:
    """The forces of a follower, and their derivative.

    Args:
        mesh: The dolfinx mesh.
        work: Virtual work of the full load, as a UFL form [J].
        unknown: The function that the work depends on; it holds its place for every call.
        trial: A trial function of the unknown's space.
    """

    def __init__(self, mesh: Any, work: Any, unknown: Any, trial: Any) -> None:
        self._force = fenicsx.form(work)
        # The tangent of R has the tangent of the load with a minus sign and a factor.
        self._factor = fem.Constant(mesh, PETSc.ScalarType(0.0))
        self._tangent = fenicsx.form(-self._factor * ufl.derivative(work, unknown, trial))

    def force(self) -> Floats:
        """Nodal forces of the full load [N], flat."""
        return fenicsx.assemble_vector(self._force)

    def add_tangent(self, matrix: Any, factor: float) -> None:
        """Add minus the derivative of the forces, times a factor."""
        self._factor.value = factor
        fenicsx.assemble_into_matrix(matrix, self._tangent)
