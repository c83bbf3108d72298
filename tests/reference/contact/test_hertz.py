"""A rigid sphere on an elastic half space (Hertz 1882), and where Green strain leaves it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = [pytest.mark.dolfinx, pytest.mark.slow]

RADIUS, YOUNGS_MODULUS = 1.0, 1e4


def quarter_block(contact_radius):
    """A quarter of a block of 100 contact radii, with four cells to a contact radius at the top.

    A block of 50 is 0.8 % stiffer: a layer on a rigid ground, Dimitriadis et al. 2002.
    """
    gmsh = pytest.importorskip("gmsh")
    a, size = contact_radius, 100.0 * contact_radius
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        for source in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{source}", 0)
        gmsh.model.occ.addBox(0, 0, -size, size, size, size)
        gmsh.model.occ.synchronize()
        field = gmsh.model.mesh.field
        cell_size = field.add("MathEval")
        grown = f"{0.25 * a} + 0.4 * Max(0, Sqrt(x*x + y*y + z*z) - {1.3 * a})"
        field.setString(cell_size, "F", grown)
        field.setAsBackgroundMesh(cell_size)
        gmsh.model.mesh.generate(3)
        tags, points, _ = gmsh.model.mesh.getNodes()
        corners = gmsh.model.mesh.getElementsByType(4)[1]
    finally:
        gmsh.finalize()
    row = np.zeros(int(tags.max()) + 1, dtype=np.int32)
    row[tags] = np.arange(len(tags))
    used, cells = np.unique(row[corners.astype(np.int64)], return_inverse=True)
    return TetMesh(points.reshape(-1, 3)[used], cells.reshape(-1, 4).astype(np.int32)), size


def over_hertz(depth, poissons_ratio, strain):
    """Force of a sphere pressed in by a depth over 4/3 E* sqrt(R) d^1.5."""
    a = np.sqrt(RADIUS * depth)
    mesh, size = quarter_block(a)
    facets = mesh.boundary_facets
    corners = mesh.points[facets]

    def face(axis, value):
        return facets[np.all(np.abs(corners[:, :, axis] - value) < 1e-9 * size, axis=1)]

    def hold(chosen, components=(True, True, True)):
        return Support(np.unique(chosen).astype(np.int32), chosen, components)

    supports = (
        hold(face(0, 0.0), (True, False, False)),
        hold(face(1, 0.0), (False, True, False)),
        hold(face(2, -size)),
    )
    top = face(2, 0.0)
    near = top[np.linalg.norm(mesh.points[top].mean(axis=1), axis=1) < 4.0 * a]
    knots = np.array([[0.0, 0.0, RADIUS], [0.0, 0.0, RADIUS - depth]])
    tool = RigidTool(SphereShape(RADIUS), ToolPath(np.arange(2.0), knots), contact_facets=near)
    material = Material(YOUNGS_MODULUS, poissons_ratio)
    result = solve_static(
        Problem(mesh, material, supports, (), tools=(tool,)), strain=strain, degree=2
    )
    (felt,) = result.tools
    # The last of it, between the nodes of flat facets.
    assert felt.penetrations[-1] < 0.01 * depth
    assert 4.0 * felt.active_areas[-1] == pytest.approx(np.pi * a**2, rel=0.2)
    modulus = YOUNGS_MODULUS / (1.0 - poissons_ratio**2)
    return 4.0 * felt.forces[-1][2] / (4.0 / 3.0 * modulus * np.sqrt(RADIUS) * depth**1.5)


@pytest.mark.parametrize("strain", list(Strain))
def test_a_shallow_sphere_meets_hertz(strain):
    assert over_hertz(0.01 * RADIUS, 0.3, strain) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("poissons_ratio", "strain", "expected"),
    [  # at a depth of 0.05 R, by an axisymmetric solver of its own
        (0.3, Strain.LINEAR, 1.04),
        (0.3, Strain.GREEN, 0.936),
        (0.45, Strain.LINEAR, 1.01),
        (0.45, Strain.GREEN, 0.903),
    ],
)
def test_a_deeper_one_leaves_it_as_an_independent_solver_says(poissons_ratio, strain, expected):
    found = over_hertz(0.05 * RADIUS, poissons_ratio, strain)
    assert found == pytest.approx(expected, abs=0.01)
