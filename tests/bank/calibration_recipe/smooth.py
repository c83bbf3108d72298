"""Manufactured solutions of linear elasticity on any polyhedron, in words that a case has.

A cubic displacement about the body's middle, u_i = G_ij X_j + Q_ijk X_j X_k / 2 + T_ijkl X_j X_k
X_l / 6, has stress of degree 2, sigma = s0 + s1 X + X . s2 X / 2, which is what a traction may be
on each plane of the surface. Where the part of div sigma that is linear in X vanishes,

(lmbda + mu) T_kkil + mu T_ikkl = 0   for all i, l,

a uniform body force b_i = -(lmbda + mu) Q_kki - mu Q_ikk keeps the balance. Coefficients are drawn
and then moved as little as it takes; the divergence is held down as the bulk modulus asks.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np

from calibration_recipe.answers import Answer, answer_of
from calibration_recipe.shapes import confined_modulus, planes, shape_mesh
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

# Largest component of the displacement's gradient.
_STRAIN = 0.05


def smooth_problem(*, shape: str, nu: float, seed: int) -> tuple[Problem, Strain, Answer]:
    """A problem held at three points only, which carry nothing, and its answer."""
    given = shape_mesh(shape)
    centre = 0.5 * (given.points.min(axis=0) + given.points.max(axis=0))
    mesh = TetMesh(given.points - centre, given.cells)
    material = Material(1.0, nu, 1.0)
    mu = 0.5 / (1.0 + nu)
    lmbda = confined_modulus(material) - 2.0 * mu
    G, Q, T = _coefficients(lmbda, mu, np.random.default_rng(seed))
    steepest = np.abs(_gradient(G, Q, T, mesh.points)).max()
    G, Q, T = (_STRAIN / steepest * part for part in (G, Q, T))
    points = _held_points(mesh)
    # No displacement at the first, none but along x at the second, none along y at the third.
    G = _turned(G, Q, T, mesh.points[points])
    shift = _displacement(G, Q, T, mesh.points[points[:1]])[0]
    # The same law at each degree of X.
    s0, s1, s2 = (_stress(part, lmbda, mu) for part in (G, Q, T))
    loads = [
        Traction(facets, tuple(s0 @ n), gradient=np.einsum("ijk,j->ik", s1, n),
                 curvature=_even(np.einsum("ijkl,j->ikl", s2, n)))
        for n, facets in planes(mesh)
    ]  # fmt: skip
    b = -(lmbda + mu) * np.einsum("kki->i", Q) - mu * np.einsum("ikk->i", Q)
    holds = ((True, True, True), (False, True, True), (False, False, True))
    problem = Problem(
        mesh,
        material,
        tuple(Support(np.array([p]), components=c) for p, c in zip(points, holds, strict=True)),
        (BodyForce(tuple(b)), *loads),
    )
    answer = answer_of(
        mesh, lambda X: _displacement(G, Q, T, X) - shift, Strain.LINEAR, "cubic", 1e-9
    )
    sigma = np.einsum("q,cqij->cij", np.full(4, 0.25), _stress_at(mesh, (s0, s1, s2)))
    return problem, Strain.LINEAR, replace(answer, cauchy=sigma)


def _stress_at(mesh: TetMesh, parts: tuple[Floats, ...]) -> Floats:
    """Stress at the four points of a rule that is exact to degree 2, (num_cells, 4, 3, 3)."""
    near, far = 0.25 + 0.75 / np.sqrt(5.0), 0.25 - 0.25 / np.sqrt(5.0)
    weights = far + (near - far) * np.eye(4)
    X = np.einsum("qa,cai->cqi", weights, mesh.points[mesh.cells])
    s0, s1, s2 = parts
    bent = np.einsum("ijkl,cqk,cql->cqij", s2, X, X) / 2.0
    sigma: Floats = s0 + np.einsum("ijk,cqk->cqij", s1, X) + bent
    return sigma


def _coefficients(lmbda: float, mu: float, rng: np.random.Generator) -> tuple[Floats, ...]:
    """G, Q and T, drawn, in balance, and as incompressible as the bulk modulus makes a body."""
    sizes = (9, 27, 81)
    maps = [_symmetrised(order) for order in (0, 1, 2, 3)]
    basis = np.zeros((sum(sizes), 0))
    starts = np.concatenate([[0], np.cumsum(sizes)])
    for k in range(3):
        block = np.kron(np.eye(3), maps[k + 1])
        rows = np.zeros((sum(sizes), block.shape[1]))
        rows[starts[k] : starts[k + 1]] = block
        basis = np.hstack([basis, rows])

    def parts(flat: Floats) -> tuple[Floats, ...]:
        return tuple(flat[starts[k] : starts[k + 1]].reshape((3,) * (k + 2)) for k in range(3))

    balance, divergence = [], []
    for column in basis.T:
        G, Q, T = parts(column)
        left = (lmbda + mu) * np.einsum("kkil->il", T) + mu * np.einsum("ikkl->il", T)
        balance.append(left.ravel() / (lmbda + mu))
        trace = (np.einsum("kk", G), np.einsum("kkl->l", Q), np.einsum("kklm->lm", T))
        divergence.append(np.concatenate([np.atleast_1d(t).ravel() for t in trace]))
    drawn = rng.standard_normal(basis.shape[1])
    A, D = np.array(balance).T, np.array(divergence).T
    # Within the balance, the least of |c - drawn|^2 + (lmbda / mu) |div|^2.
    _, values, right = np.linalg.svd(A)
    free = right[int((values > 1e-10 * values[0]).sum()) :].T
    normal = free.T @ (np.eye(len(drawn)) + lmbda / mu * D.T @ D) @ free
    return parts(basis @ free @ np.linalg.solve(normal, free.T @ drawn))


def _symmetrised(order: int) -> Floats:
    """Columns: symmetric tensors of an order, flat, one for each choice of indices."""
    choices = [i for i in np.ndindex((3,) * order) if list(i) == sorted(i)]
    columns = np.zeros((3,) * order + (len(choices),))
    for k, choice in enumerate(choices):
        for one in set(permutations(choice)):
            columns[(*one, k)] = 1.0
    flat: Floats = columns.reshape(3**order, -1)
    return flat


def _displacement(G: Floats, Q: Floats, T: Floats, X: Points) -> Points:
    quadratic = np.einsum("ijk,nj,nk->ni", Q, X, X) / 2.0
    u: Points = X @ G.T + quadratic + np.einsum("ijkl,nj,nk,nl->ni", T, X, X, X) / 6.0
    return u


def _gradient(G: Floats, Q: Floats, T: Floats, X: Points) -> Floats:
    cubic = np.einsum("ijkl,nk,nl->nij", T, X, X) / 2.0
    H: Floats = G + np.einsum("ijk,nk->nij", Q, X) + cubic
    return H


def _stress(part: Floats, lmbda: float, mu: float) -> Floats:
    """Of the first two indices of G, Q or T."""
    trace = np.einsum("kk...->...", part)
    s: Floats = mu * (part + part.swapaxes(0, 1))
    whole: Floats = s + lmbda * np.einsum("ij,...->ij...", np.eye(3), trace)
    return whole


def _even(C: Floats) -> Floats:
    return 0.5 * (C + C.transpose(0, 2, 1))


def _held_points(mesh: TetMesh) -> list[int]:
    """Three points: far from each other along x, and the third far from their line along y."""
    x = mesh.points
    first, second = int(x[:, 0].argmin()), int(x[:, 0].argmax())
    along = (x[second] - x[first]) / np.linalg.norm(x[second] - x[first])
    off = np.cross(x - x[first], along)
    return [first, second, int(np.abs(off[:, 2]).argmax())]


def _turned(G: Floats, Q: Floats, T: Floats, fixed: Points) -> Floats:
    """G and a small turn, such that what the second and third point are held along stays."""
    u = _displacement(G, Q, T, fixed)
    arms = fixed - fixed[0]
    # u + omega x arm: y and z of the second point, z of the third.
    rows, right = [], []
    for k, i in ((1, 1), (1, 2), (2, 2)):
        rows.append(np.cross(np.eye(3), arms[k])[:, i])
        right.append(u[0, i] - u[k, i])
    x, y, z = np.linalg.solve(np.array(rows), np.array(right))
    turned: Floats = G + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return turned
