"""FEBio and SOFA, which no package index has: their files are read by stand-ins on the path."""

import dataclasses
import json
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import programs_of_others
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import CannotPoseError, OutsideSimulator
from palpate.validation.case import load_case
from palpate.validation.peers import adapters
from palpate.validation.peers.registry import read_peers
from palpate.validation.states import CandidateFailedError, in_silence

FOLDER = Path(adapters.__file__).parent
PROGRAMS = {"febio": "febio4", "sofa": "runSofa"}
MESH = brick_box((3, 2, 2), (0.3, 0.2, 0.2), ragged=0.15)
FACE, END = side(MESH, 0, 0.0), side(MESH, 0, 0.3)
# A pull, a weight, and an end of which one component is moved, one fixed and one free.
BODY = Problem(
    MESH,
    Material(2e4, 0.3, 1000.0),
    (support_of(FACE), support_of(END, (True, True, False), (0.02, 0.0, 0.0))),
    (Traction(END, (0.0, 0.0, -20.0)), BodyForce((30.0, 0.0, -300.0))),
)
# What they print has twelve digits, or all.
LIMIT = 1e-9


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Both programs stand on the path."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in PROGRAMS.values():
        programs_of_others.install(folder, name)
    monkeypatch.setenv("PATH", str(folder), prepend=":")


def apart(problem, script, strain=Strain.GREEN):
    """The largest distance from fastsim's result, over the largest displacement; what it says."""
    command = f"{sys.executable} {script} {{case}} {{result}}"
    found = outside_candidate(OutsideSimulator(command, 120.0)).solve(problem, strain, in_silence)
    expected = solve_static(problem, strain=strain).displacement
    return np.abs(found.displacement - expected).max() / np.abs(expected).max(), found.says


@pytest.mark.parametrize(
    ("name", "law", "strain"),
    [
        ("febio", Law.SAINT_VENANT_KIRCHHOFF, Strain.GREEN),
        ("febio", Law.NEO_HOOKEAN, Strain.GREEN),
        ("sofa", Law.SAINT_VENANT_KIRCHHOFF, Strain.GREEN),
        ("sofa", Law.NEO_HOOKEAN, Strain.GREEN),
        ("sofa", Law.NEO_HOOKEAN_STABLE, Strain.GREEN),
        ("sofa", Law.SAINT_VENANT_KIRCHHOFF, Strain.LINEAR),
    ],
)
@pytest.mark.usefixtures("path")
def test_what_the_program_reads_is_the_case(name, law, strain):
    posed = dataclasses.replace(BODY, material=dataclasses.replace(BODY.material, law=law))
    distance, says = apart(posed, FOLDER / f"{name}.py", strain)
    assert distance <= LIMIT
    assert says["version"] == {"febio": "4.9.0", "sofa": "26.06"}[name]
    assert says.get("newton_iterations") == (12 if name == "febio" else None)


SPOILED = [
    ("febio", "{_numbers(force)}", "{_numbers(0.5 * force)}", "half the load"),
    ("febio", "<E>{E!r}", "<E>{1e-3 * E!r}", "kilopascals"),
    ("febio", "<v>{nu!r}", "<v>{0.9 * nu!r}", "another Poisson's ratio"),
    ("febio", "map(_numbers, points)", "map(_numbers, 1e3 * points)", "millimetres"),
    ("febio", "int(row[0])", "-int(row[0])", "the last point first"),
    ("febio", "map(str, nodes + 1)", "map(str, len(points) - nodes)", "nodes the other way round"),
    ("febio", "<pt>1,1</pt>", "<pt>1,0.5</pt>", "half of everything"),
    ("febio", '"isotropic elastic"', '"neo-Hookean"', "another law"),
    ("febio", "fixed & (moved == 0.0)", "fixed.all(axis=1)[:, None] & fixed", "a component free"),
    ("sofa", 'part * BODY["external_force"]', 'BODY["external_force"] / 2', "half the load"),
    ("sofa", "{mu!r} {lmbda!r}", "{lmbda!r} {mu!r}", "constants in the other order"),
    ("sofa", '"position"] -', '"position"][::-1] -', "the last point first"),
    ("sofa", 'BODY["prescribed_displacement"])', "0.0)", "supports that stay"),
    ("sofa", "not pattern.all()", "not pattern.any()", "all components fixed"),
    ("sofa", '"StVenantKirchhoff"', '"NeoHookean"', "another law"),
]


