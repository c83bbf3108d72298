"""dolfinx: forms written in UFL, compiled for this processor; PETSc solves."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from harness import central_differences, lame

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401  (the wheel: finds its libraries for the imports below)
import dolfinx
import ufl
from dolfinx import fem
from mpi4py import MPI

_IS_OLD = tuple(map(int, dolfinx.__version__.split(".")[:2])) < (0, 6)
_JIT: dict[str, Any] = {
    "jit_params" if _IS_OLD else "jit_options": {
        "cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]
    }
}
_OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    "pc_gamg_type": "agg",
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.01,
    "pc_gamg_reuse_interpolation": True,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    "mg_levels_ksp_max_it": 3,
}


class _Body:
    """The mesh, the space of displacements and the compiled residual."""

    version, precision = dolfinx.__version__, "float64"

    def __init__(self, job: dict[str, Any], *, is_linear: bool) -> None:
        points, cells = job["points"], job["cells"].astype(np.int64)
        if _IS_OLD:
            shape = ufl.Cell("tetrahedron", geometric_dimension=3)
            element = ufl.Mesh(ufl.VectorElement("Lagrange", shape, 1))
            mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, points, element)
            V = fem.VectorFunctionSpace(mesh, ("Lagrange", 1))
        else:
            import basix.ufl

            element = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
            mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, element, points)
            V = fem.functionspace(mesh, ("Lagrange", 1, (3,)))
        lmbda, mu = lame(job)
        self.V, self.u = V, fem.Function(V)
        identity, H = ufl.Identity(3), ufl.grad(self.u)
        strain = 0.5 * (H + H.T) if is_linear else 0.5 * (H + H.T + H.T * H)
        S = lmbda * ufl.tr(strain) * identity + 2.0 * mu * strain
        P = S if is_linear else (identity + H) * S
        self.residual = ufl.inner(P, ufl.grad(ufl.TestFunction(V))) * ufl.dx
        self.residual_form = fem.form(self.residual, **_JIT)
        # dolfinx renumbers points: this gives its number for each of ours.
        self.coordinates = V.tabulate_dof_coordinates()
        self.order = np.empty(len(points), np.int64)
        self.order[_order(points)] = _order(self.coordinates)
        assert np.abs(self.coordinates[self.order] - points).max() < 1e-8
        self.load = self.renumbered(job["external_force"])

    def renumbered(self, rows: Any) -> Any:
        """Rows for our points as rows for dolfinx's."""
        moved = np.empty_like(rows)
        moved[self.order] = rows
        return moved


def _order(points: Any) -> Any:
    return np.lexsort(np.round(points, 9).T)


class Steps(_Body):
    """Central differences in increments; the residual is assembled as a vector at each step."""

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job, is_linear=False)
        self._keep, mobility = central_differences(job)
        self._mobility = self.renumbered(mobility)
        self._array = self.u.x.array.reshape(-1, 3)
        self._vector = fem.assemble_vector(self.residual_form)
        self._increment = np.zeros_like(self._array)
        self._array[:] = self.renumbered(job["test_displacement"])
        self.result = {"force": self._internal()[self.order]}
        self._array[:] = 0.0

    def _internal(self) -> Any:
        self._vector.array[:] = 0.0
        fem.assemble_vector(self._vector.array, self.residual_form)
        return self._vector.array.reshape(-1, 3)

    def advance(self, num_steps: int) -> None:
        """Whole steps."""
        for _ in range(num_steps):
            force = self.load - self._internal()
            self._increment *= self._keep
            self._increment += self._mobility * force
            self._array += self._increment


class Static(_Body):
    """Full Newton steps, conjugate gradients with GAMG and rigid modes."""

    def __init__(self, job: dict[str, Any]) -> None:
        # Imported here, so that explicit steps do not take its memory.
        import dolfinx.fem.petsc  # noqa: F401  (as fem.petsc)
        from petsc4py import PETSc

        self._PETSc = PETSc
        self._is_linear = str(job["strain"]) == "linear"
        super().__init__(job, is_linear=self._is_linear)
        tangent = ufl.derivative(self.residual, self.u, ufl.TrialFunction(self.V))
        self._tangent = fem.form(tangent, **_JIT)
        self._fixed = np.flatnonzero(self.renumbered(job["fixed"]).ravel())
        fixed = np.unique(self._fixed // 3).astype(np.int32)
        self._bc = fem.dirichletbc(np.zeros(3, dtype=PETSc.ScalarType), fixed, self.V)
        self._tolerance = float(job["relative_tolerance"])

    def _rigid_modes(self, matrix: Any) -> Any:
        centred = self.coordinates - self.coordinates.mean(axis=0)
        modes = np.zeros((6, len(centred), 3))
        for axis in range(3):
            modes[axis, :, axis] = 1.0
            modes[3 + axis] = np.cross(np.eye(3)[axis], centred)
        vectors = []
        for mode in np.linalg.qr(modes.reshape(6, -1).T)[0].T:
            vectors.append(matrix.createVecRight())
            vectors[-1].array[:] = mode
        return self._PETSc.NullSpace().create(vectors=vectors, comm=self._PETSc.COMM_SELF)

    def _imbalance(self) -> Any:
        force = fem.assemble_vector(self.residual_form)
        imbalance = self.load.ravel() - np.asarray(force.array)
        imbalance[self._fixed] = 0.0
        return imbalance

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Assembly and solve from rest."""
        self.u.x.array[:] = 0.0
        matrix = fem.petsc.create_matrix(self._tangent)
        right, step = matrix.createVecs()
        ksp = self._PETSc.KSP().create(self._PETSc.COMM_SELF)
        ksp.setOptionsPrefix("bench_static_")
        for key, value in _OPTIONS.items():
            self._PETSc.Options("bench_static_")[key] = value
        ksp.setFromOptions()
        imbalance = self._imbalance()
        first = np.linalg.norm(imbalance)
        iterations = linear_iterations = 0
        relative = 1.0
        while relative > self._tolerance and iterations < 30:
            matrix.zeroEntries()
            fem.petsc.assemble_matrix(matrix, self._tangent, bcs=[self._bc])
            matrix.assemble()
            if iterations == 0:
                matrix.setBlockSizes(3, 3)
                matrix.setNearNullSpace(self._rigid_modes(matrix))
                matrix.setOption(self._PETSc.Mat.Option.SPD, True)
                ksp.setOperators(matrix)
            enough = 0.3 * self._tolerance / relative
            early = 0.0 if self._is_linear else min(1e-2, 0.1 * relative)
            ksp.setTolerances(rtol=max(early, enough), max_it=2000)
            right.array[:] = imbalance
            ksp.solve(right, step)
            self.u.x.array[:] += step.array
            imbalance = self._imbalance()
            relative = float(np.linalg.norm(imbalance) / first)
            iterations += 1
            linear_iterations += ksp.getIterationNumber()
        for thing in (ksp, matrix, right, step):
            thing.destroy()
        self.result = {"displacement": self.u.x.array.reshape(-1, 3)[self.order]}
        return {
            "newton_iterations": iterations,
            "linear_iterations": linear_iterations,
            "method": "Newton, conjugate gradients, GAMG",
        }
