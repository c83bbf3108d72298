"""Vertex block descent in plain NumPy: backward Euler, one point after another.

    palpate gate CASE --simulator "python vertex_block_descent.py {case} {result} {iterations}"
        --iterations 20 --time-step 2.5e-3

A point takes Newton's step of its own, the others held, colour after colour: A. H. Chen, Z. Liu,
Y. Yang, C. Yuksel, Vertex Block Descent, ACM Trans. Graphics 43 (2024), eq. 6-10, without
acceleration. What it comes to is the minimum that backward Euler asks for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from backward_euler import LAWS, Body, answer


def blocks_of(body: Body) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
    """The function of forces and stiffnesses of corners: of displacement, cells and corners."""
    one = np.eye(3)

    def saint_venant_kirchhoff(u: Any, cells: Any, corners: Any) -> tuple[Any, Any]:
        F, g = body.deformation_gradients(u, cells), body.gradients[cells, corners]
        lmbda, mu = body.lmbda[cells, None, None], body.mu[cells, None, None]
        E = 0.5 * (F.transpose(0, 2, 1) @ F - one)
        S = lmbda * np.trace(E, axis1=1, axis2=2)[:, None, None] * one + 2.0 * mu * E
        Sg, Fg = np.einsum("cij,cj->ci", S, g), np.einsum("cij,cj->ci", F, g)
        stiffness = np.einsum("ci,ci->c", g, Sg)[:, None, None] * one
        stiffness = stiffness + (lmbda + mu) * Fg[:, :, None] * Fg[:, None, :]
        stiffness += mu * np.einsum("ci,ci->c", g, g)[:, None, None] * (F @ F.transpose(0, 2, 1))
        return np.einsum("cij,cj->ci", F, Sg), stiffness

    def neo_hookean_stable(u: Any, cells: Any, corners: Any) -> tuple[Any, Any]:
        F, g = body.deformation_gradients(u, cells), body.gradients[cells, corners]
        mu, L = body.mu[cells, None], (body.lmbda + body.mu)[cells, None]
        cofactor = np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])
        a, J = np.einsum("cij,cj->ci", cofactor, g), np.linalg.det(F)[:, None]
        force = mu * np.einsum("cij,cj->ci", F, g) + L * (J - 1.0 - mu / L) * a
        # det F is linear in the place of each point: it has no second derivative.
        stiffness = (mu[:, 0] * np.einsum("ci,ci->c", g, g))[:, None, None] * one
        return force, stiffness + L[:, :, None] * a[:, :, None] * a[:, None, :]

    return saint_venant_kirchhoff if body.law == LAWS[0] else neo_hookean_stable


def improver(body: Body) -> Callable[[Any, Any, Any], None]:
    """One sweep over all points."""
    blocks, count = blocks_of(body), len(body.points)
    around: list[set[int]] = [set() for _ in range(count)]
    for cell in body.cells.tolist():
        for point in cell:
            around[point] |= set(cell) - {point}
    groups = []
    for group in body.colours(list(around), count):
        of = np.full(count, -1)
        of[group] = np.arange(len(group))
        cells, corners = np.nonzero(of[body.cells] >= 0)
        groups.append((group, cells, corners, of[body.cells[cells, corners]]))

    def improve(u: Any, y: Any, w: Any) -> None:
        for group, cells, corners, rows in groups:
            f, K = blocks(u, cells, corners)
            volumes = body.volumes[cells]
            force = -w[group] * (u[group] - y[group])
            np.subtract.at(force, rows, volumes[:, None] * f)
            stiffness = w[group][:, :, None] * np.eye(3)
            np.add.at(stiffness, rows, volumes[:, None, None] * K)
            # A held component stays where it is.
            free = body.is_free[group]
            stiffness = np.where(free[:, :, None] & free[:, None, :], stiffness, np.eye(3))
            u[group] += np.linalg.solve(stiffness, np.where(free, force, 0.0)[..., None])[..., 0]

    return improve


if __name__ == "__main__":
    # From y it would need a line search, or far more iterations.
    answer("vertex block descent", improver, starts_at_y=False)
