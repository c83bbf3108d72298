"""`palpate law`: what is right passes, what is seeded is seen and named, simulators by one cell."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.meshes.material_law import Law
from palpate.validation.cli import app
from palpate.validation.diagnosis.law_checks import (
    asked_of_simulators,
    check_law,
    compare_stress,
    moduli_of,
    self_test,
    stated_stress,
)
from palpate.validation.diagnosis.law_simulators import (
    FastsimLaw,
    ReferenceLaw,
    deformations,
    displacements,
    example_material,
    nodal_forces,
    rotations,
    stress_of_forces,
)
from palpate.validation.metrics.laws import finite_stress

LAWS = pytest.mark.parametrize("law", list(Law))

# Solves by fastsim, with the law that it is told or with another one.
SIMULATOR = """
import json, sys
from pathlib import Path
import numpy as np
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh
case, result, law = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
rest = np.load(case / "rest.npz")
of = json.loads((case / "case.json").read_text())["material"]
of = Material(**{**of, **({"law": law} if law != "asked" else {})})
mesh, fixed = TetMesh(rest["points"], rest["cells"]), rest["fixed"].astype(bool)
held = tuple(
    Support(np.flatnonzero((fixed == kind).all(axis=1)), components=tuple(kind.tolist()))
    for kind in np.unique(fixed[fixed.any(axis=1)], axis=0)
)
load = PointForce(np.arange(mesh.num_points), rest["external_force"])
u = solve_static(Problem(mesh, of, held, (load,))).displacement
sent = {}
if len(sys.argv) > 4:  # Cauchy stresses, so many times the law's
    from palpate.validation.diagnosis.law_checks import stated_stress
    x, X = (mesh.points + u)[mesh.cells], mesh.points[mesh.cells]
    edges = lambda a: (a[:, 1:] - a[:, :1]).transpose(0, 2, 1)
    F = edges(x) @ np.linalg.inv(edges(X))
    sigma = stated_stress(of, F) @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
    sent = {"cauchy_stress": float(sys.argv[4]) * sigma}
