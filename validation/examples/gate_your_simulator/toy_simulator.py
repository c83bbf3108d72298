"""A toy: linear tetrahedra of a Saint-Venant-Kirchhoff solid, relaxed by damped steps in NumPy."""

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

case, result = Path(sys.argv[1]), Path(sys.argv[2])
given = json.loads((case / "case.json").read_text())
rest = dict(np.load(case / "rest.npz"))
X, cells, free = rest["points"], rest["cells"], rest["fixed"] == 0
E, nu = rest["youngs_modulus"][:, None, None], rest["poissons_ratio"][:, None, None]
lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
edges = (X[cells[:, 1:]] - X[cells[:, :1]]).transpose(0, 2, 1)
volume, inverse = np.linalg.det(edges)[:, None, None] / 6, np.linalg.inv(edges)


def force(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nodal force of a displacement."""
    x = X + u
    H = (x[cells[:, 1:]] - x[cells[:, :1]]).transpose(0, 2, 1) @ inverse - np.eye(3)
    strain = (H + H.transpose(0, 2, 1) + H.transpose(0, 2, 1) @ H) / 2
    S = lmbda * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2 * mu * strain
    corners = (volume * (np.eye(3) + H) @ S @ inverse.transpose(0, 2, 1)).transpose(0, 2, 1)
    total = np.zeros_like(u)
    np.add.at(total, cells[:, 1:], corners)
    np.add.at(total, cells[:, 0], -corners.sum(axis=1))
    return total


u = np.where(free, 0.0, rest["prescribed_displacement"])
v, size = np.zeros_like(u), np.linalg.norm(rest["external_force"])
# Masses in proportion to the points' stiffness: one step length suits all of them.
stiffness = np.zeros(len(X))
bound = (volume * (lmbda + 2 * mu))[:, 0, 0] * (inverse**2).sum(axis=(1, 2)) * 4
np.add.at(stiffness, cells, np.repeat(bound[:, None], 4, axis=1))
energy = 0.0
for _step in range(200_000):
    left = np.where(free, rest["external_force"] - force(u), 0.0)
    if np.linalg.norm(left) <= 1e-10 * size:
        break
    v += left / stiffness[:, None]
    before, energy = energy, float((stiffness[:, None] * v**2).sum())
    if energy < before:
        v, energy = np.zeros_like(v), 0.0
    u += v
np.savez(result, displacement=u, case_key=given["case_key"])
