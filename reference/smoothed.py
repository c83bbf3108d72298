"""Linear tetrahedra with strains averaged over edges and nodes, in UFL and sparse matrices.

Every law is W = W_0 + lmbda/2 g^2, with W_0 what is left where lmbda = 0 and g a function of a
measure m of a cell's volume: tr E for Saint-Venant-Kirchhoff's and Hooke's laws, tr U - 3 for the
corotational one, J - 1 for the others. Cell c has the volume V_c and the strain E_c (Green's, or
the linear one). An edge e has the volume V_e = sum of V_c / 6 over its cells, a node n has
V_n = sum of V_c / 4. W_0 is summed over edges, with J in it the root of det C, C = I + 2 E; g is
summed over nodes:

    E_e = 1 / V_e  sum of (V_c / 6) E_c,    m_n = 1 / V_n  sum of (V_c / 4) m_c
    W   = sum of V_e W_0(E_e)  +  sum of V_n lmbda/2 g(m_n)^2
    S_c = 1/6 sum of dW_0/dE (E_e),   p_c = 1/4 sum of lmbda g dg/dm (m_n)
    R(u; v) = integral of S : dE(v) + p dm(v)

The shear part is averaged over edges, which do not lock in bending; the volumetric part over nodes,
of which there are too few for volumetric locking. Saint-Venant-Kirchhoff's law under Green strain
takes back the former where cells are compressed: `compression_blend`. An edge or node where several
materials meet has a patch of cells for each. For small strains all laws have the smoothed element
of Hooke's law. The rest state is free of stress, and a constant F is reproduced. S and p of a cell
depend on the displacement of its neighbours too, so UFL gets them as functions that are constant in
each cell; with B the derivatives of the cells' integrals of E and m, A the averages and D the
moduli, the tangent is its geometric part plus (A B)^T D (A B).

G. R. Liu, T. Nguyen-Thoi, Smoothed Finite Element Methods, 2010; C.-K. Lee, L. A. Mihai, J. S.
Hale, P. Kerfriden, S. P. A. Bordas, Strain smoothing for compressible and nearly-incompressible
finite elasticity, Computers and Structures 182 (2017) 540-555. They average the deformation
gradient; here it is the strain, so that a finite rotation strains no edge either.

dW_0/dE and its derivative are computed by UFL: the edges' strains are a function on a mesh of as
many disconnected cells. Those of laws that are written in stretches come from `principal_laws`,
and those of Hooke's law are written here.

Note:
    Where W is convex in E, like Hooke's, it is never above that of the plain tetrahedra. Pressures
    of neighbouring nodes may alternate; averages over a cell do not. C of an edge is positive
    definite whatever its cells do: an inverted cell affects only the m_n of its nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference import fenicsx, laws
from palpate.reference.compression_blend import CompressionBlend
from palpate.reference.fenicsx import COMM, PETSc, fem, ufl
from palpate.reference.laws import deformation_gradient, strain_tensor
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.patch_matrices import Patches, row_vector, sparse_matrix
from palpate.reference.principal_laws import (
    COLUMNS,
    ROWS,
    WEIGHTS,
    StrainCoefficients,
    energy_of_stretches,
    of_tensors,
    stretch_sum,
)

_CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
_VOLUME = 1.0 / 6.0
# Integrals over cells of E, flat, nine per cell, and of m; or PETSc matrices of their derivatives.
Integrals: TypeAlias = tuple[Floats, Floats]
Rates: TypeAlias = tuple[Any, Any]


def find_patches(mesh: Any, dimension: int, constants: Floats, volumes: Floats) -> Patches:
    """Gather the cells around the edges (dimension 1) or nodes (0) of a dolfinx mesh on one rank.

    Cells with equal rows of constants share patches; volumes are those of the cells [m3].
    """
    topology = mesh.topology
    topology.create_entities(dimension)
    topology.create_connectivity(3, dimension)
    entities = topology.connectivity(3, dimension).array.reshape(len(volumes), -1)
    kinds, kind = np.unique(constants, axis=0, return_inverse=True)
    pairs = entities.astype(np.int64) * len(kinds) + kind.reshape(-1, 1)
    _, of_cell = np.unique(pairs, return_inverse=True)
    of_cell = of_cell.reshape(pairs.shape)
    fractions = np.broadcast_to(volumes[:, None] / pairs.shape[1], pairs.shape)
    summed = np.bincount(of_cell.ravel(), fractions.ravel())
    return Patches(of_cell, np.asarray(summed, dtype=np.float64))


class Smoothing:
    """The averages of a body and their law: stresses of cells from the integrals of E and m.

    Moduli are Lamé's parameters and c01 [Pa], functions that are constant in each cell; if
    `is_hookean`, S is linear in E whatever the law, without c01, but for what is added where cells
    are compressed, if it `blends`.

    Raises:
        InputError: The degree is not 1, or there is more than one rank.
    """

    def __init__(
        self,
        space: TransferredSpace,
        material: Material,
        moduli: Sequence[Any],
        *,
        is_hookean: bool,
        blends: bool = False,
    ) -> None:
        if space.degree != 1:
            raise InputError(f"degree = {space.degree}: smoothed tetrahedra are of degree 1")
        if COMM.size > 1:
            raise InputError("smoothed tetrahedra run on one rank; leave mpirun out")
        transferred = space.transferred
        mesh, source = transferred.mesh, transferred.source
        self._by_log = material.law.is_by_log_of_volume and not is_hookean
        read = moduli[:2] if is_hookean else moduli
        constants = np.column_stack([fenicsx.cell_values(of) for of in read])
        volumes = signed_volumes(source.points, source.cells)[transferred.cell_of_cell]
        edges, nodes = (find_patches(mesh, k, constants, volumes) for k in (1, 0))
        self._edge_volumes, self._node_volumes = edges.volumes, nodes.volumes
        self.tensors, self.scalars = (
            fenicsx.function_space(mesh, "DG", 0, (3, 3)),
            fenicsx.function_space(mesh, "DG", 0),
        )
        self._of_edges = _averages(edges, fenicsx.cell_dofs(self.tensors)[:, 0], 9)
        self._of_nodes = _averages(nodes, fenicsx.cell_dofs(self.scalars)[:, 0], 1)
        of_edge = np.empty((len(edges.volumes), constants.shape[1]))
        of_edge[edges.of_cell] = constants[:, None]
        of_law = _EdgeLawOfStretches if material.law.is_of_stretches else _EdgeLaw
        edge_law: type[_HookesEdgeLaw | _EdgeLawOfStretches | _EdgeLaw]
        edge_law = _HookesEdgeLaw if is_hookean else of_law
        self._edge_law = edge_law(material, *of_edge[:, 1:].T)
        self._blend: CompressionBlend | None = None
        if blends:
            dofs = fenicsx.cell_dofs(self.tensors)[:, 0]
            self._blend = CompressionBlend(edges, dofs, volumes, *of_edge[:, :2].T)
        self._lmbda = np.empty(len(nodes.volumes))
        self._lmbda[nodes.of_cell] = constants[:, :1]

    def stress(self, integrals: Integrals) -> Integrals:
        """S of the cells, flat, and p [Pa]."""
        strains, measures = self._averaged(integrals)
        of_edges, of_cells = self._edge_law.stress(strains), np.zeros_like(integrals[0])
        if self._blend is not None:
            added, of_cells = self._blend.stresses(integrals[0], strains)
            of_edges = of_edges + added
        forces = np.repeat(self._edge_volumes, 9) * of_edges
        slopes = np.log1p(measures) / (1.0 + measures) if self._by_log else measures
        pressures = self._node_volumes * self._lmbda * slopes
        return (
            _transposed_times(self._of_edges, forces) + of_cells,
            _transposed_times(self._of_nodes, pressures),
        )

    def energy(self, integrals: Integrals) -> float:
        """W [J]."""
        strains, measures = self._averaged(integrals)
        g = np.log1p(measures) if self._by_log else measures
        of_nodes = self._node_volumes @ (0.5 * self._lmbda * g**2)
        added = 0.0 if self._blend is None else self._blend.energy(integrals[0], strains)
        return float(self._edge_volumes @ self._edge_law.energies(strains) + of_nodes) + added

    def stiffness(self, integrals: Integrals, rates: Rates, changes: Rates | None = None) -> Any:
        """(A B)^T D (A B'), a new PETSc matrix, with D at some integrals.

        B are the derivatives of the integrals by the displacement, B' those of the integrals that
        the stress depends on; None is B.
        """
        strains, measures = self._averaged(integrals)
        changes = changes or rates
        left = self._of_edges.matMult(rates[0])
        forces = self._edge_law.moduli_times(strains, self._of_edges.matMult(changes[0]))
        forces.diagonalScale(L=row_vector(forces, np.repeat(self._edge_volumes, 9)))
        stiffness = left.transposeMatMult(forces)
        bends = np.ones_like(measures)
        if self._by_log:
            bends = (1.0 - np.log1p(measures)) / (1.0 + measures) ** 2
        left, forces = self._of_nodes.matMult(rates[1]), self._of_nodes.matMult(changes[1])
        forces.diagonalScale(L=row_vector(forces, self._node_volumes * self._lmbda * bends))
        stiffness.axpy(1.0, left.transposeMatMult(forces))
        if self._blend is not None:
            stiffness.axpy(
                1.0, self._blend.stiffness(integrals[0], strains, rates[0], self._of_edges)
            )
        return stiffness

    def _averaged(self, integrals: Integrals) -> Integrals:
        """E of the edges, flat, and m of the nodes."""
        return times(self._of_edges, integrals[0]), times(self._of_nodes, integrals[1])


class SmoothedBody:
    """The stress of a displacement, whose values may change, by averaged strains and volumes.

    `stress` and `piola` are the second and first Piola-Kirchhoff stress of `u` in UFL, Cauchy's
    under linear strain; `coefficients` of the forms are to be updated to u before `update`.

    Raises:
        InputError: The degree is not 1, or there is more than one rank.
    """

    def __init__(
        self,
        space: TransferredSpace,
        u: Any,
        material: Material,
        strain: Strain,
        moduli: tuple[Any, Any, Any],
    ) -> None:
        is_hookean = strain is Strain.LINEAR or material.law.is_linear_in_strain
        smoothing = Smoothing(
            space,
            material,
            moduli,
            is_hookean=is_hookean,
            blends=is_hookean and strain is Strain.GREEN,
        )
        self.smoothing, mesh = smoothing, space.transferred.mesh
        self._dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 0})
        T, q = ufl.TestFunction(smoothing.tensors), ufl.TestFunction(smoothing.scalars)
        S, p = fem.Function(smoothing.tensors), fem.Function(smoothing.scalars)
        self._cell_stress, du = (S, p), ufl.TrialFunction(space.space)
        F, E = ufl.variable(deformation_gradient(u)), strain_tensor(u, strain)
        # Each test function is 1 in one component in one cell: the integrals V_c E_c and V_c m_c.
        strains = ufl.inner(E, T) * self._dx
        self.coefficients: tuple[StrainCoefficients, ...] = ()
        if is_hookean:
            measures = ufl.tr(E) * q * self._dx
            rates = ufl.derivative(measures, u, du)
            # A factor of 0 or 1, so that the geometric tangent has a form also where it is zero.
            turns = fem.Constant(mesh, PETSc.ScalarType(strain is Strain.GREEN))
            self.stress = S + p * ufl.Identity(3)
            self.piola = (ufl.Identity(3) + turns * ufl.grad(u)) * self.stress
        else:
            if material.law is Law.COROTATIONAL:
                total = StrainCoefficients(mesh, u, lambda _: stretch_sum, 0)
                self.coefficients = (total,)
                measures, slope = total.value * q * self._dx, F * total.slope
                rates = sum(total.changes(measures, du))
            else:
                measures = (ufl.det(deformation_gradient(u)) - 1) * q * self._dx
                slope, rates = ufl.diff(ufl.det(F) - 1, F), ufl.derivative(measures, u, du)
            self.piola = F * S + p * slope
            self.stress = ufl.inv(F) * self.piola
        self._forms = [fenicsx.form(of) for of in (strains, measures)]
        self._rates = [fenicsx.form(of) for of in (ufl.derivative(strains, u, du), rates)]
        self._matrices = [fenicsx.create_matrix(of) for of in self._rates]

    def virtual_work(self, v: Any) -> Any:
        """Integral of S : dE(v) + p dm(v)."""
        return ufl.inner(self.piola, ufl.grad(v)) * self._dx

    def update(self) -> None:
        """Compute the stress at u."""
        found = self.smoothing.stress(self._integrals())
        for function, values in zip(self._cell_stress, found, strict=True):
            function.x.array[:] = values

    def energy(self) -> float:
        """Stored energy of u [J]."""
        return self.smoothing.energy(self._integrals())

    def stiffness(self) -> Any:
        """The tangent at u without its geometric part, a new PETSc matrix."""
        return self.smoothing.stiffness(self._integrals(), self.rates())

    def rates(self) -> Rates:
        """Derivatives of the integrals of E and m by u, always the same two PETSc matrices."""
        for matrix, form in zip(self._matrices, self._rates, strict=True):
            matrix.zeroEntries()
            fenicsx.assemble_into_matrix(matrix, form)
        return self._matrices[0], self._matrices[1]

    def _integrals(self) -> Integrals:
        strains, measures = (fenicsx.assemble_vector(of) for of in self._forms)
        return strains, measures


class _HookesEdgeLaw:
    """W_0 = mu E : E."""

    def __init__(self, material: Material, mu: Floats) -> None:
        del material
        self._moduli = np.repeat(2.0 * mu, 9)

    def energies(self, strains: Floats) -> Floats:
        """[J/m3], (num_edges,)."""
        found: Floats = 0.5 * (self._moduli * strains**2).reshape(-1, 9).sum(axis=1)
        return found

    def stress(self, strains: Floats) -> Floats:
        """[Pa], flat like the strains."""
        return self._moduli * strains

    def moduli_times(self, strains: Floats, changes: Any) -> Any:
        """Changes of the flat stress by those of the flat strains, PETSc matrices."""
        del strains
        changes.diagonalScale(L=row_vector(changes, self._moduli))
        return changes


class _EdgeLaw:
    """W_0 and its derivatives by UFL for many strains at once, each in a cell of its own."""

    def __init__(self, material: Material, mu: Floats, c01: Floats) -> None:
        self._count = count = len(mu)
        mesh = fenicsx.create_mesh(
            np.tile(_CORNERS, (count, 1)), np.arange(4 * count).reshape(count, 4)
        )
        # Any cell may represent a patch: take the one with its number in dolfinx.
        tensors, scalars = (
            fenicsx.function_space(mesh, "DG", 0, (3, 3)),
            fenicsx.function_space(mesh, "DG", 0),
        )
        self._rows = fenicsx.cell_dofs(tensors)[:, 0]
        self._strain = fem.Function(tensors)
        constants = [fenicsx.cell_function(mesh, of) for of in (mu, c01)]
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 0})
        E = ufl.variable(self._strain)
        W = laws.shape_energy_density(E, material.law, *constants)
        stress = ufl.inner(ufl.diff(W, E), ufl.TestFunction(tensors)) * dx
        self._of_scalar = fenicsx.cell_dofs(scalars)[:, 0]
        self._energies = fenicsx.form(W * ufl.TestFunction(scalars) * dx)
        self._stress = fenicsx.form(stress)
        trial = ufl.TrialFunction(tensors)
        self._tangent = fenicsx.form(ufl.derivative(stress, self._strain, trial))

    def _set(self, strains: Floats) -> None:
        self._strain.x.array.reshape(-1, 9)[self._rows] = strains.reshape(-1, 9)

    def energies(self, strains: Floats) -> Floats:
        """[J/m3], (num_edges,)."""
        self._set(strains)
        found: Floats = fenicsx.assemble_vector(self._energies)[self._of_scalar] / _VOLUME
        return found

    def stress(self, strains: Floats) -> Floats:
        """[Pa], flat like the strains."""
        self._set(strains)
        rows = fenicsx.assemble_vector(self._stress).reshape(-1, 9)[self._rows]
        found: Floats = rows.ravel() / _VOLUME
        return found

    def moduli_times(self, strains: Floats, changes: Any) -> Any:
        """Changes of the flat stress by those of the flat strains, PETSc matrices."""
        self._set(strains)
        matrix = fenicsx.create_matrix(self._tangent)
        fenicsx.assemble_into_matrix(matrix, self._tangent)
        starts, _, values = matrix.getValuesCSR()
        if not (np.diff(starts) == 9).all():
            raise ArithmeticError("a cell of the edges' mesh has a neighbour")
        return _block_diagonal(values.reshape(-1, 9, 9)[self._rows] / _VOLUME).matMult(changes)


class _EdgeLawOfStretches:
    """W_0 and its derivatives by principal strains, for laws that are written in stretches."""

    def __init__(self, material: Material, mu: Floats, c01: Floats) -> None:
        del c01
        self._function = energy_of_stretches(material.law, 0.0 * mu, mu, material.ogden_terms)
        # Conversion between Mandel's six components and the nine of a tensor.
        self._nine = np.zeros((9, 6))
        for k, (i, j, weight) in enumerate(zip(ROWS, COLUMNS, WEIGHTS, strict=True)):
            self._nine[[3 * i + j, 3 * j + i], k] = 1.0 / weight

    def energies(self, strains: Floats) -> Floats:
        """See `_EdgeLaw`."""
        return of_tensors(strains.reshape(-1, 3, 3), self._function)[0]

    def stress(self, strains: Floats) -> Floats:
        """See `_EdgeLaw`."""
        _, slope, _ = of_tensors(strains.reshape(-1, 3, 3), self._function)
        return (slope @ self._nine.T).ravel()

    def moduli_times(self, strains: Floats, changes: Any) -> Any:
        """See `_EdgeLaw`."""
        _, _, bend = of_tensors(strains.reshape(-1, 3, 3), self._function)
        return _block_diagonal(self._nine @ bend @ self._nine.T).matMult(changes)


def _block_diagonal(blocks: Floats) -> Any:
    """The PETSc matrix of blocks (n, 9, 9)."""
    size = 9 * len(blocks)
    rows = np.arange(size)
    columns = 9 * (rows[:, None] // 9) + np.arange(9)
    return sparse_matrix(np.repeat(rows, 9), columns.ravel(), blocks.ravel(), (size, size))


def _averages(patches: Patches, dofs: Indices, size: int) -> Any:
    """The matrix that averages the cells' integrals of `size` components over patches."""
    of_cell, volumes = patches.of_cell, patches.volumes
    width, component = of_cell.shape[1], np.arange(size)
    patch, cell = of_cell.ravel(), np.repeat(dofs, width)
    return sparse_matrix(
        (size * patch[:, None] + component).ravel(),
        (size * cell[:, None] + component).ravel(),
        np.repeat(1.0 / (width * volumes[patch]), size),
        (size * len(volumes), size * len(of_cell)),
    )


def times(matrix: Any, values: Floats) -> Floats:
    """A PETSc matrix times a flat vector."""
    x, y = matrix.createVecs()
    x.array[:] = values
    matrix.mult(x, y)
    return np.array(y.array)


def _transposed_times(matrix: Any, values: Floats) -> Floats:
    x, y = matrix.createVecs()
    y.array[:] = values
    matrix.multTranspose(y, x)
    return np.array(x.array)
