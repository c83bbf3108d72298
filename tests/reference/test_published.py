"""Published values: Turek-Hron CSM1 and CSM2, the elastica, Sze's cantilever."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.validation.metrics.grid_convergence import assess_grid_convergence

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = [pytest.mark.dolfinx, pytest.mark.slow]


def support(facets, components=(True, True, True)):
    return Support(np.unique(facets).astype(np.int32), facets, components)


def turek_hron_bar(box, mu, num_layers):
    """The bar behind the cylinder, one layer of cells thick, held in plane strain.

    S. Turek, J. Hron, Proposal for numerical benchmarking of fluid-structure interaction, 2006:
    circle of radius 0.05 about (0.2, 0.2), bar 0.02 high up to x = 0.6, clamped on the arc,
    nu = 0.4, density 1000, body force 2 per mass downward. Returns the problem and point A.
    """
    thickness = 0.02 / num_layers
    flat = box((10 * num_layers, num_layers, 1), (1.0, 1.0, thickness))
    points = flat.points.copy()
    along = flat.points[:, 0] ** 1.5  # finer towards the clamp
    points[:, 1] = 0.19 + 0.02 * flat.points[:, 1]
    arc = 0.2 + np.sqrt(0.05**2 - (points[:, 1] - 0.2) ** 2)
    points[:, 0] = arc + (0.6 - arc) * along
    mesh = TetMesh(points, flat.cells, flat.facet_groups)
    in_plane = (False, False, True)
    supports = (
        support(mesh.facet_groups["x0"]),
        support(mesh.facet_groups["z0"], in_plane),
        support(mesh.facet_groups["z1"], in_plane),
    )
    nu = 0.4
    material = Material(2 * mu * (1 + nu), nu, 1000.0)
    end = int(np.argmin(np.abs(points - [0.6, 0.2, 0.0]).sum(axis=1)))
    assert np.abs(points[end] - [0.6, 0.2, 0.0]).max() < 1e-12
    return Problem(mesh, material, supports, (BodyForce((0.0, -2000.0, 0.0)),)), end


@pytest.mark.parametrize(
    ("mu", "published", "independent"),
    [  # displacement of A in mm: featflow tables, finest level; an independent Q2 solver
        pytest.param(
            0.5e6, (-7.18767, -66.1023), (-7.18763, -66.1021), id="CSM1", marks=pytest.mark.nightly
        ),
        pytest.param(2.0e6, (-0.469000, -16.9739), (-0.468996, -16.9738), id="CSM2"),
    ],
)
def test_turek_hron_lies_within_the_error_bar(box, mu, published, independent):
    values = []
    for num_layers in (6, 4, 2):
        problem, end = turek_hron_bar(box, mu, num_layers)
        values.append(1e3 * solve_static(problem, degree=3).displacement[end])
    for axis in (0, 1):
        # The clamped corner is singular: order 2 Re(exponent), 1.4 for nu = 0.4, not 6.
        bar = assess_grid_convergence(
            [v[axis] for v in values], [1 / 6, 1 / 4, 1 / 2], expected_order=1.4
        )
        assert bar.error_bar is not None, bar.behaviour
        for target in (published[axis], independent[axis]):
            assert bar.value == pytest.approx(target, rel=1e-3)
            assert abs(bar.value - target) <= bar.error_bar
    problem, end = turek_hron_bar(box, mu, 4)
    control = 1e3 * solve_static(problem, strain=Strain.LINEAR, degree=3).displacement[end]
    # Linear elasticity, as a control: no shortening, and a larger deflection.
    assert abs(control[0]) < 1e-3
    assert control[1] == pytest.approx({0.5e6: -68.019, 2.0e6: -17.005}[mu], rel=1e-3)


@pytest.mark.parametrize(
    ("load_factor", "elastica", "sze"),
    [
        # P L^2 / (E I) = 4 load_factor; L = 10. Elastica in closed form; Sze, Liu, Lo 2004.
        (0.25, (-0.5643324, 3.0172077), (-0.563, 3.015)),
        (0.50, (-1.6064172, 4.9345748), (-1.604, 4.933)),
        (1.00, (-3.2894124, 6.6996418), (-3.286, 6.698)),
        (2.50, (-5.5499560, 8.1060902), None),
    ],
)
def test_cantilever_under_end_shear(box, load_factor, elastica, sze):
    mesh = box((40, 2, 2), (10.0, 1.0, 0.1))
    shear = (0.0, 0.0, 4.0 * load_factor / 0.1)
    problem = Problem(
        mesh,
        Material(1.2e6, 0.0),
        (support(mesh.facet_groups["x0"]),),
        (Traction(mesh.facet_groups["x1"], shear),),
    )
    result = solve_static(problem, degree=2)
    tip = int(np.argmin(np.abs(mesh.points - [10.0, 0.5, 0.05]).sum(axis=1)))
    moved = result.displacement[tip, [0, 2]]
    # 0.1 %: the beam's own shear and stretch are (h/L)^2 = 1e-4 of it.
    for published in (elastica, sze):
        if published is not None:
            scale = np.abs(published).max()
            assert np.abs(moved - published).max() <= 1e-3 * scale
    assert result.volume == pytest.approx(1.0, rel=1e-3)
