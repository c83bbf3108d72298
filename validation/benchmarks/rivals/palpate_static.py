"""Our own static solve, from plain arrays to the displacement."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.newton import MULTIGRID_FROM_POINTS
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh


class Rival:
    """One whole solve a step."""

    tool, version, precision, force = "palpate", _core.__version__, "float64", None

    def __init__(self, body: dict[str, Any]) -> None:
        self._body = body

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Mesh checks, assembly and solve."""
        body = self._body
        material = Material(float(body["youngs_modulus"]), float(body["poissons_ratio"]))
        load = PointForce(np.arange(len(body["points"]), dtype=np.int32), body["external_force"])
        problem = Problem(
            TetMesh(body["points"], body["cells"]), material, (Support(body["held"]),), (load,)
        )
        result = solve_static(
            problem,
            strain=Strain(str(body["strain"])),
            relative_tolerance=float(body["relative_tolerance"]),
        )
        uses_multigrid = problem.mesh.num_points >= MULTIGRID_FROM_POINTS
        return {
            "tip_displacement": float(result.displacement[int(body["tip"]), 2]),
            "iterations": result.iterations,
            "linear_iterations": result.linear_iterations,
            "solver": "Newton, conjugate gradients, "
            + ("aggregation multigrid" if uses_multigrid else "diagonal blocks"),
        }


def prepare(body: dict[str, Any]) -> Rival:
    """Nothing is set up beforehand."""
    return Rival(body)
