"""Explicit steps as Taichi kernels on one core."""

from __future__ import annotations

from typing import Any

import numpy as np
import taichi as ti
from mechanics import central_differences, lame, rest_shape


class Steps:
    """The same law and the same update as ours."""

    version, precision = ".".join(map(str, ti.__version__)), "float32"

    def __init__(self, job: dict[str, Any]) -> None:
        ti.init(arch=ti.cpu, cpu_max_num_threads=1, fast_math=True, default_fp=ti.f32)
        num_points, num_cells = len(job["points"]), len(job["cells"])
        gradients, volumes = rest_shape(job)
        lmbda, mu = lame(job)
        keep, freedom = central_differences(job)
        u, d, f, load, mobility = (ti.Vector.field(3, ti.f32, num_points) for _ in range(5))
        corner = ti.Vector.field(4, ti.i32, num_cells)
        rest = ti.Matrix.field(3, 3, ti.f32, num_cells)
        volume = ti.field(ti.f32, num_cells)
        corner.from_numpy(job["cells"].astype(np.int32))
        rest.from_numpy(gradients.astype(np.float32))
        volume.from_numpy(volumes.astype(np.float32))
        mobility.from_numpy(freedom.astype(np.float32))
        load.from_numpy(job["external_force"].astype(np.float32))
        u.from_numpy(job["test_displacement"].astype(np.float32))

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
        add_forces()
        self.answer = {"force": f.to_numpy()}
        u.fill(0.0)
        f.fill(0.0)

    def advance(self, num_steps: int) -> None:
        """Two kernels a step."""
        for _ in range(num_steps):
            self._add_forces()
            self._update()
        ti.sync()