@pytest.mark.parametrize(("name", "old", "new", "what"), SPOILED, ids=[s[-1] for s in SPOILED])
@pytest.mark.usefixtures("path")
def test_a_perturbed_adapter_is_found(tmp_path, name, old, new, what):
    for file in ("harness.py", f"{name}.py"):
        shutil.copy(FOLDER / file, tmp_path)
    script = tmp_path / f"{name}.py"
    text = script.read_text("utf-8")
    assert old in text
    script.write_text(text.replace(old, new), encoding="utf-8")
    distance, _ = apart(BODY, script)
    assert distance > 1e-3, what


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("is_perturbed", [False, True])
@pytest.mark.usefixtures("path")
def test_from_the_gate_to_the_verdict(tmp_path, palpate_run, name, is_perturbed):
    script = FOLDER / f"{name}.py"
    if is_perturbed:
        shutil.copy(FOLDER / "harness.py", tmp_path)
        text = script.read_text("utf-8")
        script = tmp_path / script.name
        perturbed = text.replace("<v>{nu!r}", "<v>{0.9 * nu!r}")
        perturbed = perturbed.replace("{mu!r} {lmbda!r}", "{mu!r} {0.7 * lmbda!r}")
        script.write_text(perturbed, encoding="utf-8")
    command = f"{sys.executable} {script} {{case}} {{result}}"
    done = palpate_run("gate", "stretch", "--simulator", command)
    assert done.returncode == (1 if is_perturbed else 0), done.stdout + done.stderr
    assert ("Poisson's ratio" in done.stdout) == is_perturbed


@pytest.mark.usefixtures("path")
def test_what_they_cannot_be_asked_is_refused_with_the_reason():
    def why(name, problem, strain=Strain.GREEN):
        with pytest.raises(CannotPoseError) as error:
            apart(problem, FOLDER / f"{name}.py", strain)
        return str(error.value)

    assert "no solid of small strain" in why("febio", BODY, Strain.LINEAR)
    stable = dataclasses.replace(BODY.material, law=Law.NEO_HOOKEAN_STABLE)
    assert "law neo-hookean-stable" in why("febio", dataclasses.replace(BODY, material=stable))
    thin = dataclasses.replace(BODY, material=Material(2e4, -0.2, 1000.0))
    assert "Poisson's ratio below 0" in why("sofa", thin, Strain.LINEAR)
    press = load_case("press").problem
    for name in PROGRAMS:
        assert "tools: not handed to this simulator" in why(name, press)


@pytest.mark.parametrize(("name", "program"), PROGRAMS.items())
def test_without_the_program_the_case_is_not_posed(tmp_path, monkeypatch, name, program):
    monkeypatch.setenv("PATH", str(tmp_path))
    command = f"{sys.executable} {FOLDER / name}.py {{case}} {{result}}"
    with pytest.raises(CannotPoseError, match=f"{program} is not on the path; it comes from"):
        OutsideSimulator(command, 60.0).run(BODY, Strain.GREEN, in_silence)
    (peer,) = (peer for peer in read_peers() if peer.adapter == name)
    assert peer.command_line() is None
    assert "not run here" in peer.why_missing()


# Two steps of a node record, as FEBio's manual has them ("Logfile": step, time and data, then the
# number of the item and its values), cut in the middle of the second.
RECORD = """*Step  = 1
*Time  = 0.5
*Data  = ux;uy;uz
1,0,0,0
2,0.000123456789012,-1.5e-05,0
3,0.1,0.2,0.3
*Step  = 2
*Time  = 1
*Data  = ux;uy;uz
1,0,0,0
3,0.2,0.4,0.6
2,0.000246913578024,-3e-05,0
"""


