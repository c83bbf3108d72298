"""A body in motion: its mass, loads, springs and supports over time, and viscous forces.

Stiffness damping is a viscous stress proportional to the rate of strain,

    S_v = beta C : dE/dt,   R_v(u; v) = integral of F S_v : grad v,

C Hooke's at rest whatever the body's law, E its strain measure with dE/dt = sym(F^T grad u'), and
F = I under linear strain: Kelvin and Voigt's solid, written in E by J. C. Simo, T. J. R. Hughes,
Computational Inelasticity, 1998, section 10.1. About rest it is Rayleigh's beta K u'. The power
dissipated, the integral of dE/dt : beta C : dE/dt, is never below 0, and rotations are not damped:
neither would hold for the tangent stiffness of a stressed body instead of C, nor for K of the rest
state in a rotated body. Smoothed tetrahedra average dE/dt like E, and their stress like Hooke's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Problem, Strain, TimeSpan
from palpate.reference import fenicsx
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import second_piola_kirchhoff_stress, strain_tensor
from palpate.reference.loads import FollowerLoad, apply_loads, spring_forces
from palpate.reference.mesh_transfer import TransferredSpace, create_space, transfer
from palpate.reference.schemes import State, Stencil
from palpate.reference.smoothed import Smoothing
from palpate.reference.supports import fixed_dofs

Amplitude: TypeAlias = Callable[[float], float]
Amplitudes: TypeAlias = Amplitude | Sequence[Amplitude | None] | None
Field: TypeAlias = Points | Callable[[Points], Points] | None
_EPS = float(np.finfo(float).eps)


class MovingBody:
    """Mass, forces and supports of a problem in motion; each load has its own factor over time.

    Args:
        problem: The problem with its time span.
        strain: Strain measure.
        degree: Polynomial degree of the displacement.
        element: Kind of the tetrahedra.
        loads_by: See `simulate_implicit`, its `amplitude`.
        supports_by: See `simulate_implicit`, its `support_amplitude`.
        is_mass_lumped: Take row sums instead of the consistent mass.
        is_viscous_by_change: Take viscous forces by changes of strain per step; see `Viscosity`.

    Attributes:
        fixed: Degrees of freedom that supports fix.
        free: The other degrees of freedom of this rank.
        damping: Mass damping lambda [1/s].
        row_sums: Row sums of the mass [kg], flat; None for the consistent mass.

    Raises:
        InputError: A load, support or element cannot be used, or the number of factors is wrong.
    """

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        *,
        degree: int = 1,
        element: Element = Element.LINEAR,
        loads_by: Amplitudes = None,
        supports_by: Amplitudes = None,
        is_mass_lumped: bool = True,
        is_viscous_by_change: bool = False,
    ) -> None:
        span = problem.time
        assert span is not None
        space = create_space(transfer(problem.mesh), degree)
        self.body = body = ElasticBody(
            space, problem.material, Strain(strain), problem.inclusions, element=Element(element)
        )
        self.problem = problem
        self.row_sums = row_sums_of_mass(body, problem) if is_mass_lumped else None
        self._dead: list[tuple[Amplitude, Floats]] = []
        self._followers: list[tuple[Amplitude, FollowerLoad]] = []
        own: Amplitudes = [load.amplitude for load in problem.loads]
        factors = _one_each(own if loads_by is None else loads_by, len(problem.loads), "loads")
        self._supports = fixed_dofs(space, problem.supports)
        self.fixed: Indices = self._supports.dofs
        self.free: Indices = np.setdiff1d(np.arange(body.num_dofs), self.fixed)
        body.frames = self._supports.frames
        for load, factor in zip(problem.loads, factors, strict=True):
            dead, followers = apply_loads(body, [load])
            self._dead.append((factor, body.to_local(dead)))
            self._followers += [(factor, follower) for follower in followers]
        self._springs = spring_forces(body, problem.springs)
        own = [support.amplitude for support in problem.supports]
        self._support_factors = _one_each(
            own if supports_by is None else supports_by, len(problem.supports), "supports"
        )
        self.damping, beta = span.mass_damping, span.stiffness_damping
        self.viscosity: Viscosity | None = None
        if beta:
            factor_of_strain = beta / (span.time_step or 1.0) if is_viscous_by_change else beta
            self.viscosity = Viscosity(body, factor_of_strain, is_by_change=is_viscous_by_change)

    @cached_property
    def sampler(self) -> DetFSampler:
        """Measures det F."""
        return DetFSampler(self.body)

    @property
    def is_symmetric(self) -> bool:
        """Whether the tangent is symmetric: no follower load, and no nonlinear viscous stress."""
        is_viscous = self.viscosity is not None and self.body.strain is Strain.GREEN
        return not (self._followers or is_viscous)

    @property
    def is_linear(self) -> bool:
        """Whether the derivative of the forces by the displacement is constant."""
        is_linear = self.body.strain is Strain.LINEAR and not self._followers
        return is_linear and all(spring.is_steady for spring in self._springs)

    def start(self, displacement: Field, velocity: Field) -> tuple[Floats, Floats]:
        """Displacement [m] and velocity [m/s] at time 0, flat; the velocity of the problem if None.

        Given at the mesh's points, linear between them; or as a function of rest points.
        """
        v = self._flat(velocity)
        if velocity is None and self.problem.initial_velocity is not None:
            v = self._flat(self.problem.initial_velocity.at)
            v[self.fixed] = 0.0
        return self.at_supports(self._flat(displacement), 0.0), v

    def _flat(self, given: Field) -> Floats:
        space = self.body.space
        if given is None:
            return np.zeros(self.body.num_dofs)
        if not callable(given):
            return self.body.to_local(space.from_points(given))
        return self.body.to_local(np.asarray(given(space.coordinates), dtype=np.float64).ravel())

    def load(self, displacement: Floats, time: float) -> Floats:
        """Nodal forces of all loads and springs [N], flat."""
        force = np.zeros_like(displacement)
        for factor, dead in self._dead:
            force += factor(time) * dead
        if self._followers or self._springs:
            self.body.set_displacement(displacement)
        for factor, follower in self._followers:
            force += factor(time) * self.body.to_local(follower.force())
        for spring in self._springs:
            spring.move_to(time)
            force += spring.factor(time) * self.body.to_local(spring.force())
        return force

    def add_load_tangent(self, matrix: Any, weight: float, time: float) -> None:
        """Add minus the derivative of the loads, times a weight, at the last displacement."""
        for factor, follower in self._followers:
            follower.add_tangent(matrix, weight * factor(time))
        for spring in self._springs:
            spring.add_tangent(matrix, weight * spring.factor(time))

    def internal(self, displacement: Floats, other: Floats) -> tuple[Floats, Floats | None]:
        """Internal forces, and their viscous part if any [N], flat; see `Viscosity.force`."""
        force = self.body.internal_force(displacement)
        if self.viscosity is None:
            return force, None
        viscous = self.viscosity.force(displacement, other)
        return force + viscous, viscous

    def inertia(self, acceleration: Floats) -> Floats:
        """M a [N], flat."""
        if self.row_sums is not None:
            return self.row_sums * acceleration
        field, forms = self._inertia
        field.x.array[: len(acceleration)] = self.body.to_global(acceleration)
        field.x.scatter_forward()
        force = fenicsx.assemble_vector(forms[0])
        for form in forms[1:]:
            force += fenicsx.assemble_vector(form)
        return self.body.to_local(force)

    @cached_property
    def density(self) -> Any:
        """Density of each cell [kg/m3], as a function."""
        return density_by_cell(self.body, self.problem)

    @cached_property
    def mass_measure(self) -> Any:
        """Measure of the volume with a quadrature that is exact for the consistent mass."""
        space = self.body.space
        degree = 2 * space.degree
        return ufl.dx(domain=space.transferred.mesh, metadata={"quadrature_degree": degree})

    @cached_property
    def _inertia(self) -> tuple[Any, list[Any]]:
        body = self.body
        field = fem.Function(body.space.space)
        work = self.density * ufl.inner(field, body.v) * self.mass_measure
        on_surface = self.works_of_masses(field)
        return field, [fenicsx.form(of) for of in (work, *on_surface)]

    def works_of_masses(self, acceleration: Any) -> list[Any]:
        """Virtual work of the consistent inertia of each mass on the surface, in UFL."""
        space, masses = self.body.space, self.problem.masses
        return works_of_masses(space, masses, acceleration, self.body.v, degree=2 * space.degree)

    def kinetic_energy(self, velocity: Floats) -> float:
        """Half of v . M v [J]."""
        return 0.5 * float(fenicsx.total(float(velocity @ self.inertia(velocity))))

    def at_outputs(self, states: Sequence[State], span: TimeSpan) -> dict[str, Any]:
        """Fields of a `Trajectory` that follow from the states at the outputs."""
        body = self.body
        return {
            "times": span.end_time / span.num_outputs * np.arange(span.num_outputs + 1),
            "displacements": np.array([body.at_points(s.u) for s in states]),
            "velocities": np.array([body.at_points(s.v) for s in states]),
            "kinetic_energies": np.array([self.kinetic_energy(s.v) for s in states]),
            "strain_energies": np.array([body.strain_energy(s.u) for s in states]),
            "strain": body.strain,
            "versions": fenicsx.versions(),
        }

    def balance(self, stencil: Stencil, u: Floats, time: float) -> Balance:
        """The forces in a step that begins at a time, with a displacement at its end."""
        middle, velocity = stencil.middle(u), stencil.velocity(u)
        external = self.load(middle, time + stencil.theta * stencil.time_step)
        internal, viscous = self.internal(middle, velocity)
        damped = self.damping * velocity
        inertial = self.inertia(stencil.acceleration(u) + damped)
        return Balance(external, internal, inertial, damped, viscous)

    def force(self, displacement: Floats, other: Floats, time: float) -> Floats:
        """F(t) - R [N], flat; see `internal`."""
        return self.load(displacement, time) - self.internal(displacement, other)[0]

    def at_supports(self, displacement: Floats, time: float) -> Floats:
        """The displacement with its fixed components set to their values at a time [m]."""
        moved = displacement.copy()
        moved[self.fixed] = self._supports.at([factor(time) for factor in self._support_factors])
        return moved

    def is_sound(self, displacement: Floats) -> bool:
        """Whether no cell is inverted; always true under linear strain."""
        return self.body.strain is Strain.LINEAR or self.sampler.smallest(displacement) > 0.0

    def rounding_error(self, matrix_norm: float, displacement: Floats) -> float:
        """Largest norm of the nodal forces due to rounding [N], from the norm of the tangent."""
        source = self.body.space.transferred.source
        cell = (source.volume / source.num_cells) ** (1.0 / 3.0)
        largest = fenicsx.largest(float(np.max(np.abs(displacement), initial=0.0)))
        return float(4.0 * _EPS * matrix_norm * max(largest, cell))


@dataclass(frozen=True, eq=False)
class Balance:
    """Nodal forces at the time at which a step balances them [N], flat.

    Attributes:
        external: Forces of loads and springs.
        internal: Internal forces of the body, the viscous ones included.
        inertial: Inertial forces, mass damping included.
        damped: lambda times the velocity at that time [m/s2].
        viscous: The part of the internal forces by stiffness damping; None without it.
    """

    external: Floats
    internal: Floats
    inertial: Floats
    damped: Floats
    viscous: Floats | None

    @property
    def lacking(self) -> Floats:
        """Out-of-balance forces: external less internal and inertial ones."""
        return self.external - self.internal - self.inertial

    def scale(self, among: Any = slice(None)) -> float:
        """Largest of the norms of the three, over some entries."""
        parts = (self.internal, self.external, self.inertial)
        return max(fenicsx.norm(part[among]) for part in parts)


class StepLostError(Exception):
    """No solution of a step's equations was found; the message says why."""


