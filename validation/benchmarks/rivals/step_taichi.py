"""Explicit steps as Taichi kernels on one core."""

from __future__ import annotations

from typing import Any

import numpy as np
import taichi as ti


class Rival:
    """The same law and the same update as ours."""

    tool, version, precision = "taichi", ".".join(map(str, ti.__version__)), "float32"

    def __init__(self, body: dict[str, Any]) -> None:
        ti.init(arch=ti.cpu, cpu_max_num_threads=1, fast_math=True, default_fp=ti.f32)
        points, cells = body["points"], body["cells"]
        num_points, num_cells = len(points), len(cells)
        edges = points[cells[:, 1:]] - points[cells[:, :1]]
        E, nu = float(body["youngs_modulus"]), float(body["poissons_ratio"])
        lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
        dt, half = float(body["time_step"]), 0.5 * float(body["mass_damping"] * body["time_step"])
        keep = (1.0 - half) / (1.0 + half)
        u, d, f, load, mobility = (ti.Vector.field(3, ti.f32, num_points) for _ in range(5))
        corner = ti.Vector.field(4, ti.i32, num_cells)
        rest = ti.Matrix.field(3, 3, ti.f32, num_cells)
        volume = ti.field(ti.f32, num_cells)
        corner.from_numpy(cells.astype(np.int32))
        rest.from_numpy(np.linalg.inv(edges).transpose(0, 2, 1).astype(np.float32))
        volume.from_numpy((np.linalg.det(edges) / 6.0).astype(np.float32))
        freedom = np.outer(dt**2 / (body["lumped_mass"] * (1.0 + half)), np.ones(3))
        freedom[body["held"]] = 0.0
        mobility.from_numpy(freedom.astype(np.float32))
        load.from_numpy(body["external_force"].astype(np.float32))

        @ti.kernel
        def add_forces():  # type: ignore[no-untyped-def]
            for c in corner:
                n = corner[c]
                g = rest[c]
                H = (
                    (u[n[1]] - u[n[0]]).outer_product(g[0, :])
                    + (u[n[2]] - u[n[0]]).outer_product(g[1, :])
                    + (u[n[3]] - u[n[0]]).outer_product(g[2, :])
                )
                strain = 0.5 * (H + H.transpose() + H.transpose() @ H)
                eye = ti.Matrix.identity(ti.f32, 3)
                S = volume[c] * (2.0 * mu * strain + lmbda * strain.trace() * eye)
                G = (eye + H) @ S @ g.transpose()
                for a in ti.static(range(3)):
                    column = ti.Vector([G[0, a], G[1, a], G[2, a]])
                    f[n[a + 1]] += column
                    f[n[0]] -= column

        @ti.kernel
        def update():  # type: ignore[no-untyped-def]
            for i in u:
                d[i] = keep * d[i] + mobility[i] * (load[i] - f[i])
                u[i] += d[i]
                f[i] = ti.Vector([0.0, 0.0, 0.0])

        self._add_forces, self._update = add_forces, update
        u.from_numpy(body["test_displacement"].astype(np.float32))
        add_forces()
        self.force = f.to_numpy()
        u.fill(0.0)
        f.fill(0.0)
        self.advance(1)

    def advance(self, num_steps: int) -> None:
        """Two kernels a step."""
        for _ in range(num_steps):
            self._add_forces()
            self._update()
        ti.sync()


def prepare(body: dict[str, Any]) -> Rival:
    """Set up the body."""
    return Rival(body)
