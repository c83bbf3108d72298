"""Laws by the invariants of C, derived by scalars first: W(I, II, J), their stress and tangent.

Of sums of stretches (`stretch_powers`) UFL's derivative by the displacement compiles for
minutes: it carries every direction through every step. Here W is derived by its three invariants,
which are scalars, and only these by F:

    P = sum of W_a dI_a/dF,   dP = sum of W_ab dI_a/dF (dI_b/dF : dF) + sum of W_a d(dI_a/dF)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from palpate.reference.fenicsx import ufl


class LawOfInvariants:
    """A density W(I, II, J), with I = tr C, II = (I^2 - tr C^2) / 2 and J = det F.

    Args:
        F: Deformation gradient.
        density: W of I, II and J [J/m3].

    Attributes:
        energy_density: W [J/m3].
        stress: P = dW/dF [Pa].
    """

    def __init__(self, F: Any, density: Callable[[Any, Any, Any], Any]) -> None:
        F = ufl.variable(F)
        C = F.T * F
        first = ufl.tr(C)
        invariants = (first, (first**2 - ufl.tr(C * C)) / 2, ufl.det(F))
        scalars = [ufl.variable(of) for of in invariants]
        self.energy_density = density(*scalars)
        self._slopes = [ufl.diff(self.energy_density, of) for of in scalars]
        self._bends = [[ufl.diff(slope, of) for of in scalars] for slope in self._slopes]
        self._rates = [ufl.diff(of, F) for of in invariants]
        self.stress = sum(s * rate for s, rate in zip(self._slopes, self._rates, strict=True))

    def work_change(self, u: Any, v: Any, du: Any) -> Any:
        """The derivative of P : grad v by u along du."""
        along_v = [ufl.inner(rate, ufl.grad(v)) for rate in self._rates]
        along_du = [ufl.inner(rate, ufl.grad(du)) for rate in self._rates]
        change: Any = 0
        for a, row in enumerate(self._bends):
            change += self._slopes[a] * ufl.derivative(along_v[a], u, du)
            change += along_v[a] * sum(bend * d for bend, d in zip(row, along_du, strict=True))
        return change
