"""Abaqus and CalculiX files written by hand give the native problem, and ccx's own answer.

By the keywords of the CalculiX CrunchiX USER'S MANUAL 2.20, chapter 7, which Abaqus shares.
"""

import bars
import numpy as np
import pytest
import simulators

from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.importing import ImportRefusedError, UnitSystem, import_model

NEO_HOOKE = "*DENSITY\n1e-9\n*HYPERELASTIC, NEO HOOKE\n0.02, 12.5"
MOONEY = "*HYPERELASTIC, MOONEY-RIVLIN\n0.015, 0.005, 12.5"


def cload(traction):
    """Consistent nodal forces of a traction t(x, y, z) [MPa] on the end, as *CLOAD."""
    mesh = bars.bar()
    facets = bars.pulled(mesh)
    forces = np.zeros_like(mesh.points)
    corners = mesh.points[facets]
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2.0
    values = np.array([[traction(*position) for position in row] for row in corners])
    # Of an affine traction: A / 12 (t_i + sum of t).
    parts = areas[:, None, None] / 12.0 * (values + values.sum(axis=1, keepdims=True))
    np.add.at(forces, facets, parts)
    lines = [
        f"{n + 1}, {axis + 1}, {float(forces[n, axis])!r}"
        for n, axis in zip(*np.nonzero(forces), strict=True)
    ]
    return "\n".join(["*CLOAD", *lines])


def test_elastic_without_nlgeom_is_linear_strain(bring):
    step = "*STEP, INC=10"
    case, imported = bring(bars.abaqus(step=step, acts="*DSLOAD\nENDFACE, P, -1e-3"), ".inp")
    assert case.strain is Strain.LINEAR
    assert case.title == "A bar, by hand"
    problem = bars.native(Material(100e3, 0.3), Pressure(bars.pulled(bars.bar()), -1e3))
    assert bars.apart(problem, case.problem, Strain.LINEAR) < 1e-10
    assert [line.split(" ", 2)[2] for line in imported.ignored] == ["*NODE PRINT"]


def test_neo_hooke_under_weight_and_a_moved_end(bring):
    acts = "*BOUNDARY\nEND, 1, 1, 2.\nEND, 2, 2\n*DLOAD\nALL, GRAV, 9810., 0., 0., -1."
    case, imported = bring(bars.abaqus(material=NEO_HOOKE, acts=acts), ".inp")
    kappa, mu = 2.0 / 12.5e-6, 2.0 * 0.02e6
    material = Material(
        9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (6 * kappa + 2 * mu), 1000.0,
        Law.NEO_HOOKEAN_ISOCHORIC,
    )  # fmt: skip
    end = bars.pulled(bars.bar())
    moved = Support(np.unique(end), end, (True, True, False), (2e-3, 0.0, 0.0))
    problem = bars.native(material, BodyForce((0.0, 0.0, -9810.0)), more=(moved,))
    assert bars.apart(problem, case.problem) < 1e-10
    assert not imported.notes


def test_mooney_rivlin_and_forces_on_nodes_that_are_a_traction(bring):
    acts = cload(lambda _x, _y, _z: (2e-3, 0.0, -1e-4))
    case, imported = bring(bars.abaqus(material=MOONEY, acts=acts), ".inp")
    (load,) = case.problem.loads
    assert isinstance(load, Traction)
    assert load.is_uniform
    assert len(load.facets) == len(bars.pulled(bars.bar()))
    material = Material.mooney_rivlin(c10=15e3, c01=5e3, bulk_modulus=2.0 / 12.5e-6)
    problem = bars.native(material, Traction(bars.pulled(bars.bar()), (2e3, 0.0, -100.0)))
    assert bars.apart(problem, case.problem) < 1e-10
    assert any("those of a uniform traction on 8 facets" in line for line in imported.notes)
    assert any(check.against == "truth" for check in case.checks)


def test_forces_on_nodes_that_are_an_affine_traction(bring):
    acts = cload(lambda _x, y, z: (1e-3 * (1.0 + z / 10.0), 1e-4 * y, 0.0))
    case, imported = bring(bars.abaqus(acts=acts), ".inp")
    (load,) = case.problem.loads
    assert isinstance(load, Traction)
    gradient = np.zeros((3, 3))
    gradient[0, 2], gradient[1, 1] = 1e5, 1e5
    ours = Traction(load.facets, (1e3, 0.0, 0.0), gradient=gradient)
    points = case.problem.mesh.points[np.unique(load.facets)]
    assert np.abs(load.at(points) - ours.at(points)).max() < 1e-9 * 2e3
    assert bars.apart(bars.native(Material(100e3, 0.3), ours), case.problem) < 1e-10
    assert any("affine" in line for line in imported.notes)


