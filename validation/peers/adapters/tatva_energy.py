"""tatva (JAX): Saint-Venant-Kirchhoff as an energy on linear tetrahedra; Newton's method.

palpate gate CASE --simulator "python tatva_energy.py {case} {result}"
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from harness import lame, load_parts, solve_case
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from tatva.element import Tetrahedron4
from tatva.mesh import Mesh
from tatva.operator import Operator

jax.config.update("jax_enable_x64", True)
TOLERANCE = 1e-10
MOST_ITERATIONS = 40


class Static:
    """The load in four parts: from rest Newton's method does not reach large deflections."""

    tool, version, precision = "tatva", version("tatva"), "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job, cells = job, job["cells"].astype(np.int64)
        lmbda, mu = lame(job)
        is_linear = str(job["strain"]) == "linear"

        def density(H: Any) -> Any:
            E = 0.5 * (H + jnp.swapaxes(H, -1, -2))
            if not is_linear:
                E = E + 0.5 * jnp.einsum("...ki,...kj->...ij", H, H)
            trace = jnp.trace(E, axis1=-2, axis2=-1)
            return 0.5 * lmbda * trace**2 + mu * jnp.sum(E * E, axis=(-2, -1))

        def energy_on(points: Any, elements: Any) -> Any:
            operator = Operator(Mesh(points, elements), Tetrahedron4())
            return lambda u: operator.integrate(density(operator.grad(u)))

        points = jnp.asarray(job["points"])
        self._force = jax.jit(jax.grad(energy_on(points, jnp.asarray(cells))))

        # One cell's energy twice differentiated is its stiffness: these are added up sparsely.
        def of_cell(x: Any, u: Any) -> Any:
            return energy_on(x, jnp.array([[0, 1, 2, 3]]))(u)

        self._stiffness: Any = jax.jit(jax.vmap(jax.hessian(of_cell, argnums=1)))
        self._cells, self._corners = cells, points[cells]
        self._dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(-1, 12)

    def _tangent(self, u: Any) -> Any:
        blocks = np.asarray(self._stiffness(self._corners, u[self._cells])).reshape(-1, 12, 12)
        rows = np.repeat(self._dofs, 12, axis=1).ravel()
        columns = np.tile(self._dofs, (1, 12)).ravel()
        return coo_matrix((blocks.ravel(), (rows, columns)), shape=(u.size, u.size)).tocsr()

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job = self._job
        fixed = job["fixed"].astype(bool)
        free = np.flatnonzero(~fixed.ravel())
        u = np.zeros_like(job["points"])
        count, residual = 0, np.inf
        for part in load_parts(job):
            force = part * job["external_force"]
            rise = np.where(fixed, part * job["prescribed_displacement"] - u, 0.0)
            for _ in range(MOST_ITERATIONS):
                inner = np.asarray(self._force(jnp.asarray(u)))
                out = force - inner
                scale = max(np.linalg.norm(inner[fixed]), np.linalg.norm(force))
                residual = float(np.linalg.norm(out[~fixed]) / (scale or 1.0))
                if residual <= TOLERANCE and not rise.any():
                    break
                K = self._tangent(jnp.asarray(u))
                right = (out.ravel() - K @ rise.ravel())[free]
                u += rise
                u.ravel()[free] += spsolve(K[free][:, free].tocsc(), right)
                rise[:] = 0.0
                count += 1
            else:
                raise SystemExit(f"no equilibrium at {part:g} of the load, residual {residual:.2g}")
        self.result = {"displacement": u}
        return {
            "method": "Newton, SciPy's direct solver",
            "newton_iterations": count,
            "relative_residual": residual,
        }


if __name__ == "__main__":
    solve_case(Static)
