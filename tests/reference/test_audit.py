"""The audit measures the error it is given, exactly where theory says exactly."""

from __future__ import annotations

import numpy as np
import pytest
from bank import fixed

from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.shapes import shape_box
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.result import Audit

pytestmark = pytest.mark.dolfinx


@pytest.fixture(scope="module")
def problem() -> Problem:
    from palpate.fastsim.mesher import mesh_surface

    mesh: TetMesh = mesh_surface(shape_box((2.0, 1.0, 1.0), edge_length=0.4))
    corners = mesh.points[mesh.boundary_facets]
    held = mesh.boundary_facets[(corners[:, :, 0] == 0.0).all(axis=1)]
    pulled = mesh.boundary_facets[(corners[:, :, 0] == 2.0).all(axis=1)]
    return Problem(
        mesh,
        Material(1e4, 0.3),
        (fixed(held),),
        (Traction(pulled, (300.0, -60.0, 40.0)), BodyForce((0.0, 0.0, -50.0))),
    )


@pytest.mark.parametrize("strain", list(Strain))
def test_an_equilibrium_passes_and_a_spoiled_one_does_not(problem: Problem, strain: Strain) -> None:
    from palpate.reference.audit import audit_displacement
    from palpate.reference.statics import solve_static

    found = solve_static(problem, strain=strain)
    good = audit_displacement(problem, found.displacement, strain=strain, degree=1)
    # The solve stops at 1e-10 of the nodal forces; softest modes amplify that in energy.
    assert good.relative_residual_norm < 1e-7
    assert good.support_gap == 0.0
    assert good.smallest_det_f == pytest.approx(found.smallest_det_f, rel=1e-12)
    assert good.strain_energy == pytest.approx(found.strain_energy, rel=1e-12)
    load = 300.0 + 100.0  # [N], order of the total
    assert good.force_imbalance < 1e-8 * load
    assert good.moment_imbalance < 1e-8 * load
    assert good.displacement_error is not None
    assert good.displacement_error < 1e-8
    spoiled = audit_displacement(problem, 1.02 * found.displacement, strain=strain, degree=1)
    assert spoiled.relative_residual_norm > 0.005
    assert spoiled.force_imbalance > 1e-3 * load
    assert spoiled.displacement_error is not None
    assert 0.01 < spoiled.displacement_error < 0.04


def test_under_linear_strain_the_norm_is_the_energy_norm_of_the_error(problem: Problem) -> None:
    from palpate.reference.audit import audit_displacement
    from palpate.reference.discrete_problem import ElasticBody
    from palpate.reference.mesh_transfer import create_space, transfer
    from palpate.reference.statics import solve_static

    found = solve_static(problem, strain=Strain.LINEAR, relative_tolerance=1e-12)
    error = 1e-3 * np.random.default_rng(0).standard_normal(found.displacement.shape)
    error[problem.supports[0].points] = 0.0
    body = ElasticBody(create_space(transfer(problem.mesh), 1), problem.material, Strain.LINEAR)
    energy = body.strain_energy(body.space.from_points(error))
    audit = audit_displacement(problem, found.displacement + error, strain=Strain.LINEAR, degree=1)
    assert audit.residual_norm == pytest.approx(np.sqrt(2.0 * energy), rel=1e-6)
    # One Newton step solves a linear problem: the estimates are exact.
    size = np.linalg.norm(error) / np.linalg.norm(found.displacement)
    assert audit.displacement_error == pytest.approx(size, rel=1e-6)
    spoiled = problem.mesh.surface(found.displacement + error).volume - problem.mesh.volume
    right = problem.mesh.surface(found.displacement).volume - problem.mesh.volume
    assert audit.volume_error == pytest.approx(spoiled / right - 1.0, rel=1e-4)


def test_on_degree_two_it_foretells_what_linear_tetrahedra_are_wrong_by(problem: Problem) -> None:
    from palpate.reference.audit import audit_displacement
    from palpate.reference.statics import solve_static

    linear = solve_static(problem).displacement
    better = solve_static(problem, degree=2)
    audit = audit_displacement(problem, linear, degree=2)
    error = np.linalg.norm(linear - better.displacement) / np.linalg.norm(better.displacement)
    assert audit.displacement_error == pytest.approx(error, rel=0.01)
    change = problem.mesh.surface(linear).volume - problem.mesh.volume
    volume_error = change / (better.volume - problem.mesh.volume) - 1.0
    assert audit.volume_error == pytest.approx(volume_error, rel=0.25)
    assert audit.relative_residual_norm > 0.05
    assert np.linalg.norm(audit.cell_errors) == pytest.approx(audit.residual_norm, rel=1e-6)
    # The clamp's edge is where linear tetrahedra are most wrong.
    middle = problem.mesh.points[problem.mesh.cells].mean(axis=1)
    worst = np.argsort(audit.cell_errors)[-len(middle) // 10 :]
    assert middle[worst, 0].mean() < 0.6 * middle[:, 0].mean()


def test_a_support_that_was_not_met_and_an_inverted_cell_are_told(problem: Problem) -> None:
    from palpate.reference.audit import audit_displacement

    loose = np.full(problem.mesh.points.shape, [0.0, 0.0, 0.01])
    gap = audit_displacement(problem, loose, degree=1)
    assert gap.support_gap == pytest.approx(0.01)
    assert gap.relative_support_gap == pytest.approx(1.0)
    inverted = np.zeros(problem.mesh.points.shape)
    inverted[:, 0] = -2.0 * problem.mesh.points[:, 0]
    audit = audit_displacement(problem, inverted, degree=1)
    assert audit.smallest_det_f == pytest.approx(-1.0)
    assert audit.displacement_error is None


def test_a_column_that_would_buckle_is_in_equilibrium_but_not_stable() -> None:
    from palpate.reference.audit import audit_displacement

    def straight(stretch: float) -> Audit:
        """A column without Poisson's effect, as long as `stretch` of it, and the load for that."""
        mesh = brick_box((2, 2, 12), (1.0, 1.0, 10.0))
        corners = mesh.points[mesh.boundary_facets]
        base, top = (mesh.boundary_facets[(corners[:, :, 2] == z).all(axis=1)] for z in (0.0, 10.0))
        # P = F S, S = E (stretch^2 - 1) / 2.
        pressure = 1e4 * stretch * (stretch**2 - 1.0) / 2.0
        column = Problem(
            mesh,
            Material(1e4, 0.0),
            (fixed(base),),
            (Traction(top, (0.0, 0.0, pressure)),),
        )
        moved = np.zeros_like(mesh.points)
        moved[:, 2] = (stretch - 1.0) * mesh.points[:, 2]
        return audit_displacement(column, moved, degree=1)

    # Euler's strain, clamped and free: (pi / 2)^2 (1 / 12) / 10^2 = 0.2 %; linear tetrahedra of
    # this size are stiffer in bending, some three times.
    for stretch, is_stable in ((0.9995, True), (0.95, False)):
        found = straight(stretch)
        assert found.relative_residual_norm < 1e-12
        assert found.is_stable is is_stable


def test_refusals(problem: Problem) -> None:
    from palpate.reference.audit import audit_displacement

    zero = np.zeros(problem.mesh.points.shape)
    with pytest.raises(InputError, match="degree"):
        audit_displacement(problem, zero, degree=4)
    with pytest.raises(InputError, match="shape"):
        audit_displacement(problem, zero[1:])
    zero[3, 1] = np.nan
    with pytest.raises(InputError, match="NaN"):
        audit_displacement(problem, zero)
