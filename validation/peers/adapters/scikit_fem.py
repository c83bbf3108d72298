"""scikit-fem: Saint-Venant-Kirchhoff as forms on linear tetrahedra; Newton's method.

palpate gate CASE --simulator "python scikit_fem.py {case} {result}"
"""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from harness import lame, load_parts, solve_case
from skfem.helpers import ddot, eye, grad, mul, trace, transpose

TOLERANCE = 1e-10
MOST_ITERATIONS = 40


class Static:
    """The load in four parts: from rest Newton's method does not reach large deflections."""

    tool, version, precision = "scikit-fem", skfem.__version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job = job
        self._is_linear = str(job["strain"]) == "linear"
        mesh = skfem.MeshTet(job["points"].T.copy(), job["cells"].T.astype(np.int64))
        element = skfem.ElementVector(skfem.ElementTetP1())
        # The gradients of linear tetrahedra are constant in a cell: one point is enough.
        self._basis = skfem.Basis(mesh, element, intorder=1)
        self._lame = lame(job)

    def _assemble(self, u: Any) -> tuple[Any, Any]:
        lmbda, mu = self._lame
        is_linear = self._is_linear

        def hooke(E: Any) -> Any:
            return lmbda * eye(trace(E), 3) + 2.0 * mu * E

        def stress(w: Any) -> tuple[Any, Any]:
            H = w["u"].grad
            F = eye(np.ones_like(H[0, 0]), 3) + (0.0 if is_linear else H)
            E = 0.5 * (H + transpose(H))
            return F, hooke(E if is_linear else E + 0.5 * mul(transpose(H), H))

        @skfem.BilinearForm  # type: ignore[untyped-decorator]
        def tangent(du: Any, v: Any, w: Any) -> Any:
            F, S = stress(w)
            dH = grad(du)
            turned = mul(transpose(F), dH)
            dP = mul(F, hooke(0.5 * (turned + transpose(turned))))
            return ddot(dP if is_linear else dP + mul(dH, S), grad(v))

        @skfem.LinearForm  # type: ignore[untyped-decorator]
        def internal(v: Any, w: Any) -> Any:
            F, S = stress(w)
            return ddot(mul(F, S), grad(v))

        now = {"u": self._basis.interpolate(u)}
        return tangent.assemble(self._basis, **now), internal.assemble(self._basis, **now)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job, order = self._job, self._basis.nodal_dofs.T
        force, moved, u = (self._basis.zeros() for _ in range(3))
        force[order] = job["external_force"]
        moved[order] = job["prescribed_displacement"]
        fixed = order[job["fixed"].astype(bool)]
        free = np.setdiff1d(np.arange(len(u)), fixed)
        count, residual = 0, np.inf
        for part in load_parts(job):
            rise = np.zeros_like(u)
            rise[fixed] = part * moved[fixed] - u[fixed]
            for _ in range(MOST_ITERATIONS):
                K, internal = self._assemble(u)
                out = part * force - internal
                scale = max(np.linalg.norm(internal[fixed]), np.linalg.norm(part * force))
                residual = float(np.linalg.norm(out[free]) / (scale or 1.0))
                if residual <= TOLERANCE and not rise.any():
                    break
                u = u + skfem.solve(*skfem.condense(K, out, x=rise, D=fixed))
                rise[:] = 0.0
                count += 1
            else:
                raise SystemExit(f"no equilibrium at {part:g} of the load, residual {residual:.2g}")
        self.result = {"displacement": u[order]}
        return {
            "method": "Newton, SciPy's direct solver",
            "newton_iterations": count,
            "relative_residual": residual,
        }


if __name__ == "__main__":
    solve_case(Static)