def test_other_forces_on_nodes_stay_and_leave_no_truth(bring):
    end = np.unique(bars.pulled(bars.bar()))[[0, 3, 5]]
    acts = "*CLOAD\n" + "\n".join(
        f"{n + 1}, 3, {f}" for n, f in zip(end, (2e-2, 2e-2, 1e-2), strict=True)
    )
    case, imported = bring(bars.abaqus(acts=acts), ".inp")
    assert all(isinstance(load, PointForce) for load in case.problem.loads)
    forces = np.array([[0.0, 0.0, 2e-2], [0.0, 0.0, 2e-2], [0.0, 0.0, 1e-2]])
    problem = bars.native(Material(100e3, 0.3), PointForce(end, forces))
    assert bars.apart(problem, case.problem) < 1e-10
    assert any("no truth is possible" in line for line in imported.notes)
    assert all(check.against != "truth" for check in case.checks)


def test_one_perturbed_force_is_no_traction(bring):
    acts = cload(lambda _x, _y, _z: (2e-3, 0.0, 0.0))
    last = acts.rpartition(", ")
    perturbed = f"{last[0]}, {float(last[2]) * (1.0 + 1e-5)!r}"
    case, _ = bring(bars.abaqus(acts=perturbed), ".inp")
    assert all(isinstance(load, PointForce) for load in case.problem.loads)


def test_quadratic_cells_and_consistent_forces_on_middle_nodes(bring):
    mesh = bars.bar()
    points, cells = bars.quadratic(mesh)
    forces = np.zeros(len(points))
    middle_of = {
        (min(a, b), max(a, b)): cell[4 + k]
        for cell in cells
        for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)))
        for a, b in [(cell[i], cell[j])]
    }
    for facet in bars.pulled(mesh).tolist():
        corners = mesh.points[facet]
        area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2.0
        for a, b in ((0, 1), (1, 2), (2, 0)):
            pair = sorted((facet[a], facet[b]))
            forces[middle_of[pair[0], pair[1]]] += area / 3.0 * 2e-3
    acts = "*CLOAD\n" + "\n".join(f"{n + 1}, 1, {f!r}" for n, f in enumerate(forces.tolist()) if f)
    ends = sorted({n for row in bars.fixed_end(mesh).tolist() for n in row})
    on_face = [n for n, p in enumerate(points) if p[0] == 0.0]
    assert set(ends) < set(on_face)
    text = bars.abaqus(acts=acts, points=points, cells=cells)
    before = "*NSET, NSET=FACE\n" + bars.rows(n + 1 for n in on_face) + "\n*BOUNDARY\nFACE, 1, 3"
    case, imported = bring(text.replace("*BOUNDARY\nHELD, 1, 3", before), ".inp")
    problem = bars.native(Material(100e3, 0.3), Traction(bars.pulled(mesh), (2e3, 0.0, 0.0)))
    assert bars.apart(problem, case.problem) < 1e-10
    assert any("96 quadratic tetrahedra" in line for line in imported.notes)
    alone = before.replace("*BOUNDARY\n", f"*BOUNDARY\n{cells[0][9] + 1}, 1, 1\n")
    with pytest.raises(ImportRefusedError, match="middle node"):
        bring(text.replace("*BOUNDARY\nHELD, 1, 3", alone), ".inp")
    with pytest.raises(ImportRefusedError, match="is a middle node, which a case does not have"):
        bring(
            bars.abaqus(
                mesh,
                acts=acts + f"\n{cells[0][4] + 1}, 2, 1.",
                points=points,
                cells=cells,
            ),
            ".inp",
        )


