"""Strains averaged over edges and nodes: the law of the smoothed tetrahedra, as sparse matrices.

Cell c has the volume V_c and the strain E_c (Green's, or the linear one). An edge e has the volume
V_e = sum of V_c / 6 over its cells, a node n has V_n = sum of V_c / 4:

    E_e     = 1 / V_e  sum of (V_c / 6) E_c                     strain of an edge
    theta_n = 1 / V_n  sum of (V_c / 4) tr E_c                  volume strain of a node
    W       = sum of V_e mu E_e : E_e  +  sum of V_n lmbda / 2 theta_n^2
    S_c     = 1 / V_c dW / dE_c  =  1/6 sum of 2 mu E_e  +  1/4 sum of lmbda theta_n I

The shear part goes over edges, which do not lock in bending; the volumetric part over nodes, of
which there are too few to lock it. An edge or node where several materials meet has a patch of
cells for each. With s the integrals V_c E_c, which is what UFL assembles, all of it is one matrix
A of averages and one diagonal D of moduli:

    W = (A s) . D (A s) / 2,   S = A^T D (A s),   K = (A B)^T D (A B) + geometric part,   B = ds/du.

G. R. Liu, T. Nguyen-Thoi, Smoothed Finite Element Methods, 2010; C.-K. Lee, L. A. Mihai, J. S.
Hale, P. Kerfriden, S. P. A. Bordas, Strain smoothing for compressible and nearly-incompressible
finite elasticity, Computers and Structures 182 (2017) 540-555. They average the deformation
gradient; here it is the strain, so that a finite rotation strains no edge either.

Note:
    W is never above that of the plain tetrahedra (it is convex in E). Pressures lmbda theta_n of
    neighbouring nodes may alternate; averages over a cell do not.

Linear tetrahedra with strains averaged over edges and nodes, in UFL (see `smoothing`).

The stress S of a cell depends on the displacement of its neighbours too, so UFL is given it as a
function that is constant in each cell:

    R(u; v) = integral of F(u) S : grad v,    dR = integral of grad du S : grad v  +  B^T (dS/dE) B.

Smoothed tetrahedra of laws other than Saint-Venant-Kirchhoff's, by their energy in UFL.

Every law is W = W_0 + lmbda/2 g^2, with W_0 what is left where lmbda = 0 and g a function of a
measure m of a cell's volume (J - 1). W_0 goes over edges with all that it has of C = I + 2 E and of
J, there the root of det C; g goes over nodes:

    E_e = 1 / V_e  sum of (V_c / 6) E_c,    m_n = 1 / V_n  sum of (V_c / 4) m_c
    W   = sum of V_e W_0(E_e)  +  sum of V_n lmbda/2 g(m_n)^2
    S_c = 1/6 sum of dW_0/dE (E_e),   p_c = 1/4 sum of lmbda g dg/dm (m_n)
    R(u; v) = integral of S : dE(v) + p dm(v)

so that for small strains all laws have the smoothed element of Hooke's (`smoothing`), no stress at
rest, and a constant F is reproduced. dW_0/dE and its derivative are UFL's: the edges' strains are
given to it as a function on a mesh of as many cells that have nothing to do with each other. Laws
that are written in stretches have theirs from `principal_laws`; of the corotational one m is
tr U - 3, whose derivatives are coefficients of the forms (`strain_coefficients`).

Note:
    C of an edge is definite whatever its cells do: a cell turned inside out is felt by the m_n of
    its nodes alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference import fenicsx, laws
from palpate.reference.fenicsx import COMM, PETSc, fem, ufl
from palpate.reference.laws import deformation_gradient, strain_tensor
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.principal_laws import (
    COLUMNS,
    ROWS,
    WEIGHTS,
    StrainCoefficients,
    energy_of_stretches,
    of_tensors,
    stretch_sum,
)

# A 3 x 3 tensor, row by row.
_SIZE = 9
_DIAGONAL = np.array([0, 4, 8])


@dataclass(frozen=True, eq=False)
class Patches:
    """Cells of one material around each edge, or around each node.

    Attributes:
        of_cell: Patches of each cell, shape (num_cells, 6) for edges, (num_cells, 4) for nodes.
        volumes: An equal share of each cell's volume for each of its patches [m3], (num_patches,).
    """

    of_cell: Indices
    volumes: Floats


def find_patches(mesh: Any, dimension: int, constants: Floats, volumes: Floats) -> Patches:
    """Gather the cells around the edges (dimension 1) or nodes (0) of a dolfinx mesh.

    Args:
        mesh: On one rank: another one's cells at an edge would be missing.
        dimension: 1 or 0.
        constants: Of each cell's material, shape (num_cells, n); equal rows share patches.
        volumes: Of the cells [m3], shape (num_cells,).
    """
    topology = mesh.topology
    topology.create_entities(dimension)
    topology.create_connectivity(3, dimension)
    entities = topology.connectivity(3, dimension).array.reshape(len(volumes), -1)
    kinds, kind = np.unique(constants, axis=0, return_inverse=True)
    pairs = entities.astype(np.int64) * len(kinds) + kind.reshape(-1, 1)
    _, of_cell = np.unique(pairs, return_inverse=True)
    of_cell = of_cell.reshape(pairs.shape)
    shares = np.broadcast_to(volumes[:, None] / pairs.shape[1], pairs.shape)
    summed = np.bincount(of_cell.ravel(), shares.ravel())
    return Patches(of_cell, np.asarray(summed, dtype=np.float64))


class Smoothing:
    """Averages A and moduli D of a mesh (see the module).

    Flat strains and stresses are those of a function that is constant in each cell, of shape 3 x 3:
    full tensors, so that the double contraction is the scalar product.

    Args:
        mesh: dolfinx mesh on one rank.
        dofs: Blocked degree of freedom of each cell in the space of those functions, (num_cells,).
        lmbda: First Lamé parameter of each cell [Pa], (num_cells,).
        mu: Shear modulus of each cell [Pa], (num_cells,).
        volumes: Of the cells [m3], (num_cells,).
    """

    def __init__(
        self, mesh: Any, dofs: Indices, lmbda: Floats, mu: Floats, volumes: Floats
    ) -> None:
        constants = np.column_stack([lmbda, mu])
        edges, nodes = (find_patches(mesh, k, constants, volumes) for k in (1, 0))
        num_edges, num_nodes = len(edges.volumes), len(nodes.volumes)

        cell = np.repeat(dofs, 6)
        component = np.arange(_SIZE)
        edge = edges.of_cell.ravel()
        of_edges = (
            (_SIZE * edge[:, None] + component).ravel(),
            (_SIZE * cell[:, None] + component).ravel(),
            np.repeat(1.0 / (6.0 * edges.volumes[edge]), _SIZE),
        )
        cell = np.repeat(dofs, 4)
        node = nodes.of_cell.ravel()
        of_nodes = (
            np.repeat(_SIZE * num_edges + node, 3),
            (_SIZE * cell[:, None] + _DIAGONAL).ravel(),
            np.repeat(1.0 / (4.0 * nodes.volumes[node]), 3),
        )
        rows, columns, values = (np.concatenate(x) for x in zip(of_edges, of_nodes, strict=True))
        shape = (_SIZE * num_edges + num_nodes, _SIZE * len(volumes))
        self._averages = sparse_matrix(rows, columns, values, shape)

        shear, bulk = np.empty(num_edges), np.empty(num_nodes)
        shear[edges.of_cell] = 2.0 * mu[:, None]
        bulk[nodes.of_cell] = lmbda[:, None]
        self._moduli = np.concatenate(
            [np.repeat(shear * edges.volumes, _SIZE), bulk * nodes.volumes]
        )

    def energy(self, strains: Floats) -> float:
        """W of the cells' integrals of strain [m3], flat [J]."""
        means = times(self._averages, strains)
        return 0.5 * float(means @ (self._moduli * means))

    def stress(self, strains: Floats) -> Floats:
        """Second Piola-Kirchhoff stress S of each cell [Pa], flat, of the integrals of strain."""
        forces = self._moduli * times(self._averages, strains)
        x, y = self._averages.createVecs()
        y.array[:] = forces
        self._averages.multTranspose(y, x)
        return np.array(x.array)

    def stiffness(self, strain_rates: Any, changes: Any = None) -> Any:
        """(A B)^T D (A B') of PETSc matrices: B, the derivative of the integrals of strain, and B'.

        Args:
            strain_rates: B.
            changes: B', of the integrals that the stress is of; None is B.
        """
        means = self._averages.matMult(strain_rates)
        forces = means.copy() if changes is None else self._averages.matMult(changes)
        moduli = forces.createVecLeft()
        moduli.array[:] = self._moduli
        forces.diagonalScale(L=moduli)
        return means.transposeMatMult(forces)


