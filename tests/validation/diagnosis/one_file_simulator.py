"""A simulator of one file: linear tetrahedra, Newton with loads in steps, or explicit motion.

    python one_file_simulator.py CASE RESULT.npz [--mistake NAME]

It shares nothing with palpate but the case folder. Derivatives are complex steps, so that any law
has its tangent. `--mistake` seeds one of the mistakes that MISTAKES lists.
"""

import json
import sys
from pathlib import Path

import numpy as np

MISTAKES = {
    "statics": (
        "millimetres", "sign", "swapped-axes", "positions", "other-strain", "engineering-shear",
        "not-pushed-forward", "pressure-sign", "dead-pressure", "no-pressure", "no-dead-loads",
        "weight-twice", "pascal-as-kilopascal", "softer", "poisson", "swapped-lame", "loads-98",
        "orthotropic", "single", "other-order", "numbered-from-1", "half-support",
        "millimetre-mesh", "neo-hookean", "tensor-shear", "plane-stress", "plane-stress-ratio",
        "young-for-shear", "shear-for-young", "one-minus-nu", "weight-turned", "parent-turned",
        "solution-turned", "positions-turned",
    ),
    "motion": (
        "no-damping", "damping-twice", "heavier", "equal-masses", "masses-by-cells", "wrong-start",
        "semi-implicit", "one-output-late", "half-step", "other-strain", "softer",
    ),
    "unknown": ("noise", "corner", "dropped-cell", "moved-node", "unconverged", "jitter"),
}  # fmt: skip
ONE = np.eye(3)
# By 60 degrees about z.
TURN = np.array([[0.5, -(0.75**0.5), 0], [0.75**0.5, 0.5, 0], [0, 0, 1]])


def T(A):  # noqa: N802
    return A.swapaxes(-1, -2)


def stress(H, rest, strain, mistake):
    """First Piola-Kirchhoff stress of the displacement gradient."""
    E, nu = rest["youngs_modulus"], rest["poissons_ratio"]
    E = E * {"softer": 0.98, "pascal-as-kilopascal": 1e3}.get(mistake, 1.0)
    E = E / (2 * (1 + nu) if mistake == "shear-for-young" else 1)
    E = E * (1 - nu if mistake == "one-minus-nu" else 1)
    nu = nu + 0.03 * (mistake == "poisson")
    nu = nu / (1 + nu if mistake == "plane-stress-ratio" else 1)
    lmbda, mu = E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)
    lmbda = E * nu / (1 - nu**2) if mistake == "plane-stress" else lmbda
    mu = E if mistake == "young-for-shear" else mu
    lmbda, mu = (mu, lmbda) if mistake == "swapped-lame" else (lmbda, mu)
    lmbda, mu = lmbda[:, None, None], mu[:, None, None]
    F = ONE + H
    if mistake == "neo-hookean":
        inverse = T(np.linalg.inv(F))
        return mu * (F - inverse) + lmbda * np.log(np.linalg.det(F))[:, None, None] * inverse
    e = (H + T(H) + (T(H) @ H if strain == "green" else 0)) / 2
    S = lmbda * np.trace(e, axis1=1, axis2=2)[:, None, None] * ONE + 2 * mu * e
    S = S * np.where(ONE > 0, 1, {"engineering-shear": 2, "tensor-shear": 0.5}.get(mistake, 1))
    S = S + (mu * e * np.diag([1, 0, 0]) if mistake == "orthotropic" else 0)
    return S if strain == "linear" or mistake == "not-pushed-forward" else F @ S


