"""Materials by cell: layers in series and in parallel have closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.problem import Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.laws import lame_parameters
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

SOFT, STIFF = Material(1e4, 0.3, 1000.0), Material(5e4, 0.2, 3000.0)


def layers(mesh, split):
    """Cells whose centre lies beyond x = split."""
    beyond = mesh.points[mesh.cells].mean(axis=1)[:, 0] > split
    return Inclusion(np.flatnonzero(beyond).astype(np.int32), STIFF)


def confined(mesh):
    """Held along x at x0, along y and z on the sides."""
    held = []
    for name, axis in (("x0", 0), ("y0", 1), ("y1", 1), ("z0", 2), ("z1", 2)):
        facets = mesh.facet_groups[name]
        components = tuple(k == axis for k in range(3))
        held.append(Support(np.unique(facets).astype(np.int32), facets, components))
    return tuple(held)


def confined_stretch(material, traction, strain):
    lmbda, mu = lame_parameters(material)
    if strain is Strain.LINEAR:
        return 1.0 + traction / (lmbda + 2 * mu)
    # P = a (lmbda + 2 mu) (a^2 - 1) / 2, the branch next to a = 1.
    roots = np.roots([1.0, 0.0, -1.0, -2.0 * traction / (lmbda + 2 * mu)])
    return float(max(roots.real[np.abs(roots.imag) < 1e-9]))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("strain", list(Strain))
def test_layers_in_series_each_take_their_own_stretch(box, degree, strain):
    mesh = box((4, 2, 2), jitter=0.0)
    traction = -1500.0
    problem = Problem(
        mesh,
        SOFT,
        confined(mesh),
        (Traction(mesh.facet_groups["x1"], (traction, 0.0, 0.0)),),
        inclusions=(layers(mesh, 0.5),),
    )
    u = solve_static(problem, strain=strain, degree=degree).displacement
    a, b = (confined_stretch(m, traction, strain) for m in (SOFT, STIFF))
    assert abs(a - b) > 0.05
    x = mesh.points[:, 0]
    expected = np.where(x <= 0.5, (a - 1.0) * x, (a - 1.0) * 0.5 + (b - 1.0) * (x - 0.5))
    # The linear solve's own residual of 1e-10, times a few.
    np.testing.assert_allclose(u[:, 0], expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(u[:, 1:], 0.0, rtol=0.0, atol=1e-9)


def test_an_inclusion_of_the_same_material_changes_nothing(box):
    mesh = box((3, 2, 2), jitter=0.2)
    loads = (Traction(mesh.facet_groups["x1"], (0.0, 0.0, 300.0)),)
    facets = mesh.facet_groups["x0"]
    supports = (Support(np.unique(facets).astype(np.int32), facets),)
    some = np.arange(0, mesh.num_cells, 3, dtype=np.int32)
    plain = solve_static(Problem(mesh, SOFT, supports, loads))
    same = solve_static(Problem(mesh, SOFT, supports, loads, inclusions=(Inclusion(some, SOFT),)))
    assert np.array_equal(plain.displacement, same.displacement)


def test_heavier_cells_swing_with_their_own_mass(box):
    # One free step from rest: the acceleration is force over each vertex's own lumped mass.
    mesh = box((2, 1, 1))
    dt, traction = 1e-5, 10.0
    inclusion = layers(mesh, 0.5)
    problem = Problem(
        mesh,
        SOFT,
        (),
        (Traction(mesh.boundary_facets, (0.0, 0.0, traction)),),
        TimeSpan(dt, dt, num_outputs=1),
        inclusions=(inclusion,),
    )
    u = simulate_explicit(problem).displacements[-1]
    density = np.full(mesh.num_cells, SOFT.density)
    density[inclusion.cells] = STIFF.density
    mass, force = np.zeros(mesh.num_points), np.zeros(mesh.num_points)
    np.add.at(
        mass,
        mesh.cells,
        (density * signed_volumes(mesh.points, mesh.cells) / 4.0)[:, None].repeat(4, axis=1),
    )
    corners = mesh.points[mesh.boundary_facets]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    np.add.at(force, mesh.boundary_facets, (traction * areas / 6.0)[:, None].repeat(3, axis=1))
    expected = 0.5 * dt**2 * force / mass
    np.testing.assert_allclose(u[:, 2], expected, rtol=1e-12)