def times(matrix: Any, values: Floats) -> Floats:
    """A PETSc matrix times a flat vector."""
    x, y = matrix.createVecs()
    x.array[:] = values
    matrix.mult(x, y)
    return np.array(y.array)


def sparse_matrix(rows: Indices, columns: Indices, values: Floats, shape: tuple[int, int]) -> Any:
    """The PETSc matrix of these entries, each named once."""
    order = np.lexsort((columns, rows))
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))])
    csr = (starts.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order])
    return PETSc.Mat().createAIJ(shape, csr=csr, comm=COMM)


class SmoothedStress:
    """The stress of a displacement by averaged strains.

    Args:
        space: Displacement space of degree 1, on one rank.
        u: Displacement; its values may change.
        strain: Strain measure.
        lame: First Lamé parameter and shear modulus [Pa], functions that are constant in each cell.

    Attributes:
        stress: Second Piola-Kirchhoff stress [Pa], a function that is constant in each cell.

    Raises:
        InputError: Another degree, or more than one rank.
    """

    def __init__(
        self, space: TransferredSpace, u: Any, strain: Strain, lame: tuple[Any, Any]
    ) -> None:
        if space.degree != 1:
            raise InputError(f"degree = {space.degree}: smoothed tetrahedra are of degree 1")
        if fenicsx.COMM.size > 1:
            raise InputError("smoothed tetrahedra run on one rank; leave mpirun out")
        self._u, self._strain = u, strain
        transferred = space.transferred
        self._dx = ufl.dx(domain=transferred.mesh, metadata={"quadrature_degree": 0})
        tensors = fenicsx.cell_tensor_space(transferred.mesh)
        T, du = ufl.TestFunction(tensors), ufl.TrialFunction(space.space)
        # Each T is 1 in one component in one cell: these are the integrals V_c E_c.
        strains = ufl.inner(strain_tensor(u, strain), T) * self._dx
        self._strains = fenicsx.form(strains)
        self._strain_rates = fenicsx.form(ufl.derivative(strains, u, du))
        self._rates = fenicsx.create_matrix(self._strain_rates)
        self.stress = fem.Function(tensors)
        self._smoothing = smoothing_of(space, lame)

    def virtual_work(self, v: Any) -> Any:
        """Integral of F S : grad v, with F = I under linear strain."""
        # A factor, so that the geometric part of the tangent has a form also where it is zero.
        turns = fem.Constant(self._dx.ufl_domain(), PETSc.ScalarType(self._strain is Strain.GREEN))
        F = ufl.Identity(3) + turns * ufl.grad(self._u)
        return ufl.inner(F * self.stress, ufl.grad(v)) * self._dx

    def update(self) -> None:
        """Make the stress that of u."""
        self.stress.x.array[:] = self._smoothing.stress(fenicsx.assemble_vector(self._strains))

    def energy(self) -> float:
        """Stored energy of u [J]."""
        return self._smoothing.energy(fenicsx.assemble_vector(self._strains))

    def stiffness(self) -> Any:
        """B^T (dS/dE) B at u, a new PETSc matrix: the tangent but for its geometric part."""
        self._rates.zeroEntries()
        fenicsx.assemble_into_matrix(self._rates, self._strain_rates)
        return self._smoothing.stiffness(self._rates)


