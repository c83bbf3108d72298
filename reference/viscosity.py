"""Stiffness damping: the forces of a viscous stress on the rate of strain, in UFL.

    S_v = beta C : dE/dt,   R_v(u; v) = integral of F S_v : grad v,

C Hooke's at rest whatever the body's law, E its strain measure with dE/dt = sym(F^T grad u'), and
F = I under linear strain: Kelvin and Voigt's solid, as on E by J. C. Simo, T. J. R. Hughes,
Computational Inelasticity, 1998, section 10.1. About rest it is Rayleigh's beta K u'. The power
that it takes, the integral of dE/dt : beta C : dE/dt, is never below 0, and no turn is resisted:
a tangent stiffness in the place of C would do neither in a stressed body, nor K of the rest state
in one that has turned.

Smoothed tetrahedra average dE/dt as they do E, and their stress as Hooke's.
"""

from __future__ import annotations

from typing import Any

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Element, Strain
from palpate.reference import fenicsx
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import second_piola_kirchhoff_stress, strain_tensor
from palpate.reference.smoothed import Smoothing, smoothing_of


class Viscosity:
    """Viscous forces of a body, by rates or by finite changes of its strain.

    Args:
        body: Whose displacement, moduli at rest, strain measure and element these are.
        factor: beta [s]; by changes beta over the time step [-].
        is_by_change: Take E(u) - E(w) for an earlier displacement w in the place of the rate of E
            along a velocity w.
    """

    def __init__(self, body: ElasticBody, factor: float, *, is_by_change: bool = False) -> None:
        self._body, self._factor, space = body, factor, body.space
        self._mesh = space.transferred.mesh
        is_green = body.strain is Strain.GREEN
        self._w = w = fem.Function(space.space)
        # A factor, so that the tangent of smoothed cells has a form also where F is I.
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
            self._smoothing = smoothing_of(space, body.lame)
            self._tensors = fenicsx.cell_tensor_space(self._mesh)
            self._stress = stress = fem.Function(self._tensors)
            self._integrals = ufl.inner(strains, ufl.TestFunction(self._tensors)) * dx
            self._strains = fenicsx.form(self._integrals)
        else:
            stress = factor * second_piola_kirchhoff_stress(strains, *body.lame)
        self._work = ufl.inner(F * stress, ufl.grad(body.v)) * dx
        self._force = fenicsx.form(self._work)
        self._weights = [self._constant(0.0) for _ in range(2)]
        self._tangents: list[tuple[Any, Any]] = []

    def _constant(self, value: float) -> Any:
        return fem.Constant(self._mesh, PETSc.ScalarType(value))

    def force(self, displacement: Floats, other: Floats) -> Floats:
        """Nodal forces, a part of the internal ones [N], flat.

        Args:
            displacement: Flat [m].
            other: The velocity [m/s], or the earlier displacement.
        """
        body = self._body
        body.set_displacement(displacement)
        self._w.x.array[: len(other)] = body.to_global(other)
        self._w.x.scatter_forward()
        if self._smoothing is not None:
            found = self._smoothing.stress(fenicsx.assemble_vector(self._strains))
            self._stress.x.array[:] = self._factor * found
        return body.to_local(fenicsx.assemble_vector(self._force))

    def add_tangent(self, matrix: Any, by_place: float, by_rate: float) -> None:
        """Add the derivative of the last force, along x, y, z; under Green strain not symmetric.

        Args:
            matrix: The body's tangent, a PETSc matrix.
            by_place: Weight of the derivative by the displacement.
            by_rate: Of that by the velocity.
        """
        if not self._tangents:
            self._compile()
        for constant, weight in zip(self._weights, (by_place, by_rate), strict=True):
            constant.value = weight
        for form, of in self._tangents:
            of.zeroEntries()
            fenicsx.assemble_into_matrix(of, form)
        same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        part = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(1.0, self._tangents[0][1], structure=part if self._smoothing else same)
        if self._smoothing is not None:
            averaged = self._smoothing.stiffness(*(of for _, of in self._tangents[1:]))
            matrix.axpy(self._factor, averaged, structure=part)
            averaged.destroy()

    def _compile(self) -> None:
        body = self._body
        du = ufl.TrialFunction(body.space.space)
        forms = [self._along(self._work, du)]
        if self._smoothing is not None:
            own = strain_tensor(body.u, body.strain)
            integrals = ufl.inner(own, ufl.TestFunction(self._tensors)) * self._dx
            forms += [ufl.derivative(integrals, body.u, du), self._along(self._integrals, du)]
        compiled = [fenicsx.form(form) for form in forms]
        self._tangents = [(form, fenicsx.create_matrix(form)) for form in compiled]

    def _along(self, of: Any, du: Any) -> Any:
        by_place, by_rate = self._weights
        along_u, along_w = (ufl.derivative(of, x, du) for x in (self._body.u, self._w))
        return by_place * along_u + by_rate * along_w
