"""NGSolve: Saint-Venant-Kirchhoff as an energy on linear or quadratic tetrahedra; Newton's method.

palpate gate CASE --simulator "python ngsolve_p1.py {case} {result}"
"""

from __future__ import annotations

from typing import Any

import netgen.meshing as netgen
import ngsolve as ngs
import numpy as np
from harness import lame, load_parts, solve_case

TOLERANCE = 1e-10
MOST_ITERATIONS = 40


class Static:
    """The load in four parts: from rest Newton's method does not reach large deflections."""

    tool, version, precision = "NGSolve", ngs.__version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job = job
        mesh = netgen.Mesh(dim=3)
        for position in job["points"].tolist():
            mesh.Add(netgen.MeshPoint(netgen.Pnt(*position)))
        mesh.Add(netgen.FaceDescriptor(bc=1, domin=1, domout=0, surfnr=1))
        # Netgen counts points from one, and its tetrahedra the other way round.
        for a, b, c, d in (job["cells"] + 1).tolist():
            mesh.Add(netgen.Element3D(1, [netgen.PointId(p) for p in (a, c, b, d)]))
        self._space = ngs.VectorH1(ngs.Mesh(mesh), order=1)
        lmbda, mu = lame(job)
        u = self._space.TrialFunction()
        H = ngs.Grad(u)
        E = 0.5 * (H + H.trans)
        if str(job["strain"]) != "linear":
            E = E + 0.5 * H.trans * H
        self._form = ngs.BilinearForm(self._space, symmetric=True)
        energy = 0.5 * lmbda * ngs.Trace(E) ** 2 + mu * ngs.InnerProduct(E, E)
        self._form += ngs.Variation(energy * ngs.dx)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job, form = self._job, self._form
        fixed = job["fixed"].astype(bool).T.ravel()
        free = ngs.BitArray(len(fixed))
        free.Clear()
        for index in np.flatnonzero(~fixed).tolist():
            free.Set(index)
        # Degrees of freedom stand component by component.
        force, moved = (job[n].T.ravel() for n in ("external_force", "prescribed_displacement"))
        now = ngs.GridFunction(self._space)
        u = now.vec.FV().NumPy()
        internal, change = now.vec.CreateVector(), now.vec.CreateVector()
        count, residual = 0, np.inf
        for part in load_parts(job):
            rise = np.where(fixed, part * moved - u, 0.0)
            for _ in range(MOST_ITERATIONS):
                form.Apply(now.vec, internal)
                inner = internal.FV().NumPy()
                out = part * force - inner
                scale = max(np.linalg.norm(inner[fixed]), np.linalg.norm(part * force))
                residual = float(np.linalg.norm(out[~fixed]) / (scale or 1.0))
                if residual <= TOLERANCE and not rise.any():
                    break
                form.AssembleLinearization(now.vec)
                change.FV().NumPy()[:] = rise
                internal.data = form.mat * change
                inner[:] = np.where(fixed, 0.0, out - internal.FV().NumPy())
                change.data = form.mat.Inverse(free, inverse="sparsecholesky") * internal
                u += change.FV().NumPy() + rise
                rise[:] = 0.0
                count += 1
            else:
                raise SystemExit(f"no equilibrium at {part:g} of the load, residual {residual:.2g}")
        self.result = {"displacement": np.ascontiguousarray(u.reshape(3, -1).T)}
        return {
            "method": "Newton, NGSolve's sparse Cholesky",
            "newton_iterations": count,
            "relative_residual": residual,
        }


if __name__ == "__main__":
    solve_case(Static)
