"""FElupe as a simulator: Saint-Venant-Kirchhoff on linear tetrahedra, a direct solver.

    palpate gate CASE --simulator "python felupe_svk.py {case} {result}"

Follower pressure, tools, time and cells of different materials are not handed to it here.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import felupe
import numpy as np
from scipy.sparse.linalg import spsolve


def main() -> None:
    """Answer the case folder given first in the file given second."""
    case, result = Path(sys.argv[1]), Path(sys.argv[2])
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        rest = {name: stored[name] for name in stored.files}
    if given["time"] or given["tools"] or len(rest["pressure"]) or given["has_inclusions"]:
        raise SystemExit("time, tools, follower pressure and inclusions are not known here")
    E, nu = given["material"]["youngs_modulus"], given["material"]["poissons_ratio"]
    start = time.process_time()
    region = felupe.RegionTetra(felupe.Mesh(rest["points"], rest["cells"], "tetra"))
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    if given["strain"] == "linear":
        law = felupe.LinearElastic(E=E, nu=nu)
    else:
        mu, lmbda = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        law = felupe.Hyperelastic(felupe.saint_venant_kirchhoff, mu=mu, lmbda=lmbda)
    held = np.flatnonzero(rest["fixed"].ravel())
    free = np.setdiff1d(np.arange(rest["fixed"].size), held)
    every = np.arange(len(rest["points"]))
    solid = felupe.SolidBody(law, field)
    num_iterations = 0
    # The load in parts: Newton from rest does not reach the end of large deflections.
    for share in np.linspace(0.25, 1.0, 4) if given["strain"] == "green" else (1.0,):
        load = felupe.PointLoad(field, every, values=share * rest["external_force"])
        moved = share * rest["prescribed_displacement"].ravel()[held]
        found = felupe.newtonrhapson(
            items=[solid, load], dof0=held, dof1=free, ext0=moved, solver=spsolve, tol=1e-10,
            verbose=0,
        )  # fmt: skip
        num_iterations += int(found.iterations)
    about = {
        "tool": "FElupe",
        "version": felupe.__version__,
        "law": "linear elasticity" if given["strain"] == "linear" else "Saint-Venant-Kirchhoff",
        "method": "Newton, SuperLU",
        "seconds": time.process_time() - start,
        "newton_iterations": num_iterations,
    }
    key = given["case_key"]
    np.savez(result, displacement=field[0].values, case_key=key, about=json.dumps(about))


if __name__ == "__main__":
    main()