def smoothing_of(space: TransferredSpace, lame: tuple[Any, Any]) -> Smoothing:
    """The averages of a body, of strains and stresses as functions constant in each cell.

    Args:
        space: Displacement space on one rank.
        lame: First Lamé parameter and shear modulus [Pa], functions that are constant in each cell.
    """
    transferred, (lmbda, mu) = space.transferred, lame
    source, tensors = transferred.source, fenicsx.cell_tensor_space(transferred.mesh)
    return Smoothing(
        transferred.mesh,
        fenicsx.cell_dofs(tensors)[:, 0],
        fenicsx.cell_values(lmbda),
        fenicsx.cell_values(mu),
        signed_volumes(source.points, source.cells)[transferred.cell_of_cell],
    )


_CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
_VOLUME = 1.0 / 6.0


class SmoothedLaw:
    """The stress of a displacement by averaged strains and volumes.

    Args:
        space: Displacement space of degree 1, on one rank.
        u: Displacement; its values may change.
        material: Of which the law is read, not Saint-Venant-Kirchhoff's.
        moduli: Lamé's parameters and c01 [Pa], functions that are constant in each cell.

    Attributes:
        stress: Second Piola-Kirchhoff stress of `u` in UFL [Pa].
        coefficients: What has to be brought to u before `update`.

    Raises:
        InputError: Another degree, or more than one rank.
    """

    def __init__(
        self,
        space: TransferredSpace,
        u: Any,
        material: Material,
        moduli: tuple[Any, Any, Any],
    ) -> None:
        law = material.law
        if space.degree != 1:
            raise InputError(f"degree = {space.degree}: smoothed tetrahedra are of degree 1")
        if fenicsx.COMM.size > 1:
            raise InputError("smoothed tetrahedra run on one rank; leave mpirun out")
        self._u, self._law = u, law
        transferred = space.transferred
        mesh, source = transferred.mesh, transferred.source
        self._dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 0})
        tensors, scalars = fenicsx.cell_tensor_space(mesh), fenicsx.cell_space(mesh)
        F = ufl.variable(deformation_gradient(u))
        T, q, du = *map(ufl.TestFunction, (tensors, scalars)), ufl.TrialFunction(space.space)
        # Each test function is 1 in one component in one cell: the integrals V_c E_c and V_c m_c.
        strains = ufl.inner(strain_tensor(u, Strain.GREEN), T) * self._dx
        self.coefficients: tuple[StrainCoefficients, ...] = ()
        if law is Law.COROTATIONAL:
            total = StrainCoefficients(mesh, u, lambda _: stretch_sum, 0)
            self.coefficients = (total,)
            measures, slope = total.value * q * self._dx, F * total.slope
            rates = sum(total.changes(measures, du))
        else:
            measures = (ufl.det(deformation_gradient(u)) - 1) * q * self._dx
            slope, rates = ufl.diff(ufl.det(F) - 1, F), ufl.derivative(measures, u, du)
        self._integrals = [fenicsx.form(of) for of in (strains, measures)]
        self._rates = [fenicsx.form(of) for of in (ufl.derivative(strains, u, du), rates)]
        self._matrices = [fenicsx.create_matrix(of) for of in self._rates]
        self._shape_stress, self._pressure = fem.Function(tensors), fem.Function(scalars)
        P = F * self._shape_stress + self._pressure * slope
        self._piola, self.stress = P, ufl.inv(F) * P

        constants = np.column_stack([fenicsx.cell_values(of) for of in moduli])
        volumes = signed_volumes(source.points, source.cells)[transferred.cell_of_cell]
        edges, nodes = (find_patches(mesh, k, constants, volumes) for k in (1, 0))
        self._edge_volumes, self._node_volumes = edges.volumes, nodes.volumes
        self._of_edges = _averages(edges, fenicsx.cell_dofs(tensors)[:, 0], 9)
        self._of_nodes = _averages(nodes, fenicsx.cell_dofs(scalars)[:, 0], 1)
        of_edge = np.empty((len(edges.volumes), 3))
        of_edge[edges.of_cell] = constants[:, None]
        edge_law = _EdgeLawOfStretches if law.is_of_stretches else _EdgeLaw
        self._edge_law = edge_law(material, *of_edge[:, 1:].T)
        self._lmbda = np.empty(len(nodes.volumes))
        self._lmbda[nodes.of_cell] = constants[:, :1]

    def virtual_work(self, v: Any) -> Any:
        """Integral of S : dE(v) + p dm(v)."""
        return ufl.inner(self._piola, ufl.grad(v)) * self._dx

    def update(self) -> None:
        """Make the stress that of u."""
        strains, measures = self._averaged()
        forces = np.repeat(self._edge_volumes, 9) * self._edge_law.stress(strains)
        self._shape_stress.x.array[:] = _transposed_times(self._of_edges, forces)
        pressures = self._node_volumes * self._lmbda * _slope(self._law, measures)
        self._pressure.x.array[:] = _transposed_times(self._of_nodes, pressures)

    def energy(self) -> float:
        """Stored energy of u [J]."""
        strains, measures = self._averaged()
        of_edges = self._edge_volumes @ self._edge_law.energies(strains)
        g = np.log1p(measures) if self._law.is_by_log_of_volume else measures
        return float(of_edges + self._node_volumes @ (0.5 * self._lmbda * g**2))

    def stiffness(self) -> Any:
        """All of the tangent at u but its geometric part, a new PETSc matrix."""
        strains, measures = self._averaged()
        for matrix, form in zip(self._matrices, self._rates, strict=True):
            matrix.zeroEntries()
            fenicsx.assemble_into_matrix(matrix, form)
        moduli = self._edge_law.moduli(strains)
        moduli.diagonalScale(L=_vector(moduli, np.repeat(self._edge_volumes, 9)))
        means = self._of_edges.matMult(self._matrices[0])
        stiffness = means.transposeMatMult(moduli.matMult(means))
        bends = self._node_volumes * self._lmbda * _bend(self._law, measures)
        means = self._of_nodes.matMult(self._matrices[1])
        forces = means.copy()
        forces.diagonalScale(L=_vector(forces, bends))
        stiffness.axpy(1.0, means.transposeMatMult(forces))
        return stiffness

    def _averaged(self) -> tuple[Floats, Floats]:
        """E of the edges, flat, and m of the nodes."""
        strains, measures = (fenicsx.assemble_vector(of) for of in self._integrals)
        return times(self._of_edges, strains), times(self._of_nodes, measures)


