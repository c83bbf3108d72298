"""The smoothed element: its energy by plain sums, and what follows from it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.meshes.problem import Element, Inclusion, Material, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

TISSUE = Material(1e4, 0.4, 1000.0)
STIFF = Material(8e4, 0.2, 1000.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))
EPS = float(np.finfo(float).eps)


def smoothed(mesh: TetMesh, strain: Strain = Strain.GREEN, *, mixed: bool = False) -> Body:
    """A body, half of whose cells are eight times as stiff if it is mixed."""
    return Body(mesh, TISSUE, strain, element=Element.SMOOTHED, inclusions=stiff_half(mesh, mixed))


def stiff_half(mesh: TetMesh, mixed: bool) -> tuple[Inclusion, ...]:
    centres = mesh.points[mesh.cells].mean(axis=1)
    cells = np.flatnonzero(centres[:, 0] > np.median(centres[:, 0])).astype(np.int32)
    return (Inclusion(cells, STIFF),) if mixed else ()


def random_displacement(mesh: TetMesh, amplitude: float = 0.05, seed: int = 1) -> np.ndarray:
    return amplitude * np.random.default_rng(seed).standard_normal(mesh.points.shape)


def rotation(angle: float) -> np.ndarray:
    axis = np.array([1.0, 2.0, -0.5])
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def energy_by_sums(
    body: Body, u: np.ndarray, *, weight_of: float = 1.0, left_out: int = -1, mixes: bool = False
) -> float:
    """W = sum V_e mu E_e : E_e + sum V_n lmbda / 2 theta_n^2, cell by cell in dictionaries.

    Faults on request: the first edge's strain weighed otherwise, a cell left out of the node
    volumes, patches across materials (then with the mean of their constants).
    """
    mesh = body.mesh
    volumes = signed_volumes(mesh.points, mesh.cells)
    edges: dict[tuple[int, int, float], list[np.ndarray]] = {}
    nodes: dict[tuple[int, float], list[np.ndarray]] = {}
    for c, cell in enumerate(mesh.cells):
        D = (mesh.points[cell[1:]] - mesh.points[cell[0]]).T
        H = (u[cell[1:]] - u[cell[0]]).T @ np.linalg.inv(D)
        E = 0.5 * (H + H.T)
        if body.strain is Strain.GREEN:
            E = E + 0.5 * H.T @ H
        kind = 0.0 if mixes else float(body.mu[c])
        for i, j in itertools.combinations(sorted(cell), 2):
            row = np.array([volumes[c] / 6.0, body.mu[c], *E.ravel()])
            edges.setdefault((i, j, kind), []).append(row)
        for i in cell:
            part = 0.0 if c == left_out else volumes[c] / 4.0
            row = np.array([part, volumes[c] / 4.0, body.lmbda[c], np.trace(E)])
            nodes.setdefault((i, kind), []).append(row)
    energy = 0.0
    for k, rows in enumerate(edges.values()):
        V, mu, *E_c = np.array(rows).T
        E_e = (V * np.array(E_c)).sum(axis=1) / V.sum() * (weight_of if k == 0 else 1.0)
        energy += V.sum() * mu.mean() * float(E_e @ E_e)
    for rows in nodes.values():
        counted, V, lmbda, trace = np.array(rows).T
        theta = float(V @ trace) / counted.sum()
        energy += counted.sum() * 0.5 * lmbda.mean() * theta**2
    return energy


@BOTH
@pytest.mark.parametrize("mixed", [False, True])
def test_energy_is_that_of_the_plain_sums(ragged_box: TetMesh, strain: Strain, mixed: bool) -> None:
    body, u = smoothed(ragged_box, strain, mixed=mixed), random_displacement(ragged_box)
    assert body.strain_energy(u) == pytest.approx(energy_by_sums(body, u), rel=1e-13)


def test_energy_of_two_cells_by_hand() -> None:
    """Cells 0123 and 1234 with V = 1/6 and 1/3; point 4 = (1, 1, 1) alone moves, by (a, a, a).

    It is 2 / root 3 from the plane x + y + z = 1 of the others, so that its shape function has the
    gradient (1, 1, 1) / 2 and E = H = a / 2 in all nine components: tr E = 1.5 a, E : E = 2.25 a^2.
    The three edges that the cells share have V_e = (1/6 + 1/3) / 6 = 1/12 and 2/3 of E, by
    volume; three at point 4 have E itself, V_e = 1/18; three at point 0 have none. Likewise
    three nodes with 2/3 tr E at V_n = 1/8, and one with tr E at V_n = 1/12.
    """
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    mesh = TetMesh(points, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
    a, u = 0.1, np.zeros((5, 3))
    u[4] = a
    body = smoothed(mesh, Strain.LINEAR)
    edges = 3.0 / 12.0 * (2.0 / 3.0) ** 2 + 3.0 / 18.0
    nodes = 3.0 / 8.0 * (2.0 / 3.0) ** 2 + 1.0 / 12.0
    mu, lmbda = float(body.mu[0]), float(body.lmbda[0])
    expected = mu * edges * 2.25 * a**2 + 0.5 * lmbda * nodes * (1.5 * a) ** 2
    assert body.strain_energy(u) == pytest.approx(expected, rel=1e-13)


def test_seeded_faults_change_the_energy(ragged_box: TetMesh) -> None:
    """What the comparison with plain sums is worth: it sees each fault, at 1e-7 and more."""
    body, u = smoothed(ragged_box, mixed=True), random_displacement(ragged_box)
    right = body.strain_energy(u)
    for fault in ({"weight_of": 1.01}, {"left_out": 7}, {"mixes": True}):
        wrong = energy_by_sums(body, u, **fault)  # type: ignore[arg-type]
        assert abs(wrong - right) > 1e-7 * right


@BOTH
@pytest.mark.parametrize("mixed", [False, True])
def test_force_is_the_derivative_of_the_energy(
    ragged_box: TetMesh, strain: Strain, mixed: bool
) -> None:
    """W is a polynomial of degree 4 along any line: five values give its slope exactly."""
    body, u = smoothed(ragged_box, strain, mixed=mixed), random_displacement(ragged_box)
    force = body.internal_force(u)
    direction = random_displacement(ragged_box, seed=2)
    W = {s: body.strain_energy(u + s * direction) for s in (-2.0, -1.0, 1.0, 2.0)}
    slope = (8.0 * (W[1.0] - W[-1.0]) - (W[2.0] - W[-2.0])) / 12.0
    product = float(np.sum(force * direction))
    assert abs(product) > 1e-3 * np.linalg.norm(force) * np.linalg.norm(direction)
    assert abs(slope - product) < 1e-12 * max(W.values())


@BOTH
@pytest.mark.parametrize("mixed", [False, True])
def test_tangent_is_the_derivative_of_the_force(
    ragged_box: TetMesh, strain: Strain, mixed: bool
) -> None:
    """R is a polynomial of degree 3 along any line: four values give its slope exactly."""
    body, u = smoothed(ragged_box, strain, mixed=mixed), random_displacement(ragged_box)
    direction = random_displacement(ragged_box, seed=3)
    body.core.assemble_tangent(u)
    product = body.core.multiply(direction)
    R = {s: body.internal_force(u + s * direction) for s in (-2.0, -1.0, 1.0, 2.0)}
    slope = (8.0 * (R[1.0] - R[-1.0]) - (R[2.0] - R[-2.0])) / 12.0
    assert np.abs(product).max() > 1e2
    assert np.abs(slope - product).max() < 1e-12 * max(np.abs(r).max() for r in R.values())


@BOTH
def test_tangent_is_symmetric(ragged_box: TetMesh, strain: Strain) -> None:
    core = smoothed(ragged_box, strain, mixed=True).core
    core.assemble_tangent(random_displacement(ragged_box))
    x, y = random_displacement(ragged_box, 1.0, 4), random_displacement(ragged_box, 1.0, 5)
    Kx, Ky = core.multiply(x), core.multiply(y)
    scale = np.linalg.norm(y) * np.linalg.norm(Kx)
    assert abs(np.sum(y * Kx) - np.sum(x * Ky)) < 100 * EPS * scale


@pytest.mark.parametrize("element", list(Element))
def test_secant_matrix_gives_the_force(ragged_box: TetMesh, element: Element) -> None:
    u = random_displacement(ragged_box)
    body = Body(ragged_box, TISSUE, element=element, inclusions=stiff_half(ragged_box, True))
    body.core.assemble_secant(u)
    force = body.internal_force(u)
    assert np.abs(body.core.multiply(u) - force).max() < 1e-13 * np.abs(force).max()


@BOTH
def test_a_body_at_rest_has_no_force(ragged_box: TetMesh, strain: Strain) -> None:
    body = smoothed(ragged_box, strain, mixed=True)
    rest = np.zeros_like(ragged_box.points)
    assert body.strain_energy(rest) == 0.0
    assert np.abs(body.internal_force(rest)).max() == 0.0


def test_rigid_motion_costs_nothing_with_green_strain_only(ragged_box: TetMesh) -> None:
    u = ragged_box.points @ (rotation(0.7) - np.eye(3)).T + np.array([0.3, -1.0, 2.0])
    scale = TISSUE.youngs_modulus * ragged_box.volume
    green, linear = smoothed(ragged_box), smoothed(ragged_box, Strain.LINEAR)
    assert green.strain_energy(u) < (100 * EPS) ** 2 * scale
    assert np.abs(green.internal_force(u)).max() < 100 * EPS * TISSUE.youngs_modulus
    assert linear.strain_energy(u) > 1e-3 * scale


def test_rotating_the_deformed_body_rotates_the_force(ragged_box: TetMesh) -> None:
    u, R = random_displacement(ragged_box), rotation(1.1)
    turned = (ragged_box.points + u) @ R.T - ragged_box.points
    body = smoothed(ragged_box, mixed=True)
    atol = 1e-13 * STIFF.youngs_modulus
    np.testing.assert_allclose(
        body.internal_force(turned), body.internal_force(u) @ R.T, rtol=0.0, atol=atol
    )


@BOTH
def test_affine_displacement_gives_the_linear_elements_forces(
    ragged_box: TetMesh, strain: Strain
) -> None:
    """Patch test: a constant strain is reproduced, so that inner points are in balance."""
    gradient = np.array([[0.1, 0.05, 0.0], [-0.02, -0.1, 0.03], [0.04, 0.0, 0.2]])
    u = ragged_box.points @ gradient.T
    force = smoothed(ragged_box, strain).internal_force(u)
    plain = Body(ragged_box, TISSUE, strain).internal_force(u)
    inner = np.setdiff1d(np.arange(ragged_box.num_points), ragged_box.boundary_facets)
    assert inner.size > 5
    assert np.abs(force[inner]).max() < 1e-13 * np.abs(force).max()
    assert np.abs(force - plain).max() < 1e-13 * np.abs(plain).max()


@BOTH
@pytest.mark.parametrize("mixed", [False, True])
def test_it_is_never_stiffer_than_the_linear_element(
    ragged_box: TetMesh, strain: Strain, mixed: bool
) -> None:
    plain = Body(ragged_box, TISSUE, strain, inclusions=stiff_half(ragged_box, mixed))
    softer = smoothed(ragged_box, strain, mixed=mixed)
    for seed in range(5):
        u = random_displacement(ragged_box, seed=seed)
        assert softer.strain_energy(u) < 0.9 * plain.strain_energy(u)


@BOTH
def test_forces_sum_to_zero_and_green_moments_too(ragged_box: TetMesh, strain: Strain) -> None:
    u = random_displacement(ragged_box)
    force = smoothed(ragged_box, strain, mixed=True).internal_force(u)
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * scale
    if strain is Strain.GREEN:
        moment = np.cross(ragged_box.points + u, force).sum(axis=0)
        assert np.abs(moment).max() < 1e-14 * scale


def test_renumbering_points_and_cells_renumbers_the_force(ragged_box: TetMesh) -> None:
    rng = np.random.default_rng(6)
    order = rng.permutation(ragged_box.num_points)
    place = np.argsort(order).astype(np.int32)
    cells = place[ragged_box.cells][rng.permutation(ragged_box.num_cells)]
    renumbered = TetMesh(ragged_box.points[order], cells[:, [1, 2, 0, 3]])
    u = random_displacement(ragged_box)
    force = smoothed(ragged_box, mixed=True).internal_force(u)
    other = smoothed(renumbered, mixed=True).internal_force(u[order])
    np.testing.assert_allclose(other, force[order], rtol=0.0, atol=1e-13 * np.abs(force).max())


@BOTH
def test_an_inclusion_of_the_same_constants_changes_nothing(
    ragged_box: TetMesh, strain: Strain
) -> None:
    u = random_displacement(ragged_box)
    cells = np.arange(9, dtype=np.int32)
    twin = (Inclusion(cells, Material(1e4, 0.4, 3000.0)),)
    body = Body(ragged_box, TISSUE, strain, element=Element.SMOOTHED, inclusions=twin)
    expected = smoothed(ragged_box, strain).internal_force(u)
    assert np.array_equal(body.internal_force(u), expected)


@pytest.mark.parametrize("element", list(Element))
@BOTH
def test_energy_is_half_the_work_of_the_stresses(
    ragged_box: TetMesh, strain: Strain, element: Element
) -> None:
    u = random_displacement(ragged_box)
    body = Body(
        ragged_box, TISSUE, strain, element=element, inclusions=stiff_half(ragged_box, True)
    )
    H = body.displacement_gradients(u)
    E = 0.5 * (H + H.transpose(0, 2, 1))
    if strain is Strain.GREEN:
        E = E + 0.5 * H.transpose(0, 2, 1) @ H
    work = (E * body.stresses(E)).sum(axis=(1, 2))
    volumes = signed_volumes(ragged_box.points, ragged_box.cells)
    assert 0.5 * float(volumes @ work) == pytest.approx(body.strain_energy(u), rel=1e-13)
