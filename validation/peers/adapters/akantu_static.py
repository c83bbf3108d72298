"""Akantu: finite deformation of linear tetrahedra with its elastic material; Newton's method.

Its elastic material with finite_deformation is Saint-Venant-Kirchhoff's, in the total Lagrangian
form; without, Hooke's. Its Newton iteration ends where the residual has fallen to a part of the
first one, but is not begun where the first is below that part as a plain number: moduli and forces
are in a unit in which that part is above 1.

palpate gate CASE --simulator "python akantu_static.py {case} {result}"
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import akantu
import numpy as np
from harness import force_scale, load_parts, solve_case

TOLERANCE = 1e-10
MOST_ITERATIONS = 40
_MATERIAL = """material elastic [
  name = body
  rho = 1.0
  E = {E!r}
  nu = {nu!r}
  finite_deformation = {is_finite}
]
"""


class Static:
    """The load in four parts: from rest Newton's method does not reach large deflections."""

    tool, version, precision = "Akantu", version("akantu"), "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job, points, cells = job, job["points"], job["cells"]
        is_finite = str(str(job["strain"]) == "green").lower()
        self._unit = 1e2 / (TOLERANCE * force_scale(job))
        moduli = {
            "E": self._unit * float(job["youngs_modulus"][0]),
            "nu": float(job["poissons_ratio"][0]),
        }
        material = Path("akantu_material.dat")
        material.write_text(_MATERIAL.format(**moduli, is_finite=is_finite), encoding="utf-8")
        akantu.parseInput(str(material))
        self._mesh = mesh = akantu.Mesh(3)
        accessor = akantu.MeshAccessor(mesh)
        accessor.resizeNodes(len(points))
        mesh.getNodes()[:] = points
        mesh.addConnectivityType(akantu._tetrahedron_4)
        accessor.resizeConnectivity(len(cells), akantu._tetrahedron_4)
        mesh.getConnectivity(akantu._tetrahedron_4)[:] = cells
        accessor.makeReady()
        self._model = akantu.SolidMechanicsModel(mesh)
        self._model.initFull(_analysis_method=akantu._static)
        self._solver = self._model.getNonLinearSolver()
        self._solver.set("max_iterations", MOST_ITERATIONS)
        self._solver.set("convergence_type", akantu.SolveConvergenceCriteria.residual)
        self._model.getBlockedDOFs()[:] = job["fixed"].astype(bool)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Solve from rest."""
        job, model, count = self._job, self._model, 0
        fixed = job["fixed"].astype(bool)
        u, force = model.getDisplacement(), model.getExternalForce()
        for part in load_parts(job):
            force[:] = part * self._unit * job["external_force"]
            u[fixed] = part * job["prescribed_displacement"][fixed]
            # First roughly: reactions, by which digits are counted, are known then.
            for tolerance in (1e-5, TOLERANCE):
                model.assembleInternalForces()
                inner = np.array(model.getInternalForce())
                left = float(np.linalg.norm((force + inner)[~fixed]))
                most = tolerance * max(np.linalg.norm(force), np.linalg.norm(inner[fixed]))
                if left <= most:
                    continue
                self._solver.set("threshold", float(most / left))
                try:
                    model.solveStep()
                except Exception as error:
                    raise SystemExit(f"no equilibrium at {part:g} of the load: {error}") from None
                count += int(self._solver.getInt("nb_iterations"))
        self.result = {"displacement": np.array(u)}
        return {"method": "Newton, MUMPS", "newton_iterations": count}


if __name__ == "__main__":
    solve_case(Static)
