"""Nearly incompressible bodies: displacement and pressure as separate unknowns.

The stiff part of Saint-Venant-Kirchhoff's stress, lmbda tr(E) I, becomes an unknown of its own, one
degree lower than the displacement (C. Taylor, P. Hood 1973: P2-P1). The functional

    Pi(u, p) = integral of mu E : E + p tr(E) - p^2 / (2 lmbda)  -  work of the loads,

is stationary in both, so that S = p I + 2 mu E, and for every q of the pressure space
integral of (tr(E) - p / lmbda) q = 0: p = lmbda tr(E) in the weak sense. The displacement need not
make tr(E) small in every cell, which is the cause of locking. As lmbda grows, this material
approaches tr(E) = 0, which is det F = 1 only for small strains.
F. Brezzi, M. Fortin, Mixed and Hybrid Finite Element Methods, 1991, chapter VI.

The other laws have W = lmbda/2 g(J)^2 plus a part without lmbda, with g = J - 1 or ln J: that part
replaces mu E : E, and g replaces tr(E), so that they approach J = 1. The corotational law, with
g = tr U - 3, approaches tr U = 3.

Where materials meet the strain across their wall is that of the one and of the other: the pressure
jumps. Materials are given colours, no two alike where they share a node, and

    p = p_0 + sum over the colours c > 0 of chi_c q_c,

chi_c = 1 in the cells of a colour and 0 elsewhere. q_c is free at the nodes at which its cells meet
those of a lesser colour, and 0 at all others, so that p has a value on each side of a wall and is
continuous within a material. Every node has as many free values as colours.

The unknown of the solver is p h / mu [m], with h a typical cell size, so that the rows of pressure
are forces like those of displacement, and one tolerance applies to both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import fenicsx
from palpate.reference.discrete_problem import DiscreteProblem, LawForms
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.laws import lame_parameters
from palpate.reference.mesh_transfer import carry_field, map_points, transfer
from palpate.reference.result import Formulation

# Of the integrals of a node's shape function over its cells, by size; below it is rounding.
_LEAST_SHARE = 1e-12


def colours_of(problem: Problem) -> Indices:
    """A number for each cell of the mesh: 0, 1, ..., the same in a material (`Material`).

    Materials that share a point have different ones; those are few, however many materials there
    are.
    """
    materials = list(dict.fromkeys((problem.material, *(i.material for i in problem.inclusions))))
    material_of_cell = np.zeros(problem.mesh.num_cells, dtype=np.int32)
    for inclusion in problem.inclusions:
        material_of_cell[np.asarray(inclusion.cells)] = materials.index(inclusion.material)
    cells = problem.mesh.cells
    pairs = np.unique(np.column_stack([cells.ravel(), np.repeat(material_of_cell, 4)]), axis=0)
    points_of = [set(pairs[pairs[:, 1] == k, 0].tolist()) for k in range(len(materials))]
    colours: list[int] = []
    for k, points in enumerate(points_of):
        taken = {colours[j] for j in range(k) if not points.isdisjoint(points_of[j])}
        colours.append(next(c for c in range(k + 1) if c not in taken))
    found: Indices = np.array(colours, dtype=np.int32)[material_of_cell]
    return found


class MixedProblem(DiscreteProblem):
    """A discrete problem with pressure, of one degree less, among its unknowns.

    Flat vectors hold displacements and pressures, in the order of the mixed space.

    Raises:
        InputError: Degree 1, smoothed tetrahedra, or a Poisson's ratio that is not above 0.
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
        colours = colours_of(problem)[transferred.cell_of_cell]
        count = 1 + fenicsx.largest(float(colours.max(initial=0)))
        self._mixed = fenicsx.taylor_hood_space(mesh, degree, int(count))
        displacements, self._dofs = fenicsx.part_of_space(self._mixed)
        self.space = map_points(transferred, degree, displacements)
        self.num_dofs = int(self._mixed.dofmap.index_map.size_local)
        parts = [fenicsx.part_of_space(self._mixed, k + 1) for k in range(int(count))]
        self._pressure_dofs = [dofs for _, dofs in parts]
        self._pressures = map_points(transferred, degree - 1, parts[0][0])
        # A node is owned by the same rank in each of the spaces.
        self._own_dofs = self._dofs[: 3 * self.space.num_blocks]
        of_colour = [fenicsx.cell_function(mesh, 1.0 * (colours == c)) for c in range(int(count))]
        idle = self._idle_pressures(of_colour)
        of_pressures = self.num_dofs - len(self._own_dofs) - len(idle)
        self.num_pressures = fenicsx.total(of_pressures)

        lmbda, mu, c01 = self._read_moduli(problem.material, problem.inclusions)
        self._unknown = fem.Function(self._mixed)
        self.u, *scaled = ufl.split(self._unknown)
        self.v, *scaled_test = ufl.TestFunctions(self._mixed)
        source = problem.mesh
        cell_size = (source.volume / source.num_cells) ** (1.0 / 3.0)
        self.pressure_unit = lame_parameters(problem.material)[1] / cell_size
        scale = fem.Constant(transferred.mesh, PETSc.ScalarType(self.pressure_unit))
        p, q = (
            scale
            * (of[0] + sum(chi * part for chi, part in zip(of_colour[1:], of[1:], strict=True)))
            for of in (scaled, scaled_test)
        )
        forms = LawForms(self.space, self.u, problem.material, strain, (None, mu, c01))
        volume, by_gradient, by_strain = forms.volume()
        self._coefficients, self.stress_degree = forms.coefficients, forms.stress_degree
        self.stress, self.piola = forms.stress + p * by_strain, forms.piola + p * by_gradient
        self.energy = (forms.energy + p**2 / (2 * lmbda)) * forms.dx
        balance = ufl.inner(self.piola, ufl.grad(self.v))
        self.virtual_work = (balance + (volume - p / lmbda) * q) * forms.dx
        self._force = fenicsx.form(self.virtual_work)
        self._attach(problem, self._dofs, idle)

    def _idle_pressures(self, of_colour: Sequence[Any]) -> Indices:
        """The pressures that are 0: see above; indices of this rank's unknowns."""
        if len(of_colour) == 1:
            return np.zeros(0, dtype=np.int32)
        space = self._pressures.space
        test, dx = ufl.TestFunction(space), ufl.dx(metadata={"quadrature_degree": 2})
        # No shape function integrates to 0 over a cell that has its node.
        touched = np.array(
            [np.abs(fenicsx.assemble_vector(fenicsx.form(chi * test * dx))) for chi in of_colour]
        )
        is_touched = touched > _LEAST_SHARE * touched.sum(axis=0)
        first, own = is_touched.argmax(axis=0), self._pressures.num_blocks
        idle = [
            dofs[:own][~is_touched[c] | (first == c)]
            for c, dofs in enumerate(self._pressure_dofs)
            if c > 0
        ]
        found: Indices = np.concatenate(idle).astype(np.int32)
        return found

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
        own_pressures = [dofs[: self._pressures.num_blocks] for dofs in self._pressure_dofs]
        own = (self._own_dofs, *own_pressures)
        spaces = (
            (other.space, self.space),
            *((other._pressures, self._pressures) for _ in own_pressures),
        )
        given = (other._dofs, *other._pressure_dofs)
        for taken, dofs, (source, target) in zip(given, own, spaces, strict=True):
            part = fenicsx.part_of(other._unknown, source.space, taken)
            both[dofs] = carry_field(source, part, target, cells)
        # The unknown is p h / mu.
        both[np.concatenate(own_pressures)] *= other.pressure_unit / self.pressure_unit
        # A part that is 0 there belongs to walls of the coarser mesh.
        idle = np.isin(self.fixed.dofs, self._own_dofs, invert=True)
        both[self.fixed.dofs[idle]] = 0.0
        return self.to_local(both)