np.savez(result, displacement=u, **sent)
"""


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["law", *words])
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.stdout


def test_deformations_are_what_they_are_called():
    found = deformations(Law.NEO_HOOKEAN)
    J = np.linalg.det(found["random"])
    assert (J.min(), J.max()) == (pytest.approx(0.3), pytest.approx(3.0))
    assert np.linalg.svd(found["near-degenerate"], compute_uv=False).min() < 0.05
    assert "inverted" not in found
    assert (np.linalg.det(deformations(Law.NEO_HOOKEAN_STABLE)["inverted"]) < 0.0).all()
    Q = rotations(5)
    assert np.abs(Q @ Q.transpose(0, 2, 1) - np.eye(3)).max() < 1e-14
    assert np.linalg.det(Q) == pytest.approx(np.ones(5))


def test_stress_comes_back_from_the_forces_that_it_makes():
    P = np.random.default_rng(1).standard_normal((4, 3, 3))
    assert np.abs(stress_of_forces(nodal_forces(P, 1.0)) - P).max() < 1e-14
    assert displacements(np.eye(3)[None]).tolist() == np.zeros((4, 3)).tolist()


@LAWS
def test_fastsims_laws_pass(law):
    findings = check_law(FastsimLaw(example_material(law)), example_material(law))
    assert [f for f in findings if not f.is_good] == []
    assert {f.check for f in findings} == {
        "rest", "Hooke's law", "P = dW/dF", "tangent = dP/dF", "symmetry", "objectivity",
        "isotropy", "law as stated",
    }  # fmt: skip


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    "law",
    [pytest.param(law, marks=() if law is Law.MOONEY_RIVLIN else pytest.mark.slow) for law in Law],
)
@pytest.mark.once
def test_the_references_laws_pass(law):
    findings = check_law(ReferenceLaw(example_material(law)), example_material(law))
    assert [f for f in findings if not f.is_good] == []


@LAWS
def test_every_seeded_mistake_is_seen_by_its_own_check(law):
    caught = self_test(FastsimLaw(example_material(law)), example_material(law))
    assert len(caught) == 8
    assert [name for name, findings in caught.items() if not findings] == []
    (softer,) = (found for name, found in caught.items() if name.startswith("shear modulus"))
    assert {f.message for f in softer} >= {
        "the stress is that of the stated law with lmbda times 1 and mu times 1.01"
    }


@LAWS
def test_another_law_is_named(law):
    asked = example_material(law)
    for other in Law:
        # Ogden's has constants of its own, which no other has.
        if other in (law, Law.OGDEN):
            continue
        F = deformations(law)["random"]
        P = finite_stress(other, F - np.eye(3), *moduli_of(asked, len(F)))
        finding = compare_stress(P, asked, "random", F, 1e-10)
        # Without c01 Mooney and Rivlin's is the isochoric one, which goes by its own name.
        same = {Law.MOONEY_RIVLIN: Law.NEO_HOOKEAN_ISOCHORIC} if not asked.c01 else {}
        named = same.get(other, other)
        assert finding.is_good == (named is law)
        if named is not law:
            assert finding.message == f"the stress is that of {named}"


def test_a_law_that_is_no_number_fails():
    asked = example_material(Law.NEO_HOOKEAN)
    F = deformations(asked.law)["random"]
    finding = compare_stress(np.full_like(F, np.nan), asked, "random", F, 1e-10)
    assert not finding.is_good
    assert finding.message == "the stress is no finite number"


def test_the_command_ends_by_what_it_found(tmp_path):
    code, said = run("mooney-rivlin", "--json", str(tmp_path / "law.json"))
    assert (code, said.count(" passed"), "FAILED" in said) == (0, 38, False)
    found = json.loads((tmp_path / "law.json").read_text(encoding="utf-8"))
    assert {row["verdict"] for row in found["findings"]} == {"passed"}
    code, said = run("neo-hookean", "--self-test")
    assert (code, said.count("seen by")) == (0, 8)
    for words in (
        ["rubber"],
        ["neo-hookean", "--poissons-ratio", "0.5"],
        ["neo-hookean", "--with", "nobody"],
        ["neo-hookean", "--limit", "0"],
        ["neo-hookean", "--self-test", "--simulator", "x {case} {result}"],
    ):
        done = CliRunner().invoke(app, ["law", *words])
        assert done.exit_code != 0
        assert done.stdout == ""


@pytest.mark.parametrize(
    ("solves", "says"),
    [("asked", ""), ("neo-hookean-stable", "the stress is that of neo-hookean-stable")],
)
def test_a_simulators_law_is_known_by_where_its_cells_come_to_rest(tmp_path, solves, says):
    program = tmp_path / "simulator.py"
    program.write_text(SIMULATOR, encoding="utf-8")
    command = f"{sys.executable} {program} {{case}} {{result}} {solves}"
    code, said = run("neo-hookean", "--simulator", command)
    assert code == (1 if says else 0)
    # In simple shear, which keeps its volume, the two laws are one.
    assert said.count("FAILED\n") == (5 if says else 0)
    assert said.count(f"failed: law as stated, random: {says}") == (1 if says else 0)
    last = said.splitlines()[-1]
    assert last == (f"FAILED: 5 of 6 checks; {says}" if says else "passed: 6 checks")
    assert "no cell came to rest inside out\n" in said
    assert ("at number 1, 2 of the kind" in said) is bool(says)


@LAWS
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_sheet_in_plane_stress_has_free_faces(law, nu):
    material = example_material(law, nu)
    F, kinds, *_ = asked_of_simulators(material)
    sheets = F[kinds == "plane stress"]
    assert np.abs(stated_stress(material, sheets)[:, 2]).max() < 1e-12 * material.youngs_modulus
    # To first order a sheet becomes thinner by nu / (1 - nu) times what it is stretched by.
    small = np.eye(3) + 1e-6 * np.diag([1.0, 1.0, -2.0 * nu / (1.0 - nu)])
    assert np.abs(stated_stress(material, small[None])[0, 2, 2]) < 1e-10 * material.youngs_modulus
    assert (np.linalg.det(sheets) > 0.5).all()


def test_what_is_inside_out_and_what_is_left_out_is_said(tmp_path):
    # The last corner of the first cell ends below the others: this law has a stress there.
    program, file = tmp_path / "simulator.py", tmp_path / "found.json"
    perturbed = "u[3] = (0.0, 0.0, -0.03)\nsent = {}"
    program.write_text(SIMULATOR.replace("sent = {}", perturbed, 1), encoding="utf-8")
    command = f"{sys.executable} {program} {{case}} {{result}} asked"
    code, said = run("neo-hookean-stable", "--simulator", command, "--json", str(file))
    assert code == 1
    assert "inverted: uniaxial 1: came to rest inside out (det F < 0)\n" in said
    assert "left out: uniaxial 3, biaxial 2: a free cell of this material does not stay" in said
    assert "  at number 1 of the kind; the worst F = " in said
    found = json.loads(file.read_text("utf-8"))
    (wrong,) = (of for of in found["findings"] if of["verdict"] == "failed")
    assert (wrong["kind"], wrong["failed"], wrong["inverted"]) == ("uniaxial", [1], [1])
    assert len(found["remarks"]) == 2
    assert "inverted cells: not asked" in run("neo-hookean")[1]
    assert "inverted cells" not in run("neo-hookean-stable")[1]


@pytest.mark.parametrize(("factor", "code"), [("1", 0), ("1.5", 1)])
def test_stresses_that_a_simulator_sends_are_compared_as_well(tmp_path, factor, code):
    program = tmp_path / "simulator.py"
    program.write_text(SIMULATOR, encoding="utf-8")
    command = f"{sys.executable} {program} {{case}} {{result}} asked {factor}"
    found, said = run("neo-hookean", "--simulator", command)
    assert found == code
    assert said.count("stress sent") > 0
    assert ("FAILED" in said) is (code == 1)


# Sends nothing for all cells together, nor for single ones that come to rest far off.
SPOILING = """
u = u.reshape(-1, 4, 3)
if (len(u) > 1 or abs(u[0, 3, 2]) > float(sys.argv[4])):
    sys.exit("no equilibrium")