def row_sums_of_mass(body: ElasticBody, problem: Problem) -> Floats:
    """Integral of rho N_a: a quarter of each cell's mass to its corners [kg], flat.

    With those of masses on the surface, a third of each facet's part to its corners.
    """
    one = ufl.as_vector([1.0, 1.0, 1.0])
    dx = ufl.dx(domain=body.space.transferred.mesh, metadata={"quadrature_degree": 1})
    density = density_by_cell(body, problem)
    rows = fenicsx.assemble_vector(fenicsx.form(density * ufl.inner(one, body.v) * dx))
    for work in works_of_masses(body.space, problem.masses, one, body.v, degree=1):
        rows += fenicsx.assemble_vector(fenicsx.form(work))
    return rows


def works_of_masses(
    space: TransferredSpace, masses: Sequence[PointMass], acceleration: Any, v: Any, *, degree: int
) -> list[Any]:
    """Integral of m/A a . v over the facets of each mass, in UFL, exact to a degree."""
    mesh, works = space.transferred.mesh, []
    for number, mass in enumerate(masses, start=1):
        per_area = mass.density(space.transferred.source.points)
        area = space.transferred.facet_measure(mass.facets, f"mass {number}", degree=degree)
        constant = fem.Constant(mesh, PETSc.ScalarType(per_area))
        works.append(constant * ufl.inner(acceleration, v) * area)
    return works


