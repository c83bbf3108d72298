"""Isotropic functions of strain by their principal values: value, first and second derivative.

For f of the principal values e_i of Green's strain E, with its directions n_i as a basis
(R. W. Ogden, Non-linear Elastic Deformations, 1984, section 6.1.4),

    df/dE    = sum of f_i n_i (x) n_i,
    d2f/dE2  = sum of f_ik (n_i n_i) (x) (n_k n_k)
             + sum over i < k of 2 (f_i - f_k) / (e_i - e_k) sym(n_i n_k) (x) sym(n_i n_k),

where the quotient of equal values is its limit, f_ii - f_ik. They are computed in NumPy: sums of
powers of stretches in UFL compile for minutes, and closed forms of eigenvalues have no derivative
at rest.

f(E), df/dE and d2f/dE2 are coefficients of forms, computed whenever a form is integrated, so that
the compiled form does not depend on the law. UFL treats coefficients as constants; their part of a
derivative is given by `changes`:

    dR = derivative of R by u, df/dE fixed  +  derivative of R by df/dE along d2f/dE2 : dE(u; du)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.reference import fenicsx
from palpate.reference.fenicsx import fem, ufl
from palpate.reference.laws import deformation_gradient, strain_tensor

# Where two principal values differ by less than this, relative to 1 + |e|, the limit of the
# quotient is taken: its error goes with the square of this, the rounding error with eps over this.
_SAME = 1e-5
_ROOT = np.sqrt(0.5)
# Rows and columns of a symmetric tensor in Mandel's order, and their weights in a product.
ROWS, COLUMNS = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])
WEIGHTS = np.array([1.0, 1.0, 1.0, *[np.sqrt(2.0)] * 3])
_PAIRS = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, eq=False)
class OfStrains:
    """A function of n triples of principal strains, with its derivatives.

    Values (n,), first derivatives by the strains (n, 3), second derivatives (n, 3, 3), symmetric.
    """

    value: Floats
    slope: Floats
    bend: Floats


PrincipalFunction = Callable[[Floats], OfStrains]


def _by_strains(value: Floats, slope: Floats, bend: Floats, squared: Floats) -> OfStrains:
    """Convert derivatives by the log. stretches s = ln l: e = (l^2 - 1) / 2, de/ds = l^2."""
    own = slope / squared
    by_two = bend / (squared[:, :, None] * squared[:, None, :])
    diagonal = np.arange(3)
    by_two[:, diagonal, diagonal] -= 2.0 * own / squared
    return OfStrains(value, own, by_two)


def _diagonal(values: Floats) -> Floats:
    return values[:, :, None] * np.eye(3)


def stretch_sum(e: Floats) -> OfStrains:
    """l_1 + l_2 + l_3 - 3 of principal strains e, (n, 3)."""
    squared = 1.0 + 2.0 * e
    stretch = np.sqrt(squared)
    value = (2.0 * e / (1.0 + stretch)).sum(axis=1)
    return _by_strains(value, stretch, _diagonal(stretch), squared)


def energy_of_stretches(
    law: Law, lmbda: Floats, mu: Floats, terms: Sequence[tuple[float, float]]
) -> PrincipalFunction:
    """Energy density W of principal strains by a law that is written in stretches [J/m3].

    Of moduli at rest [Pa], (n,); lmbda = 0 leaves out the volumetric energy. For Ogden's terms see
    `Material`.
    """
    if law is Law.COROTATIONAL:
        return lambda e: _corotational(e, lmbda, mu)
    if law is Law.OGDEN:
        return lambda e: _ogden(e, lmbda + 2.0 * mu / 3.0, mu, terms)
    raise ValueError(f"{law} is written in invariants: see laws")


def _corotational(e: Floats, lmbda: Floats, mu: Floats) -> OfStrains:
    squared = 1.0 + 2.0 * e
    l = np.sqrt(squared)  # noqa: E741
    less = 2.0 * e / (1.0 + l)
    total = less.sum(axis=1)
    value = mu * (less**2).sum(axis=1) + 0.5 * lmbda * total**2
    rate = 2.0 * mu[:, None] * less + (lmbda * total)[:, None]
    bend = _diagonal(l * (rate + 2.0 * mu[:, None] * l))
    bend += lmbda[:, None, None] * l[:, :, None] * l[:, None, :]
    return _by_strains(value, l * rate, bend, squared)


def _ogden(e: Floats, kappa: Floats, mu: Floats, terms: Sequence[tuple[float, float]]) -> OfStrains:
    squared = 1.0 + 2.0 * e
    s = 0.5 * np.log1p(2.0 * e)
    log_j = s.sum(axis=1)
    j = np.expm1(log_j)
    value = 0.5 * kappa * j**2
    slope = np.repeat((kappa * j * (1.0 + j))[:, None], 3, axis=1)
    bend = np.repeat((kappa * (1.0 + j) * (1.0 + 2.0 * j))[:, None], 9, axis=1).reshape(-1, 3, 3)
    isochoric = s - log_j[:, None] / 3.0
    for share, alpha in terms:
        own = 2.0 * mu * share / alpha
        z = alpha * isochoric
        less = np.expm1(z)
        mean = less.mean(axis=1, keepdims=True)
        # The sum of z is 0, and is subtracted so that no digits are lost near rest.
        value = value + own / alpha * (less - z).sum(axis=1)
        slope += own[:, None] * (less - mean)
        power = 1.0 + less
        more = _diagonal(power) - (power[:, :, None] + (less - mean)[:, None, :]) / 3.0
        bend += (own * alpha)[:, None, None] * more
    return _by_strains(value, slope, bend, squared)


def mandel(tensors: Floats) -> Floats:
    """Symmetric tensors (n, 3, 3) as rows of six, whose product is the double contraction."""
    rows: Floats = tensors[:, ROWS, COLUMNS] * WEIGHTS
    return rows


def of_tensors(E: Floats, function: PrincipalFunction) -> tuple[Floats, Floats, Floats]:
    """A function of Green strains, (n, 3, 3), with its derivatives, in Mandel's order.

    Value (n,), df/dE (n, 6), d2f/dE2 (n, 6, 6); NaN where E is not finite or the function has no
    value.
    """
    is_finite = np.isfinite(E).all(axis=(1, 2))
    e, along = np.linalg.eigh(np.where(is_finite[:, None, None], E, 0.0))
    e[~is_finite] = np.nan
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = function(e)
        diagonal = np.zeros((len(E), 6, 6))
        diagonal[:, :3, :3] = found.bend
        for k, (a, b) in enumerate(_PAIRS, start=3):
            apart = e[:, a] - e[:, b]
            is_same = np.abs(apart) <= _SAME * (1.0 + np.abs(e[:, a]))
            limit = 0.5 * (found.bend[:, a, a] + found.bend[:, b, b]) - found.bend[:, a, b]
            quotient = (found.slope[:, a] - found.slope[:, b]) / np.where(is_same, 1.0, apart)
            diagonal[:, k, k] = np.where(is_same, limit, quotient)
    # Columns: n_i n_i, then root 2 sym(n_i n_k).
    basis = np.empty((len(E), 6, 6))
    for k in range(3):
        n = along[:, :, k]
        basis[:, :, k] = mandel(n[:, :, None] * n[:, None, :])
    for k, (a, b) in enumerate(_PAIRS, start=3):
        n, m = along[:, :, a], along[:, :, b]
        both = n[:, :, None] * m[:, None, :]
        basis[:, :, k] = mandel(_ROOT * (both + both.transpose(0, 2, 1)))
    slope = np.einsum("pik,pk->pi", basis[:, :, :3], found.slope)
    bend: Floats = basis @ diagonal @ basis.transpose(0, 2, 1)
    return found.value, slope, bend


_UPPER = np.triu_indices(6)


class StrainCoefficients:
    """A function of Green's strain of a displacement in UFL, with its first two derivatives.

    `function` returns, for a number n, the function of the principal strains at n points of each
    cell, cell by cell, (n * num_cells, 3); n follows from the degree of the quadrature.

    Attributes:
        value: f in UFL.
        slope: df/dE in UFL, 3 x 3.
    """

    def __init__(
        self, mesh: Any, u: Any, function: Callable[[int], PrincipalFunction], degree: int
    ) -> None:
        self._u, self._function = u, function
        self._mesh, self._strain = mesh, strain_tensor(u, Strain.GREEN)
        points, _ = fenicsx.quadrature(degree)
        self._at_points = function(len(points))
        self._sample = fenicsx.evaluate_in_cells(mesh, self._strain, points)
        spaces = [fenicsx.quadrature_space(mesh, degree, size) for size in (1, 6, len(_UPPER[0]))]
        self._value, self._slope, self._bend = (fem.Function(space) for space in spaces)
        self._rows = [fenicsx.cell_dofs(space).ravel() for space in spaces]
        self.value, self.slope = self._value[0], _tensor(self._slope)
        self._last: Floats | None = None

    def update(self) -> None:
        """Compute the coefficients at u."""
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
        """Derivatives of a form by f and df/dE alone, of those that it contains, as u changes."""
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


def energy_by_cell(
    material: Material, lmbda: Any | None, mu: Any
) -> Callable[[int], PrincipalFunction]:
    """Energy density W of principal strains in each cell, by a law that is written in stretches.

    Lamé's parameters [Pa] are functions that are constant in each cell; None is 0. Returns, for a
    number of points in each cell, the function of their principal strains.
    """

    def function(num_points: int) -> PrincipalFunction:
        shear = np.repeat(fenicsx.cell_values(mu), num_points)
        first = 0.0 * shear
        if lmbda is not None:
            first = np.repeat(fenicsx.cell_values(lmbda), num_points)
        return energy_of_stretches(material.law, first, shear, material.ogden_terms)

    return function
