"""GetFEM: its finite strain brick, Saint-Venant-Kirchhoff or others, on linear tetrahedra.

palpate gate CASE --simulator "/usr/bin/python3 getfem_p1.py {case} {result}"
"""

from __future__ import annotations

from typing import Any

import getfem as gf
import numpy as np
from harness import force_scale, lame, load_parts, solve_case

TOLERANCE = 1e-10
# GetFEM's names of laws.
_LAWS = {
    "saint-venant-kirchhoff": "SaintVenant Kirchhoff",
    "neo-hookean": "Compressible Neo Hookean Bonet",
}


class Static:
    """The load in four parts, each by GetFEM's own Newton's method."""

    tool, precision = "GetFEM", "float64"
    laws = tuple(_LAWS)

    def __init__(self, job: dict[str, Any]) -> None:
        gf.util_trace_level(0)
        self.version = "5.4.2"
        self._job = job
        points, cells = job["points"], job["cells"]
        mesh = gf.Mesh("empty", 3)
        # Positions of points in the order of cells; GetFEM merges equal ones.
        corners = points[cells].transpose(2, 1, 0)
        mesh.add_convex(gf.GeoTrans("GT_PK(3,1)"), corners)
        fem = gf.MeshFem(mesh, 3)
        fem.set_fem(gf.Fem("FEM_PK(3,1)"))
        nodes = fem.basic_dof_nodes().T
        # Our number of each of GetFEM's degrees of freedom: by position, x, y and z in turn.
        found = np.lexsort(np.round(nodes[::3], 12).T)
        ours = np.lexsort(np.round(points, 12).T)
        order = np.empty(len(points), dtype=np.int64)
        order[ours] = found
        if len(found) != len(points) or np.abs(nodes[::3][order] - points).max() > 1e-9:
            raise ValueError("its mesh has other points than the case: some belong to no cell")
        self._order = 3 * order[:, None] + np.arange(3)
        self._fem, self._integration = fem, gf.MeshIm(mesh, gf.Integ("IM_TETRAHEDRON(1)"))

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        job, order = self._job, self._order
        model = gf.Model("real")
        model.add_fem_variable("u", self._fem)
        lmbda, mu = lame(job)
        if str(job["strain"]) == "linear":
            model.add_initialized_data("lmbda", lmbda)
            model.add_initialized_data("mu", mu)
            model.add_isotropic_linearized_elasticity_brick(self._integration, "u", "lmbda", "mu")
        else:
            model.add_initialized_data("moduli", [lmbda, mu])
            law = _LAWS[str(job.get("law", "saint-venant-kirchhoff"))]
            model.add_finite_strain_elasticity_brick(self._integration, law, "u", "moduli")
        fixed = np.flatnonzero(job["fixed"].ravel())
        count = 3 * len(job["points"])
        choose = gf.Spmat("empty", len(fixed), count)
        for row, dof in enumerate(order.ravel()[fixed]):
            choose.add(row, int(dof), 1.0)
        model.add_variable("reaction", len(fixed))
        moved = job["prescribed_displacement"].ravel()[fixed]
        supports = model.add_constraint_with_multipliers("u", "reaction", choose, 0.0 * moved)
        force = np.zeros(count)
        loads = model.add_explicit_rhs("u", force)
        iterations = 0
        for part in load_parts(job):
            force[order] = part * job["external_force"]
            model.set_private_rhs(loads, force)
            model.set_private_rhs(supports, part * moved)
            # Full steps: a line search ends far from equilibrium where a body rotates.
            count, has_converged = model.solve(
                "max_res", TOLERANCE * part * force_scale(job), "max_iter", 50, "lsearch", "basic",
                "alpha min", 1.0, "alpha max ratio", 1e15, "diverged_res", 1e30,
            )  # fmt: skip
            iterations += int(count)
            if not has_converged:
                raise SystemExit(f"no equilibrium at {part:g} of the load")
        self.result = {"displacement": np.array(model.variable("u"))[order]}
        return {"method": "Newton, MUMPS", "newton_iterations": iterations}


if __name__ == "__main__":
    solve_case(Static)
