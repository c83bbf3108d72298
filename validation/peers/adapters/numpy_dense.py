"""The smallest simulator that can be judged: Newton's method on dense matrices, NumPy alone.

    palpate gate CASE --simulator "python numpy_dense.py {case} {result}"

It is an example to copy for a simulator of your own. It refuses follower pressure, tools and time.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

NOT_POSED = 77  # exit code where a case cannot be posed, which is no failure
LARGEST = 3000  # degrees of freedom; with more, a dense matrix takes minutes


def solve(rest: dict[str, Any], is_linear: bool) -> tuple[Any, int]:
    """Displacement [m] and Newton iterations; the full load at once, steps halved as needed."""
    points, cells = rest["points"], rest["cells"]
    E, nu = rest["youngs_modulus"], rest["poissons_ratio"]
    lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    edges = (points[cells[:, 1:]] - points[cells[:, :1]]).transpose(0, 2, 1)
    volume = np.linalg.det(edges) / 6.0
    gradients = np.concatenate(
        [-np.linalg.inv(edges).sum(axis=1)[:, None], np.linalg.inv(edges)], 1
    )
    free = np.flatnonzero(rest["fixed"].ravel() == 0)
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 12)
    one = np.eye(3)

    def residual_and_tangent(u: Any) -> tuple[Any, Any]:
        grad = np.einsum("cai,caj->cij", u.reshape(-1, 3)[cells], gradients)
        F = np.broadcast_to(one, grad.shape) if is_linear else one + grad
        strain = 0.5 * (grad + grad.transpose(0, 2, 1))
        if not is_linear:
            strain = strain + 0.5 * np.einsum("cki,ckj->cij", grad, grad)
        trace = np.einsum("cii->c", strain)
        S = (lmbda * trace)[:, None, None] * one + 2.0 * mu[:, None, None] * strain
        force = np.einsum("c,cik,ckl,cal->cai", volume, F, S, gradients)
        # dE of the displacement of corner a along i: sym(F^T e_i (x) grad N_a).
        dE = 0.5 * (
            np.einsum("cim,can->caimn", F, gradients) + np.einsum("cin,cam->caimn", F, gradients)
        )
        dtrace = np.einsum("caimm->cai", dE)
        tangent = 2.0 * np.einsum("c,caimn,cbjmn->caibj", volume * mu, dE, dE)
        tangent += np.einsum("c,cai,cbj->caibj", volume * lmbda, dtrace, dtrace)
        if not is_linear:
            geometric = np.einsum("c,cam,cmn,cbn->cab", volume, gradients, S, gradients)
            tangent += np.einsum("cab,ij->caibj", geometric, one)
        R = np.bincount(dofs.ravel(), force.ravel(), u.size) - rest["external_force"].ravel()
        K = np.zeros((u.size, u.size))
        blocks = tangent.reshape(len(cells), 12, 12)
        np.add.at(K, (dofs[:, :, None], dofs[:, None, :]), blocks)
        return R, K

    u = rest["prescribed_displacement"].ravel().copy()
    R, K = residual_and_tangent(u)
    scale = np.linalg.norm(R[free])
    for iteration in range(1, 51):
        step = np.zeros_like(u)
        step[free] = np.linalg.solve(K[np.ix_(free, free)], -R[free])
        fraction, before = 1.0, np.linalg.norm(R[free])
        R, K = residual_and_tangent(u + step)
        while np.linalg.norm(R[free]) > before and fraction > 1e-3 and iteration > 1:
            fraction /= 2.0
            R, K = residual_and_tangent(u + fraction * step)
        u = u + fraction * step
        if np.linalg.norm(R[free]) <= 1e-11 * scale:
            return u.reshape(-1, 3), iteration
    raise SystemExit(f"no equilibrium in 50 iterations, residual {np.linalg.norm(R[free]):.2g} N")


def refuse(why: str) -> None:
    """End because the case cannot be posed to this simulator."""
    print(why)
    sys.exit(NOT_POSED)


def main() -> None:
    """Solve the case folder given first into the file given second."""
    case, result = Path(sys.argv[1]), Path(sys.argv[2])
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        rest = {name: stored[name] for name in stored.files}
    if given["time"] or given["tools"] or given["springs"] or len(rest["pressure"]):
        refuse("time, tools, springs and follower pressure are not known here")
    law = given["material"].get("law", "saint-venant-kirchhoff")
    if given["strain"] == "green" and law != "saint-venant-kirchhoff":
        refuse(f"law {law}: only saint-venant-kirchhoff is known here")
    if rest["points"].size > LARGEST:
        refuse(f"{rest['points'].size} degrees of freedom; dense matrices end at {LARGEST}")
    start = time.process_time()
    displacement, iterations = solve(rest, given["strain"] == "linear")
    about = {
        "tool": "numpy",
        "version": np.__version__,
        "law": given["law"],
        "method": "Newton, dense matrices",
        "seconds": time.process_time() - start,
        "newton_iterations": iterations,
    }
    np.savez(
        result,
        displacement=displacement,
        case_key=given["case_key"],
        about=json.dumps(about),
    )


if __name__ == "__main__":
    main()