def test_a_record_is_read_by_numbers_and_only_at_the_end(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import febio  # a program of its own, with files beside it

    found = febio.last_record(RECORD, 3)
    assert found.tolist() == [[0, 0, 0], [0.000246913578024, -3e-05, 0], [0.2, 0.4, 0.6]]
    assert febio.last_record(RECORD[: RECORD.rindex("*Step")], 3) is None
    assert febio.last_record(RECORD[: RECORD.rindex("2,0")], 3) is None
    assert febio.last_record("", 3) is None


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("ending", ["half the load", "a crash"])
@pytest.mark.usefixtures("path")
def test_a_run_that_does_not_reach_the_load_is_no_result(tmp_path, monkeypatch, name, ending):
    broken = tmp_path / "broken"
    broken.mkdir()
    program = broken / PROGRAMS[name]
    real = (tmp_path / "bin" / PROGRAMS[name]).read_text("utf-8")
    if ending == "a crash":
        real = real.replace("; programs_of_others.", "; sys.exit(3); programs_of_others.")
    else:
        # FEBio ends with an error in its last step; SOFA's Newton iteration does not converge.
        real = real.replace(
            "; programs_of_others.",
            "; Path = programs_of_others.Path; write = Path.write_text"
            "; Path.write_text = lambda p, t, **k: write(p, t.replace('N O R M', 'E R R'), **k)"
            "; solve = programs_of_others._equilibrium"
            "; programs_of_others._equilibrium = lambda body: (solve(body), setattr("
            "body.find('NewtonRaphsonSolver')[0].status, 'value', 'DivergedMaxIterations'))"
            "; programs_of_others.",
        )
    program.write_text(real, encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(broken), prepend=":")
    says = {"febio": "before the full load", "sofa": "wrote no positions"}[name]
    with pytest.raises(CandidateFailedError, match=says):
        apart(BODY, FOLDER / f"{name}.py")


def test_the_model_and_the_scene_have_what_their_manuals_ask_for(monkeypatch):
    """By FEBio's user manual 4, chapter 3, and by SofaPython3's documentation of scenes."""
    monkeypatch.syspath_prepend(str(FOLDER))
    import febio

    from palpate.validation.exchange.nodal_arrays import rest_arrays

    job = rest_arrays(BODY) | {"strain": "green", "law": "saint-venant-kirchhoff"}
    root = ET.fromstring(febio.model_file(job))
    assert root.get("version") == "4.0"
    control = root.find("Control")
    assert control.findtext("analysis") == "STATIC"
    assert float(control.findtext("time_steps")) * float(control.findtext("step_size")) == 1.0
    # Full Newton: no updates between factorizations.
    assert control.findtext("solver/qn_method/max_ups") == "0"
    assert float(root.findtext("Material/material/E")) == 2e4
    assert [n.get("id") for n in root.findall("Mesh/Nodes/node")][:2] == ["1", "2"]
    names = {s.get("name") for s in root.findall("Mesh/NodeSet")}
    used = [b.get("node_set") for b in (*root.find("Boundary"), *root.find("Loads"))]
    assert sorted(used) == sorted(names)
    total = sum(
        len(s.text.split(",")) * np.array(list(map(float, n.findtext("value").split(","))))
        for n in root.find("Loads")
        for s in root.findall("Mesh/NodeSet")
        if s.get("name") == n.get("node_set")
    )
    np.testing.assert_allclose(total, job["external_force"].sum(axis=0), rtol=1e-12)
    done = subprocess.run(
        [sys.executable, "-c", "import sofa; print(sofa._SCENE)"],
        cwd=FOLDER, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "def createScene(root):" in done.stdout


@pytest.mark.usefixtures("path")
def test_the_result_says_what_made_it():
    command = f"{sys.executable} {FOLDER / 'sofa.py'} {{case}} {{result}}"
    result, _ = OutsideSimulator(command, 60.0).run(BODY, Strain.GREEN, in_silence)
    about = json.loads(json.dumps(dict(result.about)))
    assert about["tool"] == "SOFA"
    assert about["law"] == "Saint-Venant-Kirchhoff"
    assert "StaticSolver" in about["method"]
