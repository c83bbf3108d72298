"""The discrete balance of forces R(u, t) = internal(u) - t external(u) of a problem."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference import fenicsx, laws
from palpate.reference.contact.tool_contact import create_contacts
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import (
    deformation_gradient,
    lame_parameters,
    second_piola_kirchhoff_stress,
    strain_energy_density,
    strain_tensor,
)
from palpate.reference.loads import apply_loads, spring_forces
from palpate.reference.mesh_transfer import TransferredSpace, carry_field, create_space, transfer
from palpate.reference.principal_laws import StrainCoefficients, energy_by_cell, stretch_sum
from palpate.reference.result import Formulation
from palpate.reference.smoothed import SmoothedBody
from palpate.reference.supports import NodeFrames, fixed_dofs


class LawForms:
    """Energy density and stresses of a material's law for a displacement, in UFL.

    Every law is W = W_0 + lmbda/2 g^2, with W_0 the energy for lmbda = 0 and g a measure of the
    change of volume: tr E for laws linear in strain, tr U - 3 for the corotational law, J - 1 or
    ln J for the others. Moduli are Lamé's parameters and c01 [Pa], functions that are constant in
    each cell; None instead of lmbda gives W_0 alone.

    Attributes:
        degree: Degree of the quadrature.
        energy: W [J/m3].
        piola: First Piola-Kirchhoff stress, dW/dF [Pa]; Cauchy's under linear strain.
        stress: Second Piola-Kirchhoff stress [Pa]; Cauchy's under linear strain.
        stress_degree: See `ElasticBody`.
        coefficients: Coefficients of the forms to be updated to u before forms are integrated.
    """

    def __init__(
        self,
        space: TransferredSpace,
        u: Any,
        material: Material,
        strain: Strain,
        moduli: tuple[Any, Any, Any],
    ) -> None:
        lmbda, mu, c01 = moduli
        self._mesh, self._u, self._law = space.transferred.mesh, u, material.law
        self._strain = strain
        self.is_linear_in_strain = strain is Strain.LINEAR or material.law.is_linear_in_strain
        self.stress_degree: int | None = None
        self.coefficients: tuple[StrainCoefficients, ...] = ()
        self.degree = laws.quadrature_degree(space.degree)
        F = deformation_gradient(u)
        if self.is_linear_in_strain:
            # S is of degree 2 (p - 1) or p - 1, F and grad v are of degree p - 1: exact.
            self.degree = (4 if strain is Strain.GREEN else 2) * (space.degree - 1)
            E = strain_tensor(u, strain)
            first = 0 if lmbda is None else lmbda
            self.stress = second_piola_kirchhoff_stress(E, first, mu)
            self.energy = strain_energy_density(E, first, mu)
            self.piola = F * self.stress if strain is Strain.GREEN else self.stress
        elif material.law.is_of_stretches:
            function = energy_by_cell(material, lmbda, mu)
            of_strain = StrainCoefficients(self._mesh, u, function, self.degree)
            self.coefficients, self.stress_degree = (of_strain,), self.degree
            self.stress, self.energy = of_strain.slope, of_strain.value
            self.piola = F * self.stress
        else:
            constants = (material.law, 0 if lmbda is None else lmbda, mu, c01)
            self.piola = laws.first_piola_kirchhoff_stress(F, *constants)
            self.energy = laws.energy_density(F, *constants)
            self.stress = ufl.inv(F) * self.piola

    @property
    def dx(self) -> Any:
        """The measure of the rest volume."""
        return ufl.dx(domain=self._mesh, metadata={"quadrature_degree": self.degree})

    def volume(self) -> tuple[Any, Any, Any]:
        """Measure g [-] with dg/dF and dg/dE; both derivatives are equal under linear strain."""
        F = deformation_gradient(self._u)
        if self.is_linear_in_strain:
            one = ufl.Identity(3)
            slope = F if self._strain is Strain.GREEN else one
            return ufl.tr(strain_tensor(self._u, self._strain)), slope, one
        if self._law is Law.COROTATIONAL:
            total = StrainCoefficients(self._mesh, self._u, lambda _: stretch_sum, self.degree)
            self.coefficients += (total,)
            return total.value, F * total.slope, total.slope
        F = ufl.variable(F)
        g = laws.volume_change(F, self._law)
        slope = ufl.diff(g, F)
        return g, slope, ufl.inv(F) * slope


class ElasticBody:
    """Internal forces, their tangent and energy on a space; E and nu are data of the forms.

    Attributes:
        u: Displacement, a function.
        v: Test function.
        lame: First Lamé parameter and shear modulus [Pa], functions constant in each cell.
        law: The law of the material, which is used under Green strain.
        stress: Second Piola-Kirchhoff stress of `u` in UFL [Pa]; Cauchy's under linear strain.
        piola: First Piola-Kirchhoff stress [Pa]; Cauchy's under linear strain.
        virtual_work: Integral of piola : grad v.
        stress_degree: Quadrature degree that forms of stresses must be integrated with; None where
            any will do.

    Raises:
        InputError: Smoothed tetrahedra are of another degree than 1, or on several ranks.
    """

    stress_degree: int | None = None
    _smoothed: SmoothedBody | None = None
    # Coefficients of laws that are written in stretches.
    _coefficients: tuple[StrainCoefficients, ...] = ()
    # Axes of nodes on slanted planes: the degrees of freedom of these nodes are components along
    # them, in every flat vector that this class takes or returns.
    frames: NodeFrames | None = None

    def __init__(
        self,
        space: TransferredSpace,
        material: Material,
        strain: Strain,
        inclusions: Sequence[Inclusion] = (),
        *,
        element: Element = Element.LINEAR,
    ) -> None:
        self.space = space
        self.strain = strain
        self.element = element
        self.u = fem.Function(space.space)
        self.v = ufl.TestFunction(space.space)
        moduli = self._read_moduli(material, inclusions)
        if element is Element.SMOOTHED:
            self._smoothed = SmoothedBody(space, self.u, material, strain, moduli)
            self._coefficients = self._smoothed.coefficients
            self.stress, self.piola = self._smoothed.stress, self._smoothed.piola
            self.virtual_work = self._smoothed.virtual_work(self.v)
        else:
            forms = LawForms(space, self.u, material, strain, moduli)
            self._coefficients, self.stress_degree = forms.coefficients, forms.stress_degree
            self.stress, self.piola = forms.stress, forms.piola
            self.energy = forms.energy * forms.dx
            self.virtual_work = ufl.inner(forms.piola, ufl.grad(self.v)) * forms.dx
        self.num_dofs = 3 * space.num_blocks  # owned by this rank
        self._unknown = self.u
        self._force = fenicsx.form(self.virtual_work)

    def _read_moduli(
        self, material: Material, inclusions: Sequence[Inclusion]
    ) -> tuple[Any, Any, Any]:
        """Lamé's parameters and c01 [Pa], functions that are constant in each cell."""
        self.material, self.law, by_cell = material, material.law, self.space.transferred.by_cell
        lmbda = by_cell(material, inclusions, lambda m: lame_parameters(m)[0])
        mu = by_cell(material, inclusions, lambda m: lame_parameters(m)[1])
        self.lame = lmbda, mu
        return lmbda, mu, by_cell(material, inclusions, lambda m: m.c01)

    def work_change(self, trial: Any) -> Any:
        """Derivative of the virtual work by the unknown along a trial function."""
        return self.derivative(self.virtual_work, trial)

    def derivative(self, of: Any, direction: Any) -> Any:
        """Derivative of a form by the unknown along a direction, a function of its space."""
        change = ufl.derivative(of, self._unknown, direction)
        for coefficients in self._coefficients:
            change += sum(coefficients.changes(of, self._displacement_in(direction)))
        return change

    def _displacement_in(self, unknown: Any) -> Any:
        """The displacement part of all unknowns, in UFL."""
        return unknown

    @property
    def unknown(self) -> Any:
        """The function of all unknowns, `u` among them."""
        return self._unknown

    def of_displacement(self, values: Floats) -> Floats:
        """The part of a flat vector that belongs to displacements along x, y, z, as in `space`."""
        return self.to_global(values)

    def to_local(self, values: Floats) -> Floats:
        """Turn a flat vector along x, y, z to components along the nodes' own axes."""
        return values if self.frames is None else self.frames.to_local(values)

    def to_global(self, values: Floats) -> Floats:
        """Turn a flat vector along the nodes' own axes to components along x, y, z."""
        return values if self.frames is None else self.frames.to_global(values)

    def at_points(self, values: Floats) -> Points:
        """Displacements of a flat vector at the TetMesh's points, shape (num_points, 3)."""
        return self.space.at_points(self.of_displacement(values))

    def from_nodal(self, forces: Floats) -> Floats:
        """A flat vector of forces along x, y, z at the nodes of `space`."""
        return self.to_local(forces)

    def set_displacement(self, displacement: Floats) -> None:
        """Set `u` to the given flat vector, and update the stress."""
        self._unknown.x.array[: self.num_dofs] = self.to_global(displacement)
        self._unknown.x.scatter_forward()
        for coefficients in self._coefficients:
            coefficients.update()
        if self._smoothed is not None:
            self._smoothed.update()

    def internal_force(self, displacement: Floats) -> Floats:
        """Nodal internal forces [N], flat, shape (num_dofs,)."""
        self.set_displacement(displacement)
        return self.to_local(fenicsx.assemble_vector(self._force))

    def with_smoothing(self, matrix: Any) -> Any:
        """The derivative of `virtual_work` at `u`, along x, y, z, with the terms of smoothing.

        `matrix` is the derivative at fixed stress; returned as it is where nothing is smoothed.
        """
        if self._smoothed is None:
            return matrix
        # Smoothing couples all points of a patch; those of a cell are some of them.
        whole = self._smoothed.stiffness()
        whole.axpy(1.0, matrix, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return whole

    @cached_property
    def _energy(self) -> Any:
        return fenicsx.form(self.energy)

    def strain_energy(self, displacement: Floats) -> float:
        """Stored energy [J]."""
        self.set_displacement(displacement)
        if self._smoothed is not None:
            return self._smoothed.energy()
        return fenicsx.assemble_scalar(self._energy)


class DiscreteProblem(ElasticBody):
    """An elastic body with the supports, loads, springs and tools of its problem.

    Attributes:
        fixed: Degrees of freedom that supports fix, with their prescribed values.
        free: The other degrees of freedom of this rank.
        free_displacements: The free degrees of freedom without pressures.
        num_pressures: Number of pressure unknowns over all ranks.
    """

    num_pressures = 0
    formulation = Formulation.DISPLACEMENT

    def __init__(
        self,
        problem: Problem,
        *,
        strain: Strain,
        degree: int,
        element: Element = Element.LINEAR,
    ) -> None:
        space = create_space(transfer(problem.mesh), degree)
        super().__init__(space, problem.material, strain, problem.inclusions, element=element)
        self._attach(problem)

    def _attach(
        self, problem: Problem, dofs: Indices | None = None, idle: Indices | None = None
    ) -> None:
        """Add supports, loads, springs and tools.

        `dofs` are the displacements among all unknowns, `idle` unknowns that are always 0.
        """
        space = self.space
        fixed = fixed_dofs(space, problem.supports)
        self.fixed = fixed if dofs is None else fixed.renumbered(dofs)
        if idle is not None and len(idle):
            self.fixed = self.fixed.with_zeros(idle)
        self.frames = self.fixed.frames
        self.free = np.setdiff1d(np.arange(self.num_dofs), self.fixed.dofs)
        own = self.free if dofs is None else dofs[: 3 * space.num_blocks]
        self.free_displacements = np.setdiff1d(own, self.fixed.dofs)
        dead, followers = apply_loads(self, problem.loads)
        self.dead_force = self.from_nodal(dead)
        self.contacts = create_contacts(problem, space, fixed.dofs, dofs, self.num_dofs)
        # Springs depend on the displacement too, but their tangent is symmetric.
        self.has_followers = bool(followers)
        self._followers = [*followers, *spring_forces(self, problem.springs)]
        trial = ufl.TrialFunction(self._unknown.function_space)
        self._tangent = fenicsx.form(self.work_change(trial))
        groups = [group for contact in self.contacts for group in contact.reached]
        # Axes of nodes are turned, and pressures solved, by entries.
        is_blocked = space.degree > 1 and self.frames is None and dofs is None
        self._matrix = fenicsx.create_matrix(self._tangent, groups, is_blocked=is_blocked)
        self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)

    def carried(self, other: DiscreteProblem, values: Floats, cells: Indices) -> Floats:
        """Interpolate a flat vector of a problem on another mesh of the same body to this one.

        `cells`: for each cell of this TetMesh the cell of the other that it lies in.
        """
        other.set_displacement(values)
        return self.to_local(carry_field(other.space, other.u, self.space, cells))

    def destroy(self) -> None:
        """Free the matrix at once: Python's garbage collector sees only a small object."""
        self._matrix.destroy()

    def external_force(self, displacement: Floats) -> Floats:
        """Nodal forces of the full load at a displacement [N], flat, shape (num_dofs,)."""
        force: Floats = self.dead_force.copy()
        if self._followers:
            self.set_displacement(displacement)
            for follower in self._followers:
                force += self.to_local(follower.force())
        return force

    @property
    def has_follower_forces(self) -> bool:
        """Whether a force depends on the displacement: a follower pressure or a spring."""
        return bool(self._followers)

    def contact_force(self, displacement: Floats) -> Floats:
        """Nodal forces of the tools at their present pose at a displacement [N], flat."""
        force = np.zeros(self.num_dofs)
        for contact in self.contacts:
            force += contact.force(displacement)
        return force

    def tangent(self, displacement: Floats, load_factor: float) -> Any:
        """dR/du as a PETSc matrix without supports; may be the same object each time."""
        matrix = self._along_axes(displacement, load_factor)
        return matrix if self.frames is None else self.frames.turned(matrix)

    def _along_axes(self, displacement: Floats, load_factor: float) -> Any:
        self.set_displacement(displacement)
        self._matrix.zeroEntries()
        fenicsx.assemble_into_matrix(self._matrix, self._tangent)
        for follower in self._followers:
            follower.add_tangent(self._matrix, load_factor)
        for contact in self.contacts:
            contact.add_tangent(self._matrix, displacement)
        return self.with_smoothing(self._matrix)


def internal_force(
    mesh: TetMesh,
    displacement: Points,
    *,
    material: Material,
    strain: Strain = Strain.GREEN,
    degree: int = 1,
    inclusions: Sequence[Inclusion] = (),
    element: Element = Element.LINEAR,
) -> Points:
    """Nodal internal forces, f_a = integral of P grad N_a over the rest volume (eq. 1) [N].

    Of a displacement at the mesh's points [m], linear in between, with test functions N of a
    degree; at the points, shape (num_points, 3). For degree 1 it sums to zero over the body; for
    higher degrees only together with the other nodes. Smoothed tetrahedra are of degree 1.

    Raises:
        InputError: Wrong shape, a value that is not finite, or smoothed tetrahedra of another
            degree than 1 or on several ranks.
    """
    space = create_space(transfer(mesh), degree)
    body = ElasticBody(space, material, Strain(strain), inclusions, element=Element(element))
    return body.space.at_points(body.internal_force(body.space.from_points(displacement)))