u = u.reshape(-1, 3)
"""


def test_a_cell_without_a_result_is_one_failed_deformation(tmp_path):
    program = tmp_path / "simulator.py"
    lines = SIMULATOR.split("sent = {}")
    program.write_text(f"{lines[0]}{SPOILING}np.savez(result, displacement=u)\n", encoding="utf-8")
    command = f"{sys.executable} {program} {{case}} {{result}} asked 2.5e-3"
    code, said = run("neo-hookean", "--simulator", command)
    assert code == 1
    assert "no equilibrium" in said
    failed = [line for line in said.splitlines() if line.startswith("failed: ")]
    assert len(failed) == said.count("FAILED\n") >= 1
    assert f"FAILED: {len(failed)} of " in said.splitlines()[-1]
    assert "passed" in said


@pytest.mark.parametrize(
    ("height", "became"),
    [("0.0", "flat or inside out"), ("-1.0", "flat or inside out"), ("1e200", "blown up")],
)
def test_a_cell_that_has_no_stress_is_a_finding_and_no_internal_error(tmp_path, height, became):
    # The last corner of the first cell, at rest at z = 0.02 m, ends at so many times that height.
    program, file = tmp_path / "simulator.py", tmp_path / "found.json"
    perturbed = f"u[3] = (0.0, 0.0, 0.02 * ({height}) - 0.02)\nsent = {{}}"
    program.write_text(SIMULATOR.replace("sent = {}", perturbed, 1), encoding="utf-8")
    command = f"{sys.executable} {program} {{case}} {{result}} asked"
    code, said = run("neo-hookean", "--simulator", command, "--json", str(file))
    assert code == 1
    assert became in said
    verdicts = [of["verdict"] for of in json.loads(file.read_text("utf-8"))["findings"]]
    assert verdicts.count("failed") == 1
