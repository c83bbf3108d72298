"""Extended position-based dynamics in plain NumPy: strains of a cell as compliant constraints.

    palpate gate CASE --simulator "python xpbd.py {case} {result} {iterations}"
        --iterations 20 --time-step 2.5e-3

The six Green strains of a cell are its constraints (M. Müller, N. Chentanez, T.-Y. Kim, M. Macklin,
Strain Based Dynamics, 2014), with the inverse of V times Saint-Venant-Kirchhoff's moduli as their
compliance (M. Macklin, M. Müller, N. Chentanez, XPBD, 2016: algorithm 1, eq. 18 for six at once).
So its energy is the law's. Multipliers are added up along directions that change on the way, which
XPBD leaves aside: with more iterations it comes to backward Euler only where steps are short.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from backward_euler import LAWS, Body, answer

# Rows and columns of xx, yy, zz, xy, xz, yz.
_I, _J = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])


def improver(body: Body) -> Callable[[Any, Any, Any], None]:
    """One sweep over all cells; the multipliers start anew with each step, which has a new y."""
    if body.law != LAWS[0]:
        raise SystemExit(f"law {body.law}: only {LAWS[0]} is known here")
    count = len(body.cells)
    of_point: list[list[int]] = [[] for _ in body.points]
    for number, cell in enumerate(body.cells.tolist()):
        for point in cell:
            of_point[point].append(number)
    near = [{k for p in cell for k in of_point[p]} - {n} for n, cell in enumerate(body.cells)]
    groups = body.colours(list(near), count)
    # W = V (lmbda/2 (tr E)^2 + mu E : E), where the shears stand twice in E : E.
    moduli = np.zeros((count, 6, 6))
    moduli[:, :3, :3] = body.lmbda[:, None, None]
    moduli[:, np.arange(6), np.arange(6)] += body.mu[:, None] * np.array([2, 2, 2, 4, 4, 4])
    compliances = np.linalg.inv(body.volumes[:, None, None] * moduli)
    multipliers, last = np.zeros((count, 6)), [np.zeros(0)]

    def improve(u: Any, y: Any, w: Any) -> None:
        if y is not last[0]:
            multipliers[:], last[0] = 0.0, y
        mobility = np.where(body.is_free, 1.0 / w, 0.0)
        for cells in groups:
            F, g = body.deformation_gradients(u, cells), body.gradients[cells]
            E = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
            # dE_ij / du_a = (F_.i g_aj + F_.j g_ai) / 2.
            D = 0.5 * (
                np.einsum("cmk,cak->ckam", F[:, :, _I], g[:, :, _J])
                + np.einsum("cmk,cak->ckam", F[:, :, _J], g[:, :, _I])
            )
            inverse_mass = mobility[body.cells[cells]]
            alpha, total = compliances[cells], multipliers[cells]
            matrix = np.einsum("ckam,cam,clam->ckl", D, inverse_mass, D) + alpha
            left = -E[:, _I, _J] - np.einsum("ckl,cl->ck", alpha, total)
            change = np.linalg.solve(matrix, left[..., None])[..., 0]
            multipliers[cells] = total + change
            u[body.cells[cells]] += inverse_mass * np.einsum("ckam,ck->cam", D, change)

    return improve


if __name__ == "__main__":
    answer("XPBD", improver)
