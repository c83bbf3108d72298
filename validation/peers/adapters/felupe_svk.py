"""FElupe: Saint-Venant-Kirchhoff, or its neo-Hookean laws, on linear tetrahedra; a direct solver.

    palpate gate CASE --simulator "python felupe_svk.py {case} {result}"

With `degree=2` behind these it takes quadratic tetrahedra on the case's mesh, with four points of
integration in each cell, and its result is on the cells cut in eight.
"""

from __future__ import annotations

from typing import Any

import felupe
import numpy as np
from harness import lame, load_parts, solve_case
from nodes import Points, nodes_of

try:
    from pypardiso import spsolve

    SOLVER = "PARDISO"
except ImportError:
    from scipy.sparse.linalg import spsolve

    SOLVER = "SuperLU"

TOLERANCE = 1e-9  # less is rounding where a stiff body has a small load; its default: 1.5e-8
LARGEST = 40_000  # degrees of freedom; beyond, its factors take gigabytes and minutes


class Static:
    """Newton's method, the load in `load_parts`: from rest it does not reach large deflections."""

    tool, version, precision = "FElupe", felupe.__version__, "float64"
    laws = ("saint-venant-kirchhoff", "neo-hookean", "neo-hookean-isochoric")

    def __init__(self, job: dict[str, Any]) -> None:
        self._nodes, self._kind, self._region = nodes_of(job), "tetra", felupe.RegionTetra
        if not isinstance(self._nodes, Points):
            self.tool, self._kind = "FElupe tetra10", "tetra10"
            self._region = felupe.RegionQuadraticTetra
        self._body = self._nodes.arrays
        if self._body["points"].size > LARGEST:
            raise ValueError(f"direct factors of more than {LARGEST} unknowns take gigabytes")
        self._job = job
        if str(job["strain"]) == "linear":
            E, nu = job["youngs_modulus"][0], job["poissons_ratio"][0]
            self._law = felupe.LinearElastic(E=E, nu=nu)
            return
        lmbda, mu = lame(job)
        law = job.get("law", "saint-venant-kirchhoff")
        if law == "neo-hookean":
            # Its documentation: None leaves out the part of the volume, which is 0 here.
            self._law = felupe.NeoHookeCompressible(mu=mu, lmbda=lmbda or None)
        elif law == "neo-hookean-isochoric":
            self._law = felupe.NeoHooke(mu=mu, bulk=lmbda + 2.0 * mu / 3.0)
        else:
            self._law = felupe.Hyperelastic(felupe.saint_venant_kirchhoff, mu=mu, lmbda=lmbda)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job, body = self._job, self._body
        region = self._region(felupe.Mesh(body["points"], body["cells"], self._kind))
        field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        fixed, free = (np.flatnonzero(body["fixed"].ravel() == which) for which in (1, 0))
        solid = felupe.SolidBody(self._law, field)
        solve = getattr(felupe, "newtonraphson", None) or felupe.newtonrhapson
        num_iterations = 0
        for part in load_parts(job):
            load = felupe.PointLoad(
                field, np.arange(len(body["points"])), values=part * body["external_force"]
            )
            moved = part * body["prescribed_displacement"].ravel()[fixed]
            found = solve(
                items=[solid, load], dof0=fixed, dof1=free, ext0=moved, solver=spsolve,
                tol=float(job.get("relative_tolerance", TOLERANCE)), verbose=0,
            )  # fmt: skip
            num_iterations += int(found.iterations)
        self.result = self._nodes.result(field[0].values.copy())
        return {"method": f"Newton, {SOLVER}", "newton_iterations": num_iterations}


if __name__ == "__main__":
    solve_case(Static)
