"""Smoothed tetrahedra: averages written again by hand, tangents, modes."""

from __future__ import annotations

import dataclasses
import itertools
from collections import defaultdict

import numpy as np
import pytest
from bank import support
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import eigsh

from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference import fenicsx
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.fenicsx import fem, ufl
    from palpate.reference.laws import strain_tensor
    from palpate.reference.motion import row_sums_of_mass

pytestmark = pytest.mark.dolfinx

SOFT, HARD = Material(3000.0, 0.3), Material(30e3, 0.45)
BOTH = pytest.mark.parametrize("strain", list(Strain))
EPS = np.finfo(float).eps


def lame(material):
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


class ByHand:
    """The energy, cell by cell, edge by edge, node by node; complex displacements too.

    Knows nothing of dolfinx: a cell is in the patch of each pair of its points, and of each of its
    points, together with cells of its own material.
    """

    def __init__(self, mesh, materials, strain):
        self.mesh, self.materials, self.strain = mesh, materials, strain
        self.spoiled_edge = self.spoiled_node = None
        self.is_split_by_material = True

    def strain_of_cell(self, cell, u):
        nodes = self.mesh.cells[cell]
        x, d = self.mesh.points[nodes], u[nodes]
        H = (d[1:] - d[0]).T @ np.linalg.inv((x[1:] - x[0]).T)
        E = (H + H.T) / 2
        return E + H.T @ H / 2 if self.strain is Strain.GREEN else E

    def volume(self, cell):
        x = self.mesh.points[self.mesh.cells[cell]]
        return np.linalg.det(x[1:] - x[0]) / 6

    def energy(self, u):
        edges, nodes, ratios = defaultdict(list), defaultdict(list), {}
        for cell, points in enumerate(self.mesh.cells.tolist()):
            E, V = self.strain_of_cell(cell, u), self.volume(cell)
            lmbda, mu = lame(self.materials[cell])
            kind = self.materials[cell] if self.is_split_by_material else None
            for edge in itertools.combinations(sorted(points), 2):
                share = V / 12 if (edge, cell) == self.spoiled_edge else V / 6
                edges[edge, kind].append((share, mu, E))
                ratios[edge, kind] = min(lmbda / mu + 2, 6)
            for node in points:
                share = 0.0 if (node, cell) == self.spoiled_node else V / 4
                nodes[node, kind].append((share, lmbda, np.trace(E)))
        energy = 0.0
        for key, parts in edges.items():
            mean = sum(v * E for v, _, E in parts) / sum(v for v, _, _ in parts)
            stiffness = sum(v * mu for v, mu, _ in parts)
            energy += stiffness * np.sum(mean * mean)
            x = (-ratios[key] * np.trace(mean) - 0.2) / 0.5
            if self.strain is Strain.GREEN and x.real > 0:
                x = x if x.real < 1 else 1.0
                squares = sum(v * np.sum(E * E) for v, _, E in parts) / sum(v for v, _, _ in parts)
                variance = squares - np.sum(mean * mean)
                energy += stiffness * x**2 * (3 - 2 * x) * variance
        for parts in nodes.values():
            mean = sum(v * theta for v, _, theta in parts) / sum(v for v, _, _ in parts)
            energy += sum(v * lmbda for v, lmbda, _ in parts) / 2 * mean**2
        return energy

    def force(self, u):
        """The derivative of the energy by complex steps: exact to rounding."""
        force = np.zeros_like(u)
        step = 1e-30
        for position in np.ndindex(u.shape):
            moved = u.astype(complex)
            moved[position] += 1j * step
            force[position] = self.energy(moved).imag / step
        return force


def random_displacement(mesh, fraction=0.1, seed=5):
    size = (mesh.volume / mesh.num_cells) ** (1 / 3)
    return np.random.default_rng(seed).uniform(-fraction * size, fraction * size, mesh.points.shape)


def beyond_the_middle(mesh):
    return np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(np.int32)


def body_of(mesh, strain, *, material=SOFT, inclusions=(), element=Element.SMOOTHED, degree=1):
    problem = Problem(mesh, material, (), (), inclusions=inclusions)
    return DiscreteProblem(problem, strain=strain, degree=degree, element=element)