def density_by_cell(body: ElasticBody, problem: Problem) -> Any:
    """Density [kg/m3], as a function that is constant in each cell."""
    transferred = body.space.transferred
    return transferred.by_cell(problem.material, problem.inclusions, lambda m: m.density)


def _one_each(given: Amplitudes, count: int, what: str) -> list[Amplitude]:
    if given is None or callable(given):
        return [given or _always] * count
    if len(given) != count:
        raise InputError(f"{len(given)} amplitudes for {count} {what}; give one for each, or one")
    return [factor or _always for factor in given]


def _always(_time: float) -> float:
    return 1.0


class Viscosity:
    """Viscous forces of a body, by rates or by finite changes of its strain.

    Of a factor beta [s]; where `is_by_change`, which takes E(u) - E(w) for an earlier displacement
    w instead of the rate of E along a velocity w, of beta over the time step [-].
    """

    def __init__(self, body: ElasticBody, factor: float, *, is_by_change: bool = False) -> None:
        self._body, self._factor, space = body, factor, body.space
        self._mesh = space.transferred.mesh
        is_green = body.strain is Strain.GREEN
        self._w = w = fem.Function(space.space)
        # A factor of 0 or 1, so that the tangent of smoothed cells has a form also where F is I.
        turns = self._constant(is_green)
        F = ufl.Identity(3) + turns * ufl.grad(body.u)
        if is_by_change:
            strains = strain_tensor(body.u, body.strain) - strain_tensor(w, body.strain)
        else:
            strains = ufl.sym((F.T if is_green else ufl.Identity(3)) * ufl.grad(w))
        degree = (4 if is_green else 2) * (space.degree - 1)
        self._dx = dx = ufl.dx(domain=self._mesh, metadata={"quadrature_degree": degree})
        self._smoothing: Smoothing | None = None
        if body.element is Element.SMOOTHED:
            self._smoothing = Smoothing(space, body.material, body.lame, is_hookean=True)
            S, p = (fem.Function(of) for of in (self._smoothing.tensors, self._smoothing.scalars))
            self._cell_stress, stress = (S, p), S + p * ufl.Identity(3)
            self._integrals = self._integrals_of(strains)
            self._forms = [fenicsx.form(of) for of in self._integrals]
        else:
            stress = factor * second_piola_kirchhoff_stress(strains, *body.lame)
        self._work = ufl.inner(F * stress, ufl.grad(body.v)) * dx
        self._force = fenicsx.form(self._work)
        self._weights = [self._constant(0.0) for _ in range(2)]
        self._tangents: list[tuple[Any, Any]] = []

    def _integrals_of(self, strains: Any) -> tuple[Any, Any]:
        """Forms of the integrals of strains and of their traces over each cell."""
        assert self._smoothing is not None
        T, q = (ufl.TestFunction(x) for x in (self._smoothing.tensors, self._smoothing.scalars))
        return ufl.inner(strains, T) * self._dx, ufl.tr(strains) * q * self._dx

    def _assembled(self) -> tuple[Floats, Floats]:
        strains, traces = (fenicsx.assemble_vector(of) for of in self._forms)
        return strains, traces

    def _constant(self, value: float) -> Any:
        return fem.Constant(self._mesh, PETSc.ScalarType(value))

    def force(self, displacement: Floats, other: Floats) -> Floats:
        """Nodal forces, a part of the internal ones [N], flat.

        At a displacement [m] and a velocity [m/s], or the earlier displacement [m], flat.
        """
        body = self._body
        body.set_displacement(displacement)
        self._w.x.array[: len(other)] = body.to_global(other)
        self._w.x.scatter_forward()
        if self._smoothing is not None:
            found = self._smoothing.stress(self._assembled())
            for function, values in zip(self._cell_stress, found, strict=True):
                function.x.array[:] = self._factor * values
        return body.to_local(fenicsx.assemble_vector(self._force))

    def add_tangent(self, matrix: Any, by_displacement: float, by_rate: float) -> None:
        """Add the derivative of the last force, along x, y, z; under Green strain not symmetric.

        To the body's tangent, a PETSc matrix, with weights of the derivatives by the displacement
        and by the velocity or the earlier displacement.
        """
        if not self._tangents:
            self._compile()
        for constant, weight in zip(self._weights, (by_displacement, by_rate), strict=True):
            constant.value = weight
        for form, of in self._tangents:
            of.zeroEntries()
            fenicsx.assemble_into_matrix(of, form)
        # Smoothing and contact over facets couple more points than cells do.
        part = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(1.0, self._tangents[0][1], structure=part)
        if self._smoothing is not None:
            strains, traces, *changes = (of for _, of in self._tangents[1:])
            averaged = self._smoothing.stiffness(
                self._assembled(), (strains, traces), (changes[0], changes[1])
            )
            matrix.axpy(self._factor, averaged, structure=part)
            averaged.destroy()

    def _compile(self) -> None:
        body = self._body
        du = ufl.TrialFunction(body.space.space)
        forms = [self._along(self._work, du)]
        if self._smoothing is not None:
            own = self._integrals_of(strain_tensor(body.u, body.strain))
            forms += [ufl.derivative(of, body.u, du) for of in own]
            forms += [self._along(of, du) for of in self._integrals]
        compiled = [fenicsx.form(form) for form in forms]
        self._tangents = [(form, fenicsx.create_matrix(form)) for form in compiled]

    def _along(self, of: Any, du: Any) -> Any:
        by_displacement, by_rate = self._weights
        along_u, along_w = (ufl.derivative(of, x, du) for x in (self._body.u, self._w))
        return by_displacement * along_u + by_rate * along_w
