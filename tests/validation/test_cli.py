"""Exit codes and messages of the command line, from another folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.meshes.files import read_mesh, read_result_arrays, write_surface
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Strain
from palpate.meshes.tri_surface import TriSurface
from palpate.reference.availability import is_available
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.candidates.fastsim import run_fastsim
from palpate.validation.candidates.faults import Fault
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.judging.error_budget import case_budgets
from palpate.validation.judging.judge import judge_case
from palpate.validation.report.tables import state_table
from palpate.validation.states import ExitCode, Verdict, in_silence
from palpate.validation.studies import STUDIES
from palpate.validation.versions import extras, version_of

Write = Callable[..., Path]
Run = Callable[..., subprocess.CompletedProcess[str]]


def test_cases_lists_what_there_is(palpate_run: Run) -> None:
    done = palpate_run("cases")
    assert done.returncode == 0
    assert [line.split()[0] for line in done.stdout.splitlines()] == builtin_cases()


@pytest.mark.parametrize(
    "arguments",
    [["gate"], ["gate", "nothing"], ["gate", "x.toml"], ["solve", "beam"], ["nonsense"],
     ["study", "moon", "-o", "m"], ["mesh", "none.stl", "-o", "m.vtu"],
     ["gate", "beam", "--fault", "x"]],
)  # fmt: skip
def test_usage_errors_are_two_with_a_short_message(
    palpate_run: Run, tmp_path: Path, arguments: list[str]
) -> None:
    done = palpate_run(*arguments, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert 1 <= len(done.stderr.strip().splitlines()) <= 3
    assert list(tmp_path.iterdir()) == []


def test_bad_cases_are_two_and_write_nothing(
    palpate_run: Run, write_case: Write, tmp_path: Path
) -> None:
    path = write_case(("poissons_ratio = 0.3", "poissons_ratio = 0.5"))
    for verb in (["gate", path], ["report", path, "-o", tmp_path / "out"]):
        done = palpate_run(*verb, folder=tmp_path)
        assert done.returncode == 2
        assert "poissons_ratio = 0.5" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["block.toml"]


def test_a_case_without_checks_judges_nothing_and_says_so(
    palpate_run: Run, write_case: Write
) -> None:
    text = write_case().read_text()
    path = write_case((text[text.index("[[check]]") :], ""))
    done = palpate_run("gate", path)
    assert done.returncode == 2
    assert "no [[check]]" in done.stderr


def test_a_case_that_collapses_is_a_failed_candidate(
    palpate_run: Run, write_case: Write, tmp_path: Path
) -> None:
    # Compressed far past the limit of Saint-Venant-Kirchhoff (P/E = -0.19245).
    path = write_case(("force = [60.0, 20.0, -10.0]", "force = [-900.0, 20.0, -10.0]"))
    done = palpate_run("solve", path, "-o", tmp_path / "u.vtu")
    assert done.returncode == 1
    assert "no equilibrium beyond" in done.stderr
    assert not (tmp_path / "u.vtu").exists()


def test_mesh_then_solve(palpate_run: Run, tmp_path: Path, write_case: Write) -> None:
    write_surface(tmp_path / "k.stl", shape_kidney(edge_length=12e-3))
    done = palpate_run("mesh", "k.stl", "-o", "k.vtu", "--unit", "m", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_mesh(tmp_path / "k.vtu").num_cells > 500
    path = write_case()
    done = palpate_run("solve", path.name, "-o", "u.vtu", "--strain", "linear", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    points, _, fields, _ = read_result_arrays(tmp_path / "u.vtu")
    assert fields["displacement"].shape == points.shape
    assert np.abs(fields["displacement"]).max() > 0.01


def test_mesh_keeps_to_a_time_and_says_what_decides_the_step(
    palpate_run: Run, tmp_path: Path
) -> None:
    write_surface(tmp_path / "k.stl", shape_kidney(edge_length=12e-3))
    command = ("mesh", "k.stl", "-o", "k.vtu", "--unit", "m")
    late = palpate_run(
        *command, "--size", "1e-3", "--uniform", "--time-limit", "0.02", folder=tmp_path
    )
    assert late.returncode == 2
    assert "within 0.02 s" in late.stderr
    assert not (tmp_path / "k.vtu").exists()
    tissue = ("--material", "1e4", "0.45", "1000")
    done = palpate_run(*command, *tissue, "--target-step", "1", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("  cell ") == 10
    assert "target step 1 s not reached" in done.stdout
    assert "forces at most" in done.stdout


def test_mesh_shows_what_it_finds_and_repairs_on_request(palpate_run: Run, tmp_path: Path) -> None:
    kidney = shape_kidney(edge_length=12e-3)
    write_surface(tmp_path / "torn.off", TriSurface(kidney.points, kidney.facets[3:, ::-1]))
    command = ("mesh", "torn.off", "-o", "k.vtu", "--unit", "m")
    refused = palpate_run(*command, folder=tmp_path)
    assert refused.returncode == 2
    assert "open" in refused.stderr
    repaired = palpate_run(*command, "--repair", folder=tmp_path)
    assert repaired.returncode == 0, repaired.stderr
    assert "closed by" in repaired.stderr
    assert "turned round" in repaired.stderr
    assert read_mesh(tmp_path / "k.vtu").volume == pytest.approx(kidney.volume, rel=1e-3)
    assert palpate_run(*command, "--largest-hole", 9, folder=tmp_path).returncode == 2
    small = palpate_run(*command, "--repair", "--largest-hole", 2, folder=tmp_path)
    assert small.returncode == 2
    assert "allow holes of" in small.stderr
    free = palpate_run(*command, "--repair", "--free", 1e-3, folder=tmp_path)
    assert free.returncode == 0, free.stderr
    assert "re-triangulated within" in free.stdout
    assert palpate_run(*command, "--repair", "--free", 0, folder=tmp_path).returncode == 2


def test_a_cap_is_a_group_of_the_mesh_that_a_case_can_press_on(
    palpate_run: Run, tmp_path: Path
) -> None:
    kidney = shape_kidney(edge_length=12e-3)
    is_top = kidney.points[kidney.facets].mean(axis=1)[:, 2] > 0.04
    write_surface(tmp_path / "cut.off", TriSurface(kidney.points, kidney.facets[~is_top]))
    for name, more in (("k.msh", ()), ("free.vtu", ("--free", 2e-3))):
        command = ("mesh", "cut.off", "-o", name, "--unit", "m", "--repair", *more)
        done = palpate_run(*command, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "cap 1" in done.stderr
        mesh = read_mesh(tmp_path / name)
        cap = mesh.facet_groups["cap 1"]
        centres = mesh.points[cap].mean(axis=1)
        assert len(cap) > 5
        assert centres[:, 2].min() > 0.02
        corners = mesh.points[cap]
        area = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        ).sum()
        # Of an oval of the cut's two widths.
        width = np.ptp(centres[:, :2], axis=0)
        assert area / 2 > np.pi / 4 * width.prod()


def test_mesh_graded_towards_a_point(palpate_run: Run, tmp_path: Path) -> None:
    command = ("mesh", "kidney", "-o", "k.vtu", "--size", 12)
    pole = ("--grade-to", 0, 0, 70, "--smallest", 1.5)
    done = palpate_run(*command, *pole, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    mesh = read_mesh(tmp_path / "k.vtu", scale=1e-3)
    corners = mesh.points[mesh.cells]
    longest = np.linalg.norm(corners[:, :1] - corners[:, 1:], axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    near = np.linalg.norm(middle - [0.0, 0.0, 0.07], axis=1) < 5e-3
    assert near.any()
    assert longest[near].max() < 4e-3 < longest.max()
    nan = ("--grade-to", 0, 0, "nan", "--smallest", 1.5)
    for bad in (pole[:4], nan, (*pole[:4], "--smallest", 0), (*pole, "--growth", -1)):
        refused = palpate_run(*command, *bad, folder=tmp_path)
        assert refused.returncode == 2
        assert "needs" in refused.stderr or "go together" in refused.stderr


def test_the_version_is_reported(palpate_run: Run) -> None:
    done = palpate_run("--version")
    assert done.returncode == 0
    first, core, python, fenicsx, *extras = done.stdout.splitlines()
    assert first == f"palpate {version_of('palpate')}"
    assert core.startswith(f"core {_core.__version__}, ")
    assert f"numpy {np.__version__}" in python
    assert ("not installed" in fenicsx) == (not is_available())
    assert all(line.startswith("extra ") for line in extras)


def test_an_extra_says_what_of_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = ["numpy>=1.24", "numpy>=2; extra == 'here'", 'no-such.thing; extra == "gone"']
    monkeypatch.setattr("importlib.metadata.requires", lambda _: wanted)
    assert extras() == {
        "here": f"numpy {np.__version__}",
        "gone": "no-such.thing not installed",
    }


def test_help_ends_with_the_exit_codes(palpate_run: Run) -> None:
    text = palpate_run("--help").stdout
    reported = [" ".join(line.split()) for line in text[text.index("Exit codes:") :].splitlines()]
    assert reported[1 : 1 + len(ExitCode)] == [f"{int(code)} {code.meaning}" for code in ExitCode]


def test_for_a_mistyped_fault_the_one_that_was_meant_is_named(palpate_run: Run) -> None:
    done = palpate_run("gate", "block", "--fault", "softr")
    assert done.returncode == 2
    assert "Value error" not in done.stderr
    assert "Did you mean 'softer'?" in done.stderr


def test_help_lists_every_study_and_every_fault_with_a_line(palpate_run: Run) -> None:
    for verb, listed in (
        ("gate", {fault.value: fault.meaning for fault in Fault}),
        ("study", STUDIES),
    ):
        lines = [" ".join(line.split()) for line in palpate_run(verb, "--help").stdout.splitlines()]
        assert listed
        for name, about in listed.items():
            assert f"{name} {about}" in lines


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("ga", {"gate"}),
        ("gate block", {"block", "block-fine", "block-motion"}),
        ("study k", {"kidney"}),
    ],
)
def test_the_shell_completes_verbs_cases_and_studies(typed: str, wanted: set[str]) -> None:
    code = "import sys; sys.argv = ['palpate']; from palpate.validation.cli import main; main()"
    asked = {
        "_PALPATE_COMPLETE": "complete_bash",
        "COMP_WORDS": f"palpate {typed}",
        "COMP_CWORD": str(len(typed.split())),
    }
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env={**os.environ, **asked},
    )  # fmt: skip
    assert set(done.stdout.split()) == wanted, done.stderr


@pytest.mark.long
def test_a_self_test_tries_every_fault_on_the_cases_named(palpate_run: Run) -> None:
    done = palpate_run("gate", "column", "--self-test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "softer, column: caught" in done.stderr
    assert "healthy, column: passed" in done.stderr
    assert "beam" not in done.stdout
    assert "missing-reference" not in done.stdout  # that trial is on another case
    for words, reported in (
        (["column", "--live"], "takes no --fault, --metamorphic or --live"),
        (["--fault", "softer"], "takes no --fault"),
        (["column", "--quick"], "name the cases, or say one of"),
    ):
        done = palpate_run("gate", "--self-test", *words)
        assert (done.returncode, reported in done.stderr) == (2, True), done.stderr


def test_a_self_test_needs_the_references_of_its_case(palpate_run: Run, write_case: Write) -> None:
    done = palpate_run("gate", write_case(), "--self-test")
    assert done.returncode == 2
    assert "no reference is stored" in done.stderr


@pytest.mark.parametrize("name", ["reference", "reference P1", "Reference"])
def test_a_candidate_called_reference_is_a_candidate(tmp_path: Path, name: str) -> None:
    """Half of the solution: it is judged, drawn and tabled as what it is, and fails."""
    case = load_case("block")
    solution = run_fastsim(case.problem, Strain.GREEN, in_silence)
    np.savez(tmp_path / f"{name}.npz", displacement=0.5 * solution.displacement)
    result = judge_case(case, candidate=result_candidate(tmp_path / f"{name}.npz"))
    assert result.verdict is Verdict.FAILED
    own = result.state(result.candidate, Strain.GREEN)
    same_mesh = result.state("reference P1", Strain.GREEN)
    assert own is not None
    assert same_mesh is not None
    assert [state.label for state in result.states if not state.is_reference] == [own.label]
    assert own.volume != same_mesh.volume
    called = f"{name} (candidate)"
    assert state_table(result).columns[-1] == called
    assert {budget.candidate for budget in case_budgets(result)} == {f"{called}, Green strain"}
    of_states = [state for state in result.states if state.strain is Strain.GREEN]
    measured = [key for key in result.metrics if key.endswith("green.volume")]
    assert len([key for key in measured if not key.startswith("error.")]) == len(of_states)


@pytest.mark.dolfinx
@pytest.mark.long
def test_report_of_ones_own_surface_from_another_folder(
    palpate_run: Run, tmp_path: Path, write_case: Write
) -> None:
    surface = shape_kidney(edge_length=20e-3)
    write_surface(tmp_path / "organ.stl", surface)
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    path = write_case(
        (shape, 'surface = "organ.stl"'),
        ("[0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0]", "[0, 0, -0.02], normal = [0, 0, -1]"),
        ("[1.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0]", "[0, 0, 0.03], normal = [0, 0, 1]"),
        ("force = [60.0, 20.0, -10.0]", "force = [0.04, 0.02, 0.12]"),
    )
    path.write_text(path.read_text("utf-8") + "\n[truth]\nminutes = 0.02\n", "utf-8")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    done = palpate_run("report", path, "-o", "out", folder=elsewhere)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (elsewhere / "out" / "report.html").read_text("utf-8")
    assert "passed" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    results = json.loads((elsewhere / "out" / "results.json").read_text("utf-8"))
    assert results["cases"][0]["verdict"] == "passed"
    assert "meshed by" in done.stdout


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", ["kidney", "beam"])
@pytest.mark.once
def test_fastsim_agrees_with_the_reference_solved_here(name: str) -> None:
    from palpate.meshes.problem import Strain
    from palpate.validation.candidates.fastsim import run_fastsim
    from palpate.validation.case import load_case
    from palpate.validation.metrics import make_state, measure
    from palpate.validation.references.reference_set import SAME_MESH
    from palpate.validation.references.runs import solve_state
    from palpate.validation.references.stored import load_stored

    problem = load_case(name).problem
    stored = load_stored(name, problem)
    for strain in Strain:
        solution = run_fastsim(problem, strain, in_silence)
        fast = make_state(
            problem.mesh, solution.displacement, label="fastsim", simulator="fastsim", strain=strain
        )
        live = solve_state(problem, strain, 1, in_silence)
        assert measure("displacement_l2", problem, fast, live).value < 1e-8
        # The stored one was made by another version of dolfinx in one of the two set-ups.
        kept = stored.states[SAME_MESH, strain]
        assert measure("displacement_l2", problem, live, kept).value < 1e-9
