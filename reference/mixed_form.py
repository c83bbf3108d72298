"""Nearly incompressible bodies: displacement and pressure apart.

The stiff part of Saint-Venant-Kirchhoff's stress, lmbda tr(E) I, becomes an unknown of its own, one
degree lower than the displacement (C. Taylor, P. Hood 1973: P2-P1). Stationary in both,

    Pi(u, p) = integral of mu E : E + p tr(E) - p^2 / (2 lmbda)  -  work of the loads,

so that S = p I + 2 mu E, and for every q of the pressure space
integral of (tr(E) - p / lmbda) q = 0: p = lmbda tr(E) in the weak sense. The displacement no longer
has to make tr(E) small in every cell by itself, which is what locks. As lmbda grows, tr(E) = 0 is
what this material tends to; det F = 1 only for small strains.
F. Brezzi, M. Fortin, Mixed and Hybrid Finite Element Methods, 1991, chapter VI.

Of the other laws, whose W is lmbda/2 g(J)^2 and a part without lmbda, g = J - 1 or ln J, the second
part stands for mu E : E and g for tr(E): there J = 1 is what they tend to. The corotational law
tends to tr U = 3, of its g = tr U - 3, as Saint-Venant-Kirchhoff's to tr E = 0.

The unknown of the solver is p h / mu [m], with h a typical cell size, so that the rows of pressure
are forces like those of displacement, and one tolerance serves both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import fenicsx, laws
from palpate.reference.contact.tool_contact import Unknowns, create_contacts
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import cofactor, deformation_gradient, strain_tensor
from palpate.reference.loads import apply_loads, spring_forces
from palpate.reference.materials import (
    by_cell,
    energy_by_cell,
    lame_by_cell,
    lame_parameters,
)
from palpate.reference.mesh_transfer import carry_field, map_points, transfer
from palpate.reference.principal_laws import StrainCoefficients, stretch_sum
from palpate.reference.result import Formulation
from palpate.reference.supports import hold


class MixedProblem(DiscreteProblem):
    """A discrete problem with pressure among its unknowns.

    Flat vectors hold displacements and pressures, in the order of the mixed space.

    Args:
        problem: Mesh, material, supports and loads.
        strain: Strain measure.
        degree: Of the displacement, 2 or 3; the pressure's is one less.
        element: LINEAR, which is any that is not smoothed.

    Raises:
        InputError: Degree 1, smoothed tetrahedra, or Poisson's ratio not above 0.
    """

    formulation = Formulation.MIXED

    def __init__(
        self,
        problem: Problem,
        *,
        strain: Strain,
        degree: int,
        element: Element = Element.LINEAR,
    ) -> None:
        if element is Element.SMOOTHED:
            raise InputError(
                "smoothed tetrahedra have no mixed form: they do not lock; choose one of the two"
            )
        if degree < 2:
            raise InputError("the mixed form needs degree 2 or 3: with degree 1 it locks as well")
        materials = (problem.material, *(i.material for i in problem.inclusions))
        if not all(m.poissons_ratio > 0.0 for m in materials):
            raise InputError("the mixed form needs Poisson's ratios above 0; use the plain form")
        self.strain = strain
        self.element = element
        transferred = transfer(problem.mesh)
        mesh = transferred.mesh
        self._mixed = fenicsx.taylor_hood_space(mesh, degree)
        displacements, self._dofs = fenicsx.part_of_space(self._mixed)
        self.space = map_points(transferred, degree, displacements)
        self.num_dofs = int(self._mixed.dofmap.index_map.size_local)
        pressures, self._pressure_dofs = fenicsx.part_of_space(self._mixed, 1)
        self._pressures = map_points(transferred, degree - 1, pressures)
        # A node is owned by the same rank in each of the three spaces.
        self._own_dofs = self._dofs[: 3 * self.space.num_blocks]
        self.num_pressures = fenicsx.total(self.num_dofs - len(self._own_dofs))

        self.lame = lmbda, mu = lame_by_cell(transferred, problem.material, problem.inclusions)
        self._unknown = fem.Function(self._mixed)
        self.u, scaled = ufl.split(self._unknown)
        both = ufl.TestFunction(self._mixed)
        v = self._displacement_in(both)
        source = problem.mesh
        cell_size = (source.volume / source.num_cells) ** (1.0 / 3.0)
        self.pressure_unit = lame_parameters(problem.material)[1] / cell_size
        scale = fem.Constant(mesh, PETSc.ScalarType(self.pressure_unit))
        p = scale * scaled
        self.law = law = problem.material.law
        work: Any = None
        if strain is Strain.LINEAR or law.is_linear_in_strain:
            E = strain_tensor(self.u, strain)
            # mu E : E is of degree 4 (p - 1); p tr(E) and p^2 of no higher one from p = 2 on.
            order = (4 if strain is Strain.GREEN else 2) * (degree - 1)
            shape, volume = mu * ufl.inner(E, E), ufl.tr(E)
            self.stress = p * ufl.Identity(3) + 2 * mu * E
        elif law.is_of_stretches:
            order = self.stress_degree = laws.quadrature_degree(degree)
            by_shape = StrainCoefficients(
                mesh, self.u, energy_by_cell(problem.material, None, mu), order
            )
            F = deformation_gradient(self.u)
            S, self._coefficients = by_shape.slope, (by_shape,)
            if law is Law.COROTATIONAL:
                total = StrainCoefficients(mesh, self.u, lambda _: stretch_sum, order)
                self._coefficients += (total,)
                volume, S = total.value, S + p * total.slope
                self.stress = S
            else:
                volume = laws.volume_change(F, law)
                self.stress = S + p * ufl.inv(F) * cofactor(F)
            # What UFL cannot derive of the potential below: coefficients are constants to it.
            shape, work = by_shape.value, ufl.inner(F * S, ufl.grad(v))
        else:
            c01 = by_cell(transferred, problem.material, problem.inclusions, lambda m: m.c01)
            order = laws.quadrature_degree(degree)
            F = ufl.variable(deformation_gradient(self.u))
            shape = laws.energy_density(F, law, 0, mu, c01)
            volume = laws.volume_change(F, law)
            self.stress = ufl.inv(F) * (ufl.diff(shape, F) + p * ufl.diff(volume, F))
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": order})
        potential = (shape + p * volume - p**2 / (2 * lmbda)) * dx
        self.energy = (shape + p**2 / (2 * lmbda)) * dx
        self.virtual_work = ufl.derivative(potential, self._unknown, both)
        if work is not None:
            self.virtual_work += work * dx
        self._force = fenicsx.form(self.virtual_work)

        held = hold(self.space, problem.supports)
        self.held = held.renumbered(self._dofs)
        self.frames = self.held.frames
        self.free = np.setdiff1d(np.arange(self.num_dofs), self.held.dofs)
        self.free_displacements = np.setdiff1d(self._own_dofs, self.held.dofs)

        followers = [x for x in problem.loads if isinstance(x, Pressure) and strain is Strain.GREEN]
        dead = [x for x in problem.loads if x not in followers]
        plain = apply_loads(self.space, dead, None, ufl.TestFunction(displacements), strain)
        self.dead_force = self.from_nodal(plain.dead)
        works = apply_loads(self.space, followers, self.u, v, strain).followers
        unknowns = Unknowns(self.num_dofs, self._dofs)
        self.contacts = create_contacts(problem, self.space, held.dofs, unknowns)
        trial = ufl.TrialFunction(self._mixed)
        springs = spring_forces(
            self.space, problem.springs, u=self.u, v=v, unknown=self._unknown, trial=trial
        )
        self._linearise(self.work_change(trial), works, springs, trial)

    def _displacement_in(self, unknown: Any) -> Any:
        """See `ElasticBody`."""
        return ufl.split(unknown)[0]

    def of_displacement(self, values: Floats) -> Floats:
        """The part of a flat vector that belongs to displacements, in the order of `space`."""
        part: Floats = self.to_global(values)[self._own_dofs]
        return part

    def from_nodal(self, forces: Floats) -> Floats:
        """See `DiscreteProblem`; nothing acts on pressures."""
        both = np.zeros(self.num_dofs)
        both[self._own_dofs] = forces
        return self.to_local(both)

    def carried(self, other: DiscreteProblem, values: Floats, cells: Indices) -> Floats:
        """See `DiscreteProblem`; both the displacement and the pressure."""
        if not isinstance(other, MixedProblem):
            raise TypeError("a mixed problem takes up a mixed one")
        other.set_displacement(values)
        both = np.zeros(self.num_dofs)
        own_pressures = self._pressure_dofs[: self._pressures.num_blocks]
        places = (self._own_dofs, own_pressures)
        spaces = ((other.space, self.space), (other._pressures, self._pressures))
        given = (other._dofs, other._pressure_dofs)
        for taken, dofs, (source, target) in zip(given, places, spaces, strict=True):
            part = fenicsx.part_of(other._unknown, source.space, taken)
            both[dofs] = carry_field(source, part, target, cells)
        # The unknown is p h / mu.
        both[own_pressures] *= other.pressure_unit / self.pressure_unit
        return self.to_local(both)
