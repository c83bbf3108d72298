"""Two simulators that step otherwise than the reference; NumPy alone, from the words of case.json.

    python other_integrators.py CASE_FOLDER RESULT.npz euler|newmark [MISTAKE]

Semi-implicit Euler with a step of its own, and Newmark's average acceleration with Newton. The
mistakes: damping, density, stiffness, load, law, pull.
"""

import json
import sys
from pathlib import Path

import numpy as np

folder, result, method, mistake = (Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:], "none")[:4]
case = json.loads((folder / "case.json").read_text())
with np.load(folder / "rest.npz") as stored:
    rest = dict(stored)
X, cells, free = rest["points"], rest["cells"], rest["fixed"] == 0
E, nu = rest["youngs_modulus"][:, None, None], rest["poissons_ratio"][:, None, None]
E = E * 1.1 if mistake == "stiffness" else E
lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
lmbda = 0.0 * lmbda if mistake == "law" else lmbda
edges = X[cells[:, 1:]] - X[cells[:, :1]]
V, inverse = np.linalg.det(edges)[:, None, None] / 6, np.linalg.inv(edges).transpose(0, 2, 1)
gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
# The heavier body has the weight that was asked for: only its inertia is wrong.
m = rest["lumped_mass"][:, None] * (1.1 if mistake == "density" else 1.0)
damping = 0.0 if mistake == "damping" else case["time"]["mass_damping"]
F = rest["external_force"] * {"load": 1.1, "pull": -1.0}.get(mistake, 1.0)
is_linear = case["strain"] == "linear"


def force(u):
    """External less internal force; 0 where held."""
    H = u[cells].transpose(0, 2, 1) @ gradients
    strain = (H + H.transpose(0, 2, 1)) / 2
    strain += 0.0 if is_linear else H.transpose(0, 2, 1) @ H / 2
    S = lmbda * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2 * mu * strain
    P = S if is_linear else (np.eye(3) + H) @ S
    corners = (V * P @ gradients.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(-1, 3)
    inner = [np.bincount(cells.ravel(), corners[:, axis], len(X)) for axis in range(3)]
    return np.where(free, F - np.stack(inner, axis=1), 0.0)


times = np.array(case["time"]["output_times"])
u, v, outputs = np.zeros_like(X), np.zeros_like(X), []
if method == "euler":
    speed = np.sqrt(((lmbda + 2 * mu) / rest["density"][:, None, None]).max())
    steps = int(np.ceil(times[1] / (0.2 * np.cbrt(V.min()) / speed)))
    dt = times[1] / steps
    for _output in times:
        outputs.append(u)
        for _ in range(steps):
            v = (v + dt * force(u) / m) / (1 + damping * dt)
            u = u + dt * v
else:
    steps, dofs, h = 4, np.flatnonzero(free), 1e-4 * np.ptp(X)
    dt, a = times[1] / steps, force(u) / m
    unit = np.zeros(X.size)
    K = np.empty((len(dofs), len(dofs)))
    for column, dof in enumerate(dofs):
        unit[dof] = h
        K[:, column] = (force(-unit.reshape(X.shape)) - force(unit.reshape(X.shape))).ravel()[
            dofs
        ] / (2 * h)
        unit[dof] = 0.0
    inertia = (np.broadcast_to(m, X.shape).ravel()[dofs]) * (4 / dt**2 + 2 * damping / dt)
    K = np.linalg.inv(K + np.diag(inertia))
    for _output in times:
        outputs.append(u)
        for _ in range(steps):
            u0, v0, a0 = u, v, a
            for _iteration in range(200):
                a = 4 / dt**2 * (u - u0 - dt * v0) - a0
                v = v0 + dt / 2 * (a0 + a)
                residual = np.where(free, force(u) - m * a - damping * m * v, 0.0).ravel()[dofs]
                if np.abs(residual).max() < 1e-9 * np.abs(F).max():
                    break
                change = np.zeros(X.size)
                change[dofs] = K @ residual
                u = u + change.reshape(X.shape)
            else:
                sys.exit("no equilibrium in a step")
np.savez(result, displacement=outputs, times=times, case_key=case["case_key"])
