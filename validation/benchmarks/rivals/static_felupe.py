"""Static solve by FElupe with a direct solver, PARDISO where it is installed."""

from __future__ import annotations

from typing import Any

import felupe
import numpy as np

try:
    from pypardiso import spsolve

    SOLVER = "Newton, PARDISO"
except ImportError:
    from scipy.sparse.linalg import spsolve

    SOLVER = "Newton, SuperLU"

LARGEST = 40_000  # degrees of freedom; beyond, its factors take gigabytes and minutes


class Rival:
    """One whole solve a step."""

    tool, version, precision, force = "felupe", felupe.__version__, "float64", None

    def __init__(self, body: dict[str, Any]) -> None:
        if body["points"].size > LARGEST:
            raise ValueError(f"direct factors of more than {LARGEST} unknowns take gigabytes")
        self._body = body

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        body = self._body
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        mesh = felupe.Mesh(body["points"], body["cells"], "tetra")
        region = felupe.RegionTetra(mesh)
        field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        if str(body["strain"]) == "linear":
            law = felupe.LinearElastic(E=E, nu=nu)
        else:
            mu, lmbda = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
            law = felupe.Hyperelastic(felupe.saint_venant_kirchhoff, mu=mu, lmbda=lmbda)
        held = np.zeros(len(body["points"]), bool)
        held[body["held"]] = True
        bounds = {"held": felupe.Boundary(field[0], mask=held)}
        dof0, dof1 = felupe.dof.partition(field, bounds)
        load = felupe.PointLoad(field, np.arange(len(held)), values=body["external_force"])
        solve = getattr(felupe, "newtonraphson", None) or felupe.newtonrhapson
        result = solve(
            items=[felupe.SolidBody(law, field), load],
            dof0=dof0,
            dof1=dof1,
            solver=spsolve,
            tol=float(body["relative_tolerance"]),
            verbose=0,
        )
        return {
            **({"displacement": field[0].values.copy()} if body.get("wants_field") else {}),
            "tip_displacement": float(field[0].values[int(body["tip"]), 2]),
            "iterations": int(result.iterations),
            "solver": SOLVER,
        }


def prepare(body: dict[str, Any]) -> Rival:
    """Nothing is set up beforehand."""
    return Rival(body)