def test_includes_parts_amplitudes_and_sets(bring, tmp_path):
    text = bars.abaqus(material="*INCLUDE, INPUT=tissue.inc",
        before="*AMPLITUDE, NAME=RAMP\n0., 0., 2., 1.\n*NSET, NSET=Both, GENERATE\n1, 3\n"
        "*NSET, NSET=BOTH\nHELD, 4",
        acts="*BOUNDARY, AMPLITUDE=RAMP\nPART-1-1.END, 3, 3, 4.",
    )  # fmt: skip
    (tmp_path / "tissue.inc").write_text("*ELASTIC\n1.D-1, 0.3\n")
    text = text.replace("*NODE,", "*PART, NAME=P\n*NODE,", 1).replace(
        "*MATERIAL", "*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=PART-1-1, PART=P\n"
        "*END INSTANCE\n*END ASSEMBLY\n*MATERIAL",
    )  # fmt: skip
    case, _ = bring(text, ".inp")
    end = bars.pulled(bars.bar())
    moved = Support(np.unique(end), end, (False, False, True), (0.0, 0.0, 2e-3))
    assert bars.apart(bars.native(Material(100e3, 0.3), more=(moved,)), case.problem) < 1e-10


@simulators.needs_ccx
@pytest.mark.parametrize(
    ("material", "step", "acts"),
    [
        ("*ELASTIC\n0.1, 0.3", "*STEP", "*DSLOAD\nENDFACE, P, -2e-3"),
        ("*ELASTIC\n0.1, 0.3", "*STEP, NLGEOM, INC=200", "*DSLOAD\nENDFACE, P, -4e-3"),
        (
            NEO_HOOKE, "*STEP, NLGEOM, INC=100",
            "*BOUNDARY\nEND, 3, 3, 8.\n*DLOAD\nALL, GRAV, 9810., 0., 3., -4.",
        ),
        (MOONEY, "*STEP, NLGEOM, INC=100", "*CLOAD\n45, 3, 2e-2\n44, 1, 0.05"),
        ("*DENSITY\n1e-9\n*ELASTIC\n0.1, 0.3", "*STEP, NLGEOM, INC=100", "*DLOAD\nALL, BX, 4e-5"),
    ],
)  # fmt: skip
def test_calculix_solves_its_own_file_the_same(bring, tmp_path, material, step, acts):
    text = bars.abaqus(material=material, step=step, acts=acts)
    text = text.replace("0.25, 1.\n", "0.01, 1., 0.001, 0.01\n")
    case, _ = bring(text, ".inp")
    assert simulators.agree_with_ccx(tmp_path, text, case, 1e-3)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("TYPE=C3D4", "TYPE=C3D20", r"model\.inp:50: \*ELEMENT, TYPE=C3D20: a case has tetrahedra"),
        ("*ELASTIC", "*ELASTIC, TYPE=ORTHO", "isotropic"),
        ("*ELASTIC", "*EXPANSION\n1e-5\n*ELASTIC", r"\*EXPANSION is not known here"),
        ("0.1, 0.3", "0.1, 0.3, 20.\n0.2, 0.3, 40.", "by temperature"),
        ("*ELASTIC\n0.1, 0.3", "*HYPERELASTIC, OGDEN\n1., 2., 3.", r"\*HYPERELASTIC, OGDEN"),
        ("*ELASTIC\n0.1, 0.3", "*HYPERELASTIC, NEO HOOKE\n1., 0.", "D1 = 0"),
        ("*SOLID SECTION, ELSET=ALL", "*SOLID SECTION, ELSET=SOME", "no set 'SOME'"),
        ("*BOUNDARY", "*TRANSFORM, NSET=HELD\n1,0,0,0,1,0\n*BOUNDARY", r"TRANSFORM is not known"),
        ("*BOUNDARY", "*EQUATION\n2\n1,1,1.,2,1,-1.\n*BOUNDARY", r"\*EQUATION is not known"),
        ("*CLOAD\n45, 3, 1e-4", "*BOUNDARY\n1, 1, 1, 0.5", "along x by 0.5 that HELD .line"),
        ("HELD, 1, 3", "HELD, 1, 11", "solids have 1 to 3"),
        ("HELD, 1, 3", "NOBODY, 1, 3", "no set 'NOBODY'"),
        ("HELD, 1, 3", "HELD, 1", "with what|not held enough"),
        ("*STATIC", "*DYNAMIC", r"\*DYNAMIC is not known"),
        ("*STATIC", "*STATIC, STABILIZE", "parameter STABILIZE is not known"),
        ("*STEP, NLGEOM", "*STEP, PERTURBATION", "parameter PERTURBATION"),
        ("*END STEP", "*END STEP\n*STEP\n*STATIC\n*END STEP", "a second step"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD\n45, 3, 1e-4\n45, 3, 1e-4", "give the sum once"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD\n45, 4, 1e-4", "degree of freedom 4"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD\n99, 3, 1e-4", "no node 99"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD\n45, 3, much", "'much' is no number"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD, FOLLOWER\n45, 3, 1", "parameter FOLLOWER"),
        ("*CLOAD\n45, 3, 1e-4", "*CLOAD, AMPLITUDE=A\n45, 3, 1", r"no \*AMPLITUDE A"),
        ("*CLOAD\n45, 3, 1e-4", "*DLOAD\nALL, CENTRIF, 1., 0.", "'CENTRIF'"),
        ("*CLOAD\n45, 3, 1e-4", "*DLOAD\nALL, GRAV, 9.81, 0., 0., -1.", "no density"),
        ("*CLOAD\n45, 3, 1e-4", "*DLOAD\n1, GRAV, 9.81, 0., 0., -1.", "weight of a part"),
        ("*CLOAD\n45, 3, 1e-4", "*DLOAD\nALL, P2, 1.", "none of the body's boundary"),
        ("*CLOAD\n45, 3, 1e-4", "*DSLOAD\nENDFACE, TRVEC, 1., 0., 0., 1.", "field"),
        ("*CLOAD\n45, 3, 1e-4", "*DSLOAD\nENDFACE, P, 1.\nENDFACE, P, 1.", "give the sum once"),
        ("*NODE, NSET", "*NODE, SYSTEM=C, NSET", "coordinates in another system"),
        ("*HEADING", "*INCLUDE, INPUT=../secret\n*HEADING", "outside the case's folder"),
        ("*HEADING", "*INCLUDE, INPUT=model.inp\n*HEADING", "without end"),
        ("*HEADING", "1, 2, 3\n*HEADING", "data before any keyword"),
        ("*END STEP", "*CONTACT PAIR\n*END STEP", r"\*CONTACT PAIR is not known"),
    ],
)  # fmt: skip
def test_what_a_case_cannot_say_is_refused(bring, tmp_path, old, new, says):
    text = bars.abaqus()
    assert old in text
    with pytest.raises(InputError, match=says):
        bring(text.replace(old, new, 1), ".inp")
    assert [path.name for path in tmp_path.iterdir()] == ["model.inp"]