def force_of(body, u):
    return body.at_points(body.internal_force(body.space.from_points(u)))


@pytest.fixture
def two_materials(box):
    """A small ragged box, hard beyond its middle, both ways: for the reference and by hand."""
    mesh = box((2, 1, 1), jitter=0.2)
    hard = beyond_the_middle(mesh)
    materials = [HARD if cell in hard else SOFT for cell in range(mesh.num_cells)]
    return mesh, (Inclusion(hard, HARD),), materials


@BOTH
def test_energy_and_force_are_those_of_loops_over_edges_and_nodes(two_materials, strain):
    mesh, inclusions, materials = two_materials
    u = random_displacement(mesh, 0.2)
    body, by_hand = body_of(mesh, strain, inclusions=inclusions), ByHand(mesh, materials, strain)
    assert body.strain_energy(body.space.from_points(u)) == pytest.approx(
        by_hand.energy(u), rel=1e-13
    )
    expected = by_hand.force(u)
    assert np.abs(force_of(body, u) - expected).max() <= 1e-12 * np.abs(expected).max()


def one_edge_by_half_in_one_cell(by_hand):
    edge = tuple(sorted(by_hand.mesh.cells[0][:2].tolist()))
    by_hand.spoiled_edge = (edge, 0)


def a_node_without_a_cell(by_hand):
    by_hand.spoiled_node = (int(by_hand.mesh.cells[0][0]), 0)


def smoothing_across_materials(by_hand):
    by_hand.is_split_by_material = False


def one_material_alone(by_hand):
    by_hand.materials = [SOFT] * len(by_hand.materials)


FAULTS = [
    one_edge_by_half_in_one_cell,
    a_node_without_a_cell,
    smoothing_across_materials,
    one_material_alone,
]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_the_averages_is_far_beyond_the_tolerance(two_materials, fault):
    mesh, inclusions, materials = two_materials
    u = random_displacement(mesh, 0.2)
    body = body_of(mesh, Strain.GREEN, inclusions=inclusions)
    by_hand = ByHand(mesh, materials, Strain.GREEN)
    fault(by_hand)
    spoiled = by_hand.force(u)
    # A billion times what the two may differ by.
    assert np.abs(force_of(body, u) - spoiled).max() > 1e-3 * np.abs(spoiled).max()


def test_cells_of_equal_constants_are_smoothed_together(box):
    # An inclusion of the body's own material, whatever it weighs, is none.
    mesh = box((2, 1, 1), jitter=0.2)
    alike = Inclusion(beyond_the_middle(mesh), Material(3000.0, 0.3, 2000.0))
    u = random_displacement(mesh)
    plain = force_of(body_of(mesh, Strain.GREEN), u)
    named = force_of(body_of(mesh, Strain.GREEN, inclusions=(alike,)), u)
    assert np.array_equal(named, plain)


@BOTH
def test_tangent_is_the_derivative_of_the_force_and_symmetric(two_materials, strain):
    mesh, inclusions, _ = two_materials
    body = body_of(mesh, strain, inclusions=inclusions)
    u = body.space.from_points(random_displacement(mesh, 0.2))
    tangent = body.tangent(u, 1.0).convert("dense").getDenseArray()
    direction = np.random.default_rng(3).uniform(-0.1, 0.1, len(u))
    h = 1.0 if strain is Strain.LINEAR else 1e-3
    at = {k: body.internal_force(u + k * h * direction) for k in (-2, -1, 1, 2)}
    # Under linear strain exact whatever the step; otherwise what is left is of h^4, and rounding.
    slope = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * h)
    product = tangent @ direction
    assert np.abs(product).max() > 1.0
    assert np.abs(product - slope).max() <= (1e-12 if h == 1.0 else 1e-10) * np.abs(slope).max()
    assert np.abs(tangent - tangent.T).max() <= 4 * EPS * np.abs(tangent).max()