class _EdgeLaw:
    """W_0 and its derivatives by UFL, of many strains at once: one to a cell of its own."""

    def __init__(self, material: Material, mu: Floats, c01: Floats) -> None:
        self._count = count = len(mu)
        mesh = fenicsx.create_mesh(
            np.tile(_CORNERS, (count, 1)), np.arange(4 * count).reshape(count, 4)
        )
        # Which cell a patch has does not matter: that of its number in dolfinx.
        tensors, scalars = fenicsx.cell_tensor_space(mesh), fenicsx.cell_space(mesh)
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

    def moduli(self, strains: Floats) -> Any:
        """The derivative of the flat stress by the flat strains, a PETSc matrix."""
        self._set(strains)
        matrix = fenicsx.create_matrix(self._tangent)
        fenicsx.assemble_into_matrix(matrix, self._tangent)
        starts, _, values = matrix.getValuesCSR()
        if not (np.diff(starts) == 9).all():
            raise ArithmeticError("a cell of the edges' mesh has a neighbour")
        return _block_diagonal(values.reshape(-1, 9, 9)[self._rows] / _VOLUME)


class _EdgeLawOfStretches:
    """The same by principal values."""

    def __init__(self, material: Material, mu: Floats, c01: Floats) -> None:
        del c01
        self._function = energy_of_stretches(material.law, 0.0 * mu, mu, material.ogden_terms)
        # Mandel's six components of nine, and back.
        self._nine = np.zeros((9, 6))
        for k, (i, j, weight) in enumerate(zip(ROWS, COLUMNS, WEIGHTS, strict=True)):
            self._nine[[3 * i + j, 3 * j + i], k] = 1.0 / weight

    def energies(self, strains: Floats) -> Floats:
        """See `_EdgeLaw`."""
        return of_tensors(strains.reshape(-1, 3, 3), self._function)[0]

    def stress(self, strains: Floats) -> Floats:
        """See `_EdgeLaw`."""
        _, slope, _ = of_tensors(strains.reshape(-1, 3, 3), self._function)
        found: Floats = (slope @ self._nine.T).ravel()
        return found

    def moduli(self, strains: Floats) -> Any:
        """See `_EdgeLaw`."""
        _, _, bend = of_tensors(strains.reshape(-1, 3, 3), self._function)
        return _block_diagonal(self._nine @ bend @ self._nine.T)


