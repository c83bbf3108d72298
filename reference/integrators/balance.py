"""The equations of one implicit step, and Newton's method for them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import fenicsx
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.explicit import row_sums_of_mass
from palpate.reference.fenicsx import PETSc, ufl
from palpate.reference.linear_solver import LinearSolveError, LinearSolver
from palpate.reference.loads_over_time import Amplitudes, LoadsOverTime
from palpate.reference.mesh_transfer import create_space, transfer
from palpate.reference.schemes import State, Stencil
from palpate.reference.viscosity import Viscosity

_MAX_ITERATIONS = 60
# A Newton step is cut in two, so often at most, while a cell would invert or the forces along it
# push back harder than they pulled.
_MAX_CUTS = 12
_EPS = float(np.finfo(float).eps)


class NotSolvedError(Exception):
    """A step's equations have no solution that was found; the message says why."""


class Balance:
    """Forces, lumped mass and supports of one problem, over the degrees of freedom.

    Args:
        problem: With its time span.
        strain: Strain measure.
        element: Of the tetrahedra.
        loads_by: See `LoadsOverTime`.
        supports_by: Likewise.
        tolerance: Relative residual of a step [-].

    Attributes:
        mass: Row sums [kg], flat.
        damping: lambda [1/s].
        iterations: Linear solves so far.
        largest_residual: Relative, of the steps so far [-].
    """

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        element: Element,
        loads_by: Amplitudes = None,
        supports_by: Amplitudes = None,
        *,
        tolerance: float,
    ) -> None:
        assert problem.time is not None
        space = create_space(transfer(problem.mesh), 1)
        self.body = body = ElasticBody(
            space, problem.material, strain, problem.inclusions, element=element
        )
        self._problem = problem
        self.mass = row_sums_of_mass(body, problem)
        self.damping, beta = problem.time.mass_damping, problem.time.stiffness_damping
        self.viscosity = Viscosity(body, beta) if beta else None
        self.loads = LoadsOverTime(body, problem, loads_by, supports_by)
        self._tolerance = tolerance
        self._sampler = DetFSampler(body)
        self._tangent = fenicsx.form(body.work_change(ufl.TrialFunction(space.space)))
        self._matrix = fenicsx.create_matrix(self._tangent)
        self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._solver = LinearSolver(
            space.coordinates,
            is_symmetric=not (
                self.loads.has_followers or (self.viscosity and body.strain is Strain.GREEN)
            ),
            to_local=body.to_local,
        )
        self.iterations = 0
        self.largest_residual = 0.0
        # Of a linear body, whose matrix changes with the stencil only.
        self._kept: tuple[tuple[float, float, float], Any] | None = None
        self._matrix_norm = 0.0  # of the last one solved with
        source = space.transferred.source
        self._cell_size = (source.volume / source.num_cells) ** (1.0 / 3.0)

    def start(self, displacement: Points | None, velocity: Points | None) -> State:
        """The state at time 0: at rest and still, where nothing else is given."""
        body, zero = self.body, np.zeros_like(self._problem.mesh.points)
        if velocity is None and self._problem.initial_velocity is not None:
            velocity = self._problem.initial_velocity.at(self._problem.mesh.points)
        given = body.space.from_points(zero if displacement is None else displacement)
        u = self.loads.at_supports(body.to_local(given), 0.0)
        v = body.to_local(body.space.from_points(zero if velocity is None else velocity))
        v[self.loads.held] = 0.0
        a = self.force(u, v, 0.0) / self.mass - self.damping * v
        a[self.loads.held] = 0.0
        return State(u, v, a)

    def force(self, displacement: Floats, velocity: Floats, time: float) -> Floats:
        """F(t) - R(u, v) [N]."""
        return self.loads.force(displacement, time) - self._internal(displacement, velocity)

    def _internal(self, displacement: Floats, velocity: Floats) -> Floats:
        force = self.body.internal_force(displacement)
        if self.viscosity is not None:
            force += self.viscosity.force(displacement, velocity)
        return force

    def kinetic_energy(self, velocity: Floats) -> float:
        """Half of v . M v [J]."""
        return 0.5 * float(fenicsx.total(float(velocity @ (self.mass * velocity))))

    def solve(self, stencil: Stencil, time: float) -> State:
        """The state at the end of a step.

        Args:
            stencil: Its equations.
            time: At its start [s].

        Raises:
            NotSolvedError: Newton's method found no solution.
        """
        dt, free, held = stencil.time_step, self.loads.free, self.loads.held
        u = self.loads.at_supports(stencil.state.u + dt * stencil.state.v, time + dt)
        if not self._is_sound(stencil.place(u)):
            u = self.loads.at_supports(stencil.state.u, time + dt)
        residual, scale = self._residual(stencil, u, time)
        rounding, last, still = 0.0, math.inf, np.zeros(len(held))
        for _ in range(_MAX_ITERATIONS):
            norm = fenicsx.norm(residual[free])
            if not math.isfinite(norm):
                raise NotSolvedError("the residual is not finite")
            if norm <= self._tolerance * scale or (norm > 0.5 * last and norm <= rounding):
                self.largest_residual = max(self.largest_residual, norm / scale if scale else 0.0)
                return stencil.after(u)
            last = norm
            try:
                du = self._newton_step(stencil, u, time, residual, still)
            except LinearSolveError as error:
                raise NotSolvedError(str(error)) from None
            largest = fenicsx.largest(float(np.max(np.abs(u), initial=0.0)))
            rounding = 4.0 * _EPS * self._matrix_norm * max(largest, self._cell_size)
            u, residual, scale = self._along(stencil, u, du, time, residual)
        raise NotSolvedError(f"no convergence in {_MAX_ITERATIONS} iterations")

    def _residual(self, stencil: Stencil, u: Floats, time: float) -> tuple[Floats, float]:
        """What is out of balance [N], flat, and the largest of its parts."""
        place = stencil.place(u)
        external = self.loads.force(place, time + stencil.theta * stencil.time_step)
        velocity = stencil.velocity(u)
        internal = self._internal(place, velocity)
        moved = stencil.acceleration(u) + self.damping * velocity
        inertia = self.mass * moved
        free = self.loads.free
        scale = max(fenicsx.norm(part[free]) for part in (external, internal, inertia))
        return external - internal - inertia, scale

    def _newton_step(
        self, stencil: Stencil, u: Floats, time: float, residual: Floats, still: Floats
    ) -> Floats:
        self.iterations += 1
        body, held = self.body, self.loads.held
        factors = stencil.A + self.damping * stencil.B, stencil.theta, stencil.B
        is_linear = body.strain is Strain.LINEAR and self.loads.is_linear
        if is_linear and self._kept is not None and self._kept[0] == factors:
            return self._solver.solve(
                self._kept[1], residual, held, still, tolerance=1e-4, is_same_matrix=True
            )
        body.set_displacement(stencil.place(u))
        self._matrix.zeroEntries()
        fenicsx.assemble_into_matrix(self._matrix, self._tangent)
        self.loads.add_tangent(self._matrix, 1.0, time + stencil.theta * stencil.time_step)
        matrix = body.with_smoothing(self._matrix)
        matrix.scale(stencil.theta)
        if self.viscosity is not None:
            self.viscosity.add_tangent(matrix, stencil.theta, stencil.B)
        if body.frames is not None:
            matrix = body.frames.turned(matrix)
        diagonal = matrix.getDiagonal()
        diagonal.array[:] += factors[0] * self.mass
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        self._matrix_norm = float(matrix.norm())
        if is_linear:
            self._kept = factors, matrix
        return self._solver.solve(matrix, residual, held, still, tolerance=1e-4)

    def _along(
        self, stencil: Stencil, u: Floats, du: Floats, time: float, residual: Floats
    ) -> tuple[Floats, Floats, float]:
        """As far along a Newton step as no cell inverts and the forces do not push back harder.

        Those of dead loads have a potential, the incremental one, of which this is the slope.
        """
        first = abs(float(fenicsx.total(float(residual @ du))))
        length = 1.0
        for _ in range(_MAX_CUTS):
            further = u + length * du
            if self._is_sound(stencil.place(further)):
                left, scale = self._residual(stencil, further, time)
                # NaN, of a law beyond its end, is cut as well.
                if abs(float(fenicsx.total(float(left @ du)))) <= first:
                    return further, left, scale
            length *= 0.5
        raise NotSolvedError("a cell would invert, or no part of a Newton step balances better")

    def _is_sound(self, u: Floats) -> bool:
        return self.body.strain is Strain.LINEAR or self._sampler.smallest(u) > 0.0