@BOTH
def test_patch_test_an_affine_state_is_that_of_the_plain_tetrahedra(box, strain):
    mesh = box((3, 2, 2), jitter=0.3)
    gradient = np.array([[0.1, 0.05, -0.02], [0.0, -0.08, 0.03], [0.04, 0.0, 0.06]])
    u = mesh.points @ gradient.T
    smoothed, plain = (body_of(mesh, strain, element=element) for element in reversed(Element))
    forces = force_of(smoothed, u)
    largest = np.abs(forces).max()
    assert largest > 1.0
    assert np.abs(forces - force_of(plain, u)).max() <= 1e-13 * largest
    inside = np.setdiff1d(np.arange(mesh.num_points), np.unique(mesh.boundary_facets))
    assert len(inside) == 2
    assert np.abs(forces[inside]).max() <= 1e-13 * largest


@BOTH
@pytest.mark.parametrize("seed", range(3))
def test_energy_is_below_that_of_the_plain_tetrahedra(two_materials, strain, seed):
    mesh, inclusions, _ = two_materials
    smoothed, plain = (
        body_of(mesh, strain, inclusions=inclusions, element=element)
        for element in reversed(Element)
    )
    u = smoothed.space.from_points(random_displacement(mesh, 0.3, seed))
    assert 0.0 < smoothed.strain_energy(u) < 0.99 * plain.strain_energy(u)
    # One cell alone has nothing to be averaged with.
    alone = TetMesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]])
    smoothed, plain = (body_of(alone, strain, element=element) for element in reversed(Element))
    u = random_displacement(alone, 0.3, seed)
    assert force_of(smoothed, u) == pytest.approx(force_of(plain, u), rel=1e-12, abs=1e-12)


@BOTH
def test_the_volumetric_part_is_a_mixed_form_with_vertex_quadrature(box, strain):
    """p^2 at the vertices: every pressure stands alone, p_n = lmbda theta_n."""
    mesh = box((3, 2, 2), jitter=0.2)
    material = Material(3000.0, 0.3)
    lmbda, mu = lame(material)
    # The same mu without lmbda: what is left is the shear part.
    shear, whole = (body_of(mesh, strain, material=m) for m in (Material(2 * mu, 0.0), material))
    # So small that no edge is compressed enough to go over to the plain cells.
    u = random_displacement(mesh, 0.01)
    volumetric = force_of(whole, u) - force_of(shear, u)

    domain = whole.space.transferred.mesh
    pressures = whole.u.function_space.sub(0).collapse()[0]
    p, q, dp = fem.Function(pressures), ufl.TestFunction(pressures), ufl.TrialFunction(pressures)
    whole.set_displacement(whole.space.from_points(u))
    theta = ufl.tr(strain_tensor(whole.u, strain))
    at_vertices = ufl.dx(
        domain=domain, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1}
    )
    exact = ufl.dx(domain=domain, metadata={"quadrature_degree": 1})
    potential = p * theta * exact - p**2 / (2 * lmbda) * at_vertices
    balance = ufl.derivative(potential, p, q)
    matrix = fenicsx.create_matrix(fenicsx.form(ufl.derivative(balance, p, dp)))
    fenicsx.assemble_into_matrix(matrix, fenicsx.form(ufl.derivative(balance, p, dp)))
    diagonal = matrix.getDiagonal().array
    assert float(matrix.norm()) == pytest.approx(np.linalg.norm(diagonal), rel=1e-14)
    p.x.array[:] = -fenicsx.assemble_vector(fenicsx.form(balance)) / diagonal
    work = ufl.derivative(potential, whole.u, whole.v)
    force = whole.at_points(fenicsx.assemble_vector(fenicsx.form(work)))
    assert np.abs(force).max() > 1.0
    assert np.abs(volumetric - force).max() <= 1e-12 * np.abs(force).max()


RATIOS = pytest.mark.parametrize(
    "poissons_ratio", [pytest.param(0.3, marks=pytest.mark.nightly), 0.49]
)


def sparse(matrix):
    starts, columns, values = matrix.getValuesCSR()
    return csr_matrix((values, columns, starts), shape=matrix.getSize())


