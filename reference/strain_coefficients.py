"""Functions of strain by principal values, as coefficients of forms at the quadrature points.

f(E), df/dE and d2f/dE2 (`principal_laws`) are computed in NumPy where a form is integrated, and are
data of it: what is compiled does not know the law. Coefficients are constants to UFL; their part of
a derivative is asked for by `changes`:

    dR = derivative of R by u with df/dE held  +  derivative of R by df/dE along d2f/dE2 : dE(u; du)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Strain
from palpate.reference import fenicsx
from palpate.reference.fenicsx import fem, ufl
from palpate.reference.kinematics import deformation_gradient, strain_tensor
from palpate.reference.principal_laws import COLUMNS, ROWS, WEIGHTS, PrincipalFunction, of_tensors

_UPPER = np.triu_indices(6)


class StrainCoefficients:
    """A function of Green's strain of a displacement, with its first two derivatives.

    Args:
        mesh: Of dolfinx.
        u: Displacement in UFL.
        function: Makes of a number n the function of the principal strains at n points of each
            cell, cell by cell, (n * num_cells, 3).
        degree: Of the quadrature.

    Attributes:
        value: f in UFL.
        slope: df/dE in UFL, 3 x 3.
    """

    def __init__(
        self, mesh: Any, u: Any, function: Callable[[int], PrincipalFunction], degree: int
    ) -> None:
        self._u, self._function = u, function
        self._mesh, self._strain = mesh, strain_tensor(u, Strain.GREEN)
        points = fenicsx.quadrature_points(degree)
        self._at_points = function(len(points))
        self._sample = fenicsx.evaluate_in_cells(mesh, self._strain, points)
        spaces = [fenicsx.quadrature_space(mesh, degree, size) for size in (1, 6, len(_UPPER[0]))]
        self._value, self._slope, self._bend = (fem.Function(space) for space in spaces)
        self._rows = [fenicsx.cell_dofs(space).ravel() for space in spaces]
        self.value, self.slope = self._value[0], _tensor(self._slope)
        self._last: Floats | None = None

    def update(self) -> None:
        """Make the coefficients those of u."""
        E = self._sample().reshape(-1, 3, 3)
        if self._last is not None and np.array_equal(E, self._last):
            return
        value, slope, bend = of_tensors(E, self._at_points)
        rows = (value[:, None], slope, bend[:, _UPPER[0], _UPPER[1]])
        functions = (self._value, self._slope, self._bend)
        for function, where, given in zip(functions, self._rows, rows, strict=True):
            function.x.array.reshape(-1, given.shape[1])[where] = given
        self._last = E

    def changes(self, of: Any, direction: Any) -> list[Any]:
        """Derivatives of a form by f and df/dE alone, as far as it has them.

        Args:
            of: The form.
            direction: Along which u changes.
        """
        found = []
        if self._value in of.coefficients():
            along = ufl.inner(self.slope, self._strain_change(direction))
            found.append(ufl.derivative(of, self._value, ufl.as_vector([along])))
        if self._slope in of.coefficients():
            found.append(ufl.derivative(of, self._slope, self._slope_change(direction)))
        return found

    def _strain_change(self, direction: Any) -> Any:
        return ufl.sym(deformation_gradient(self._u).T * ufl.grad(direction))

    def _slope_change(self, direction: Any) -> Any:
        number = np.zeros((6, 6), dtype=int)
        number[_UPPER] = number.T[_UPPER] = np.arange(len(_UPPER[0]))
        bend = ufl.as_matrix([[self._bend[int(k)] for k in row] for row in number])
        dE = self._strain_change(direction)
        rows = zip(ROWS.tolist(), COLUMNS.tolist(), WEIGHTS.tolist(), strict=True)
        return bend * ufl.as_vector([w * dE[i, j] for i, j, w in rows])


def _tensor(rows: Any) -> Any:
    """The symmetric tensor of six components in Mandel's order."""
    number = np.zeros((3, 3), dtype=int)
    number[ROWS, COLUMNS] = number[COLUMNS, ROWS] = np.arange(6)
    return ufl.as_matrix([[rows[k] / WEIGHTS[k] for k in row] for row in number.tolist()])