def _block_diagonal(blocks: Floats) -> Any:
    """The PETSc matrix of blocks (n, 9, 9)."""
    size = 9 * len(blocks)
    rows = np.arange(size)
    columns = 9 * (rows[:, None] // 9) + np.arange(9)
    return sparse_matrix(np.repeat(rows, 9), columns.ravel(), blocks.ravel(), (size, size))


def _averages(patches: Patches, dofs: Indices, size: int) -> Any:
    """Means over patches of the cells' integrals of so many components."""
    of_cell, volumes = patches.of_cell, patches.volumes
    width, component = of_cell.shape[1], np.arange(size)
    patch, cell = of_cell.ravel(), np.repeat(dofs, width)
    return sparse_matrix(
        (size * patch[:, None] + component).ravel(),
        (size * cell[:, None] + component).ravel(),
        np.repeat(1.0 / (width * volumes[patch]), size),
        (size * len(volumes), size * len(of_cell)),
    )


def _slope(law: Law, m: Floats) -> Floats:
    """Of g^2 / 2 by m."""
    return np.log1p(m) / (1.0 + m) if law.is_by_log_of_volume else m


def _bend(law: Law, m: Floats) -> Floats:
    """Its derivative."""
    if law.is_by_log_of_volume:
        return np.asarray((1.0 - np.log1p(m)) / (1.0 + m) ** 2)
    return np.ones_like(m)


def _vector(matrix: Any, values: Floats) -> Any:
    vector = matrix.createVecLeft()
    vector.array[:] = values
    return vector


def _transposed_times(matrix: Any, values: Floats) -> Floats:
    x, y = matrix.createVecs()
    y.array[:] = values
    matrix.multTranspose(y, x)
    return np.array(x.array)