def stiffness_and_masses(problem, *, degree=1, element=Element.SMOOTHED):
    """K at rest, the consistent mass, and its row sums (degree 1), on the free entries."""
    body = DiscreteProblem(problem, strain=Strain.GREEN, degree=degree, element=element)
    K = sparse(body.tangent(np.zeros(body.num_dofs), 0.0))
    dx = ufl.dx(domain=body.space.transferred.mesh, metadata={"quadrature_degree": 2 * degree})
    du = ufl.TrialFunction(body.space.space)
    form = fenicsx.form(problem.material.density * ufl.inner(du, body.v) * dx)
    matrix = fenicsx.create_matrix(form)
    fenicsx.assemble_into_matrix(matrix, form)
    lumped = diags(row_sums_of_mass(body, problem)).tocsr()
    return [A[body.free][:, body.free].tocsc() for A in (K, sparse(matrix), lumped)]


def lowest_frequencies(K, M, count=16):
    squared = eigsh(K, count, M, sigma=0.0, which="LM", return_eigenvectors=False)
    return np.sqrt(np.sort(squared)) / (2 * np.pi)


@RATIOS
def test_a_free_body_has_six_zero_frequencies_and_then_true_ones(box, poissons_ratio):
    mesh = box((6, 3, 3), (2.0, 1.0, 1.0), jitter=0.2)
    problem = Problem(mesh, Material(1e4, poissons_ratio), (), ())
    K, consistent, lumped = stiffness_and_masses(problem)
    true_K, true_M, _ = stiffness_and_masses(problem, degree=2, element=Element.LINEAR)
    true = eigh(true_K.toarray(), true_M.toarray(), eigvals_only=True)
    for M, nearness in ((consistent, 0.1), (lumped, 0.4)):
        found = eigh(K.toarray(), M.toarray(), eigvals_only=True)
        assert np.abs(found[:6]).max() <= 1e-12 * found[-1]
        # Squares of frequencies; this mesh is three cells thick.
        assert found[6:12] == pytest.approx(true[6:12], rel=nearness)


@RATIOS
def test_a_clamped_beam_has_the_frequencies_of_quadratic_cells(box, poissons_ratio):
    mesh = box((16, 4, 4), (0.4, 0.1, 0.1), jitter=0.2)
    supports = (support(mesh, "x0"),)
    problem = Problem(mesh, Material(2e4, poissons_ratio), supports, ())
    true = lowest_frequencies(*stiffness_and_masses(problem, degree=2, element=Element.LINEAR)[:2])
    K, consistent, lumped = stiffness_and_masses(problem)
    # Quadratic cells half as large have frequencies lower by up to 0.5 % (0.9 % for nu = 0.49).
    assert lowest_frequencies(K, consistent) == pytest.approx(true, rel=0.05)
    by_row_sums = lowest_frequencies(K, lumped) / true
    assert (by_row_sums < 1.03).all()
    # What the row sums of the mass, not the stiffness, take off the shorter waves.
    assert (by_row_sums > 0.9).all()
    K, consistent, _ = stiffness_and_masses(problem, element=Element.LINEAR)
    locked = lowest_frequencies(K, consistent) / true
    assert locked.max() > (1.15 if poissons_ratio == 0.3 else 1.9)


@pytest.mark.nightly
@pytest.mark.slow
@RATIOS
@pytest.mark.parametrize(("name", "lowest"), [("beam", 0.95), ("kidney", 0.92)])
def test_clamped_cases_have_the_frequencies_of_quadratic_cells(name, lowest, poissons_ratio):
    case = load_case(name).problem
    material = dataclasses.replace(case.material, poissons_ratio=poissons_ratio)
    problem = dataclasses.replace(case, material=material)
    true = lowest_frequencies(*stiffness_and_masses(problem, degree=2, element=Element.LINEAR)[:2])
    K, consistent, lumped = stiffness_and_masses(problem)
    assert lowest_frequencies(K, consistent) == pytest.approx(true, rel=0.02)
    by_row_sums = lowest_frequencies(K, lumped) / true
    assert by_row_sums.max() < 1.05
    assert by_row_sums.min() > lowest