def test_coordinates_that_are_left_out_are_zero(bring):
    text = bars.abaqus()
    first = "\n1, 0.0, 0.0, 0.0\n"
    assert first in text
    for shorter in ("\n1\n", "\n1, , 0.0,\n"):
        case, _ = bring(text.replace(first, shorter), ".inp")
        assert case.problem.mesh.points[0].tolist() == [0.0, 0.0, 0.0]


def test_units_are_asked_for(tmp_path):
    (tmp_path / "model.inp").write_text(bars.abaqus())
    with pytest.raises(InputError, match=r"give --units, one of m-N-Pa \(40 m long, .* mm-N-MPa"):
        import_model(tmp_path / "model.inp", tmp_path / "case.toml")
    with pytest.raises(InputError, match="unknown kind of model"):
        import_model(tmp_path / "model.odb", tmp_path / "case.toml")


@pytest.mark.parametrize("system", UnitSystem)
def test_each_system_of_units_is_the_same_body(bring, system):
    length, force, _ = system.split("-")
    metre, newton = {"m": 1.0, "mm": 1e3}[length], {"N": 1.0, "mN": 1e3, "kN": 1e-3}[force]
    mesh = bars.bar()
    scaled = TetMesh(1e-3 * metre * mesh.points, mesh.cells)
    material = (
        f"*DENSITY\n{1000.0 * newton / metre**4!r}\n*ELASTIC\n{1e5 * newton / metre**2!r}, 0.3"
    )
    acts = f"*DLOAD\n, GRAV, {9.81 * metre!r}, 0., 0., -1.\n*DSLOAD\n"
    acts += f"ENDFACE, P, {-1e3 * newton / metre**2!r}"
    text = bars.abaqus(mesh, material=material, acts=acts, points=scaled.points)
    case, _ = bring(text, ".inp", system)
    loads = BodyForce((0.0, 0.0, -9810.0)), Pressure(bars.pulled(mesh), -1e3)
    assert bars.apart(bars.native(Material(1e5, 0.3), *loads), case.problem) < 1e-10