class Body:
    def __init__(self, rest, strain, mistake):
        X = self.X = rest["points"] * (1e3 if mistake == "millimetre-mesh" else 1)
        if mistake == "moved-node":
            X[np.setdiff1d(np.arange(len(X)), np.where(rest["fixed"])[0])[5]] += 1e-3
        self.rest, self.strain, self.mistake, self.cells = rest, strain, mistake, rest["cells"]
        edges = T(X[self.cells[:, 1:]] - X[self.cells[:, :1]])
        self.volume = np.linalg.det(edges) / 6
        inverse = np.linalg.inv(edges)
        self.G = np.concatenate([-inverse.sum(1)[:, None], inverse], 1)
        if mistake == "dropped-cell":
            self.volume[len(self.volume) // 3] = 0
        self.free = rest["fixed"] == 0
        if mistake == "half-support":
            points = np.where(rest["fixed"].any(1))[0]
            self.free[points[X[points, 2] < np.median(X[points, 2])]] = True
        self.dead = rest["external_force"] * {"no-dead-loads": 0, "loads-98": 0.98}.get(mistake, 1)
        if mistake == "weight-twice":
            self.dead = self.dead + rest["lumped_mass"][:, None] * [0, 0, -9.81]
        if mistake == "weight-turned":
            self.dead = self.dead + rest["lumped_mass"][:, None] * [0, -9.81, 9.81]
        self.follows = strain == "green" and mistake != "dead-pressure"
        self.pressure = rest["pressure"] * {
            "pressure-sign": -1,
            "no-pressure": 0,
            "loads-98": 0.98,
        }.get(mistake, 1)

    def inner(self, u):
        """Internal force; u may be complex."""
        H = T(u[self.cells]) @ self.G
        P = self.volume[:, None, None] * stress(H, self.rest, self.strain, self.mistake)
        f = np.zeros(u.shape, u.dtype)
        np.add.at(f, self.cells, self.G @ T(P))
        return f @ T(TURN) if self.mistake == "parent-turned" else f

    def tangent(self, u):
        H, K = T(u[self.cells]) @ self.G, np.zeros((u.size, u.size))
        dofs = (3 * self.cells[:, :, None] + np.arange(3)).reshape(len(H), 12)
        for i in range(3):
            for j in range(3):
                step = np.zeros((3, 3), complex)
                step[i, j] = 1e-30j
                dP = stress(H + step, self.rest, self.strain, self.mistake).imag / 1e-30
                rows = (self.G @ T(self.volume[:, None, None] * dP)).reshape(len(H), 12)
                for b in range(4):
                    np.add.at(K, (dofs, dofs[:, [3 * b + i]]), rows * self.G[:, b, j][:, None])
        if self.mistake == "parent-turned":
            K = np.kron(np.eye(len(u)), TURN) @ K
        return K

    def push(self, u, *, with_tangent=True):
        """Pressure on the facets as they lie, and its tangent where it is asked for."""
        facets, p = self.rest["pressure_facets"], self.pressure
        x = self.X + (u if self.follows else 0 * u)
        f, K = np.zeros(u.shape), np.zeros((u.size, u.size))
        a, b, c = (x[facets[:, k]] for k in range(3))
        for k in range(3):
            np.add.at(f, facets[:, k], -p[:, None] / 6 * np.cross(b - a, c - a))
        for k, edge in enumerate((c - b, a - c, b - a)):
            for j in range(3) if self.follows and with_tangent else ():
                dn = -p[:, None] / 6 * np.cross(edge, np.broadcast_to(ONE[j], edge.shape)) * -1
                for row in range(3):
                    for i in range(3):
                        np.add.at(K, (3 * facets[:, row] + i, 3 * facets[:, k] + j), dn[:, i])
        return f, K


def solve(body):
    moved = body.rest["prescribed_displacement"]
    u, free = np.zeros_like(moved), np.flatnonzero(body.free)
    for share in np.linspace(0, 1, 7)[1:]:
        u = np.where(body.free, u, share * moved)
        for _ in range(4 if body.mistake == "unconverged" else 40):
            push, tangent = body.push(u)
            left = share * (body.dead + push) - body.inner(u)
            if np.abs(left[body.free]).max() < 1e-13 * np.abs(body.inner(u)).max():
                break
            K = (body.tangent(u) - share * tangent)[np.ix_(free, free)]
            over = 1.6 if body.mistake == "unconverged" else 1
            u.flat[free] += over * np.linalg.solve(K, left.flat[free])
    return u


def move(body, span):
    """Central differences from rest."""
    mistake, d = body.mistake, span["mass_damping"]
    d = d * {"no-damping": 0, "damping-twice": 2}.get(mistake, 1)
    m = body.rest["lumped_mass"][:, None] * (1.02 if mistake == "heavier" else 1)
    if mistake == "masses-by-cells":
        count = np.bincount(body.cells.ravel())[:, None]
        m = m.sum() * count / count.sum()
    m = np.full_like(m, m.mean()) if mistake == "equal-masses" else m
    every = round(span["end_time"] / span["num_outputs"] / span["time_step"])
    every = every * (2 if mistake == "half-step" else 1)
    dt = span["end_time"] / span["num_outputs"] / every
    u = np.zeros_like(body.X)
    a = (body.dead - body.inner(u)) / m
    old, v, states = u + (0 if mistake == "wrong-start" else dt * dt / 2 * a), 0 * u, [u]
    for step in range(1, every * span["num_outputs"] + 1):
        a = (body.dead + body.push(u, with_tangent=False)[0] - body.inner(u)) / m
        v = v + dt * (a - d * v)
        new = (2 * u - (1 - d * dt / 2) * old + dt * dt * a) / (1 + d * dt / 2)
        new = np.where(body.free, u + dt * v if mistake == "semi-implicit" else new, 0)
        u, old = new, u
        states += [u] if step % every == 0 else []
    return np.array(states)


def solution(case, result, mistake=""):
    given = json.loads((Path(case) / "case.json").read_text())
    rest = dict(np.load(Path(case) / "rest.npz"))
    strain, span = given["strain"], given["time"]
    if mistake == "other-strain":
        strain = {"green": "linear", "linear": "green"}[strain]
    body = Body(rest, strain, mistake)
    u = move(body, span) if span else solve(body)
    rng, fields = np.random.default_rng(0), {}
    size = np.abs(u).max()
    match mistake:
        case "millimetres":
            u = 1e3 * u
        case "sign":
            u = -u
        case "swapped-axes":
            u = u[..., [1, 0, 2]]
        case "positions":
            u = u + body.X
        case "solution-turned":
            u = u @ T(TURN)
        case "positions-turned":
            u = (u + body.X) @ T(TURN) - body.X
        case "single":
            u = u.astype(np.float32)
        case "other-order":
            u = u[..., rng.permutation(len(body.X)), :]
        case "numbered-from-1":
            u = np.roll(u, 1, axis=-2)
        case "noise":
            u = u + 1e-3 * size * rng.normal(size=u.shape)
        case "corner":
            u[..., body.X.sum(1).argmax(), :] += 0.05 * size
        case "jitter":
            u = u * (1 + 0.02 * np.sin(40 * np.arange(len(u))))[:, None, None]
        case "one-output-late":
            u = np.concatenate([u[:1], u[:-1]])
    if span:
        fields["times"] = span["output_times"]
    np.savez(result, displacement=u, case_key=given["case_key"], **fields)


if __name__ == "__main__":
    solution(sys.argv[1], sys.argv[2], sys.argv[4] if "--mistake" in sys.argv else "")
