"""A simulator written from the words of case.json and nothing else; NumPy alone, no palpate.

python simulator_from_words.py CASE_FOLDER RESULT.npz
"""

import json
import sys
from pathlib import Path

import numpy as np

folder, result = Path(sys.argv[1]), Path(sys.argv[2])
case = json.loads((folder / "case.json").read_text())
with np.load(folder / "rest.npz") as stored:
    rest = dict(stored)
X, cells, fixed = rest["points"], rest["cells"], rest["fixed"] == 1
E, nu = rest["youngs_modulus"][:, None, None], rest["poissons_ratio"][:, None, None]
lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
edges = X[cells[:, 1:]] - X[cells[:, :1]]
V, inverse = np.linalg.det(edges)[:, None, None] / 6, np.linalg.inv(edges).transpose(0, 2, 1)
gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
is_linear = case["strain"] == "linear"


def factor(amplitude, t):
    if amplitude is None:
        return 1.0
    times, factors = amplitude["times"], amplitude["factors"]
    k = np.searchsorted(times, t, side="right")
    if k == 0 or k == len(times):
        return factors[min(k, len(times) - 1)]
    s = (t - times[k - 1]) / (times[k] - times[k - 1])
    s = 10 * s**3 - 15 * s**4 + 6 * s**5 if amplitude["is_smooth"] else s
    return factors[k - 1] + s * (factors[k] - factors[k - 1])


def out_of_balance(u, t):
    """F(t) - R(u); t is None in statics."""
    total = rest["external_force"].copy()
    factors = [1.0 if t is None else factor(load["amplitude"], t) for load in case["loads"]]
    for k, scale in enumerate(factors):
        if scale != 1.0 and f"external_force_{k}" in rest:
            total += (scale - 1.0) * rest[f"external_force_{k}"]
    a, b, c = np.moveaxis((X if is_linear else X + u)[rest["pressure_facets"]], 1, 0)
    p = rest["pressure"] * np.array([*factors, 0.0])[rest["pressure_load"]]
    np.add.at(total, rest["pressure_facets"], (-p[:, None] / 6 * np.cross(b - a, c - a))[:, None])
    for spring in case["springs"]:
        pull(spring, u, t, total)
    return total - internal(u, strain_of(u))


def pull(spring, u, t, total):
    """Add kappa (d - u) of a spring."""
    facets, path = np.array(spring["facets"]), spring["path"]
    corners = X[facets]
    a, b, c = np.moveaxis(corners, 1, 0)
    A = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    far = np.sum((corners - spring["center"]) ** 2, axis=2) / spring["radius"] ** 2
    w = np.where(far < 1, (1 - far) ** 2, 0.0)
    kappa = spring["stiffness"] * w / (A @ w.mean(axis=1))
    d = np.array(path["displacements"][-1])
    if t is not None:
        kappa = kappa * factor(spring["amplitude"], t)
        ways = np.array(path["displacements"]).T
        d = np.array([factor({**path, "factors": way}, t) for way in ways])
    same = {1: 1 / 10, 2: 1 / 30, 3: 1 / 60}
    for i, j, k in np.ndindex(3, 3, 3):
        share = A * same[len({i, j, k})] * kappa[:, k]
        np.add.at(total, facets[:, i], share[:, None] * (d - u[facets[:, j]]))


def strain_of(u):
    H = np.einsum("cai,caj->cij", u[cells], gradients)
    strain = (H + H.transpose(0, 2, 1)) / 2
    return strain if is_linear else strain + H.transpose(0, 2, 1) @ H / 2


def internal(u, strain):
    """Forces of the stress of a strain, where u is."""
    H, force = np.einsum("cai,caj->cij", u[cells], gradients), np.zeros_like(X)
    S = lmbda * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2 * mu * strain
    P = S if is_linear else (np.eye(3) + H) @ S
    np.add.at(force, cells, V * np.einsum("cij,caj->cai", P, gradients))
    return force


def prescribed(t):
    scale = [factor(support["amplitude"], t) for support in case["supports"]]
    return np.array([*scale, 0.0])[rest["support"]] * rest["prescribed_displacement"]


if case["time"] is None:
    u, free = np.zeros_like(X), np.flatnonzero(~fixed)
    for share in np.linspace(0.1, 1.0, 10):
        full = {k: rest[k].copy() for k in ("external_force", "pressure")}
        rest |= {k: share * values for k, values in full.items()}
        u[fixed] = share * rest["prescribed_displacement"][fixed]
        for _ in range(12):
            K, h = np.empty((len(free), len(free))), 1e-4 * np.ptp(X)
            for column, dof in enumerate(free):
                d = np.zeros(X.size)
                d[dof] = h
                ahead, back = (out_of_balance(u + s * d.reshape(X.shape), None) for s in (1, -1))
                K[:, column] = (back - ahead).ravel()[free] / (2 * h)
            step = np.zeros(X.size)
            step[free] = np.linalg.solve(K, out_of_balance(u, None).ravel()[free])
            u += step.reshape(X.shape)
            if abs(step).max() < 1e-13 * abs(u).max():
                break
        rest |= full
    np.savez(result, displacement=u, case_key=case["case_key"])
else:
    dt, half = (
        case["time"]["time_step"],
        case["time"]["mass_damping"] * case["time"]["time_step"] / 2,
    )
    m, n = rest["lumped_mass"][:, None], case["time"]["num_outputs"]
    per_output = round(case["time"]["end_time"] / n / dt)
    a = np.where(fixed, prescribed(0.0), 0.0)
    before, outputs = a + dt**2 / 2 * out_of_balance(a, 0.0) / m, [a]
    before, beta = np.where(fixed, a, before), case["time"]["stiffness_damping"]
    for step in range(n * per_output):
        force = out_of_balance(a, step * dt)
        force -= beta / dt * internal(a, strain_of(a) - strain_of(before))
        ahead = dt**2 * force / m + 2 * a - (1 - half) * before
        a, before = np.where(fixed, prescribed((step + 1) * dt), ahead / (1 + half)), a
        if (step + 1) % per_output == 0:
            outputs.append(a)
    times = case["time"]["output_times"]
    np.savez(result, displacement=outputs, times=times, case_key=case["case_key"])
