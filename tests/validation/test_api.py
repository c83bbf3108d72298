"""The front door: quick to open, typed, each name with an example that runs, without FEniCSx."""

from __future__ import annotations

import dataclasses
import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.meshes.arrays import Points

ROOT = Path(__file__).parents[2]
HEAVY = ("dolfinx", "matplotlib", "pydantic", "meshio", "rich", "typer", "pyvista")


def python(text: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # type: ignore[call-overload,no-any-return]
        [sys.executable, "-c", text], capture_output=True, text=True, check=False, **options
    )


def examples_of(name: str) -> doctest.DocTest:
    """The examples in a name's own docstring, not in those of its methods."""
    thing = getattr(palpate, name)
    text = inspect.cleandoc(thing.__doc__ or "")
    return doctest.DocTestParser().get_doctest(text, {}, name, None, None)


def failures_of(test: doctest.DocTest) -> str:
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return "".join(said)


@pytest.mark.parametrize("name", palpate.api.__all__)
def test_every_name_has_an_example_that_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    test = examples_of(name)
    assert any("palpate" in example.source for example in test.examples[1:]), name
    assert failures_of(test) == ""


def test_a_wrong_example_is_seen() -> None:
    test = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, None)
    assert "Got" in failures_of(test)


def test_the_door_is_opened_without_loading_what_is_slow() -> None:
    reported = python(
        "import sys, palpate\n"
        "assert not [m for m in sys.modules if m.startswith('palpate.')], 'rooms were loaded'\n"
        "palpate.Problem, palpate.Material, palpate.solve, palpate.judge\n"
        f"print([m for m in {HEAVY} if m in sys.modules])"
    )
    assert reported.stdout.strip() == "[]", reported.stdout + reported.stderr


def test_a_problem_of_plain_data_is_solved_and_judged_where_dolfinx_cannot_be_imported() -> None:
    reported = python(
        "import sys\n"
        "for name in ('dolfinx', 'dolfinx_solver', 'ufl', 'petsc4py'):\n"
        "    sys.modules[name] = None\n"
        "import palpate\n"
        "case = palpate.load_case('block')\n"
        "print(palpate.judge(case).verdict)\n"
        "print(palpate.simulate(case.problem, time=palpate.TimeSpan(0.01)).trajectory.times[-1])\n"
        "solution = palpate.solve(case.problem)\n"
        "print(palpate.audit(case, solution, degree=1).relative_residual_norm < 1e-8)\n"
        "for ask in (\n"
        "    lambda: palpate.solve(case.problem, with_='reference'),\n"
        "    lambda: palpate.audit(case, solution),\n"
        "):\n"
        "    try:\n"
        "        ask()\n"
        "    except palpate.ReferenceUnavailableError as error:\n"
        "        print('FEniCSx' in str(error), 'degree 1' in str(error))\n"
    )
    assert reported.stdout.split() == [
        *("passed", "0.01", "True"), *("True", "False"), *("True", "True"),
    ], reported.stdout + reported.stderr  # fmt: skip


def test_the_names_can_be_listed_and_starred_and_others_are_refused() -> None:
    assert set(palpate.api.__all__) <= set(dir(palpate))
    starred: dict[str, object] = {}
    exec("from palpate import *", starred)
    assert starred["solve"] is palpate.api.solve
    with pytest.raises(AttributeError, match="no attribute 'slove'"):
        _ = palpate.slove  # type: ignore[attr-defined]


def test_the_template_is_written_once_and_read_by_all_who_build() -> None:
    template = "validation/front_door.py.in"
    for reader in ("pyproject.toml", ".ci/view.sh", ".ci/sanitize.sh"):
        text = (ROOT / reader).read_text("utf-8")
        assert text.count(template) == 1, reader
        assert "FEniCSx validation and reference pipeline" not in text.replace(
            'description = "FEniCSx validation and reference pipeline', ""
        ), reader


@pytest.mark.dolfinx
def test_the_door_and_the_command_line_solve_a_motion_by_the_reference_alike(
    tmp_path: Path,
) -> None:
    written = tmp_path / "u.npz"
    command = [sys.executable, "-m", "palpate.validation.cli", "solve", "block-motion"]
    subprocess.run([*command, "--with", "reference", "-o", str(written)], check=True)
    state = palpate.solve(palpate.load_case("block-motion").problem, with_="reference")
    assert state.trajectory is not None
    with np.load(written) as stored:
        np.testing.assert_array_equal(stored["displacement"], state.trajectory.displacements)


def test_a_word_that_is_not_known_is_reported_with_those_that_are() -> None:
    problem = palpate.load_case("block").problem
    with pytest.raises(
        palpate.InputError, match="with_ = 'fenics': use one of fastsim, condensed, reference"
    ):
        palpate.solve(problem, with_="fenics")  # type: ignore[arg-type]
    with pytest.raises(palpate.InputError, match="strain = 'big': use one of linear, green"):
        palpate.solve(problem, strain="big")  # type: ignore[arg-type]
    with pytest.raises(palpate.InputError, match="no time span"):
        palpate.simulate(problem)
    with pytest.raises(palpate.InputError, match="edge_length = -1 m"):
        palpate.mesh(problem.mesh.surface(), edge_length=-1.0)


def test_a_function_is_judged_as_any_simulator() -> None:
    def softer(problem: palpate.Problem) -> Points:
        young = problem.material.youngs_modulus
        soft = dataclasses.replace(problem.material, youngs_modulus=young / 1.02)
        return palpate.solve(dataclasses.replace(problem, material=soft)).displacement

    def crashes(_problem: palpate.Problem) -> Points:
        raise ZeroDivisionError("no pivot")

    def right(problem: palpate.Problem) -> Points:
        return palpate.solve(problem).displacement

    assert palpate.judge("block", right).verdict is palpate.Verdict.PASSED
    assert palpate.judge("block", softer).verdict is palpate.Verdict.FAILED
    failed = palpate.judge("block", crashes)
    assert failed.verdict is palpate.Verdict.FAILED
    assert "no pivot" in failed.checks[0].message


def test_a_function_of_the_wrong_shape_is_refused_and_nan_has_failed() -> None:
    with pytest.raises(palpate.InputError, match=r"displacement has shape \(3,\); this case needs"):
        palpate.judge("block", lambda _problem: np.zeros(3))
    perturbed = palpate.judge("block", lambda problem: np.nan * problem.mesh.points)
    assert perturbed.verdict is palpate.Verdict.FAILED


class EndsWhenRead:
    def __array__(self, *_: object, **__: object) -> None:
        sys.exit(0)


class Stop(BaseException):
    pass


@pytest.mark.parametrize("error", [SystemExit(0), SystemExit(), KeyboardInterrupt(), Stop()])
def test_a_function_that_ends_python_has_failed(error: BaseException) -> None:
    def ends(_problem: palpate.Problem) -> Points:
        raise error

    assert palpate.judge("block", ends).verdict is palpate.Verdict.FAILED


def test_a_function_that_ends_python_when_its_numbers_are_read_has_failed() -> None:
    def lazy(_problem: palpate.Problem) -> object:
        return EndsWhenRead()

    assert palpate.judge("block", lazy).verdict is palpate.Verdict.FAILED  # type: ignore[arg-type]


def test_an_interrupt_of_the_user_ends_the_script_while_a_function_runs() -> None:
    done = python(
        "import os, signal, threading, time, palpate\n"
        # A shell's background jobs, and what they start, ignore it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def slow(problem):\n"
        "    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
        "    time.sleep(30)\n"
        "palpate.judge('block', slow)\n"
        "print('lives on')\n"
    )
    assert done.returncode != 0
    assert "KeyboardInterrupt" in done.stderr
    assert "lives on" not in done.stdout


def test_a_function_that_changes_its_problem_is_judged_by_the_case_as_it_was() -> None:
    case = palpate.load_case("block")

    def frees_everything(problem: palpate.Problem) -> Points:
        problem.mesh.points.setflags(write=True)
        for array in (*(s.points for s in problem.supports), problem.mesh.points):
            array[:] = 0
        return np.zeros_like(problem.mesh.points)

    before = [s.points.copy() for s in case.problem.supports]
    points = case.problem.mesh.points.copy()
    assert palpate.judge(case, frees_everything).verdict is palpate.Verdict.FAILED
    assert all(
        np.array_equal(s.points, b) for s, b in zip(case.problem.supports, before, strict=True)
    )
    assert np.array_equal(case.problem.mesh.points, points)


class InMillimetres(np.ndarray):  # type: ignore[type-arg]
    units = "mm"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda u: u.astype(complex), "complex128"),
        (lambda u: u.astype(object), "object"),
        (lambda u: u != 0.0, "bool"),
        (lambda u: u.astype("U32"), "<U32"),
        (lambda u: u.astype("S32"), "S32"),
        (lambda u: (u * 1e9).astype("m8[ns]"), "timedelta64"),
        (lambda u: np.ma.masked_array(u, np.zeros(u.shape, dtype=bool)), "masked"),
        (lambda u: np.ma.masked_invalid(np.where(u == u.max(), np.nan, u)), "masked"),
        (lambda u: list(np.ma.masked_array(u, u > 0.0)), "masked"),
        (lambda u: [[complex(x) for x in row] for row in u], "complex128"),
        (lambda u: u.view(InMillimetres), "mm"),
        (lambda _u: None, "object"),
    ],
)
def test_what_is_no_array_of_real_numbers_is_refused_with_words(change: object, word: str) -> None:
    case = palpate.load_case("block")
    right = palpate.solve(case.problem).displacement
    assert callable(change)
    with pytest.raises(palpate.InputError, match=word):
        palpate.compare(case, change(right))
    with pytest.raises(palpate.InputError, match=word):
        palpate.judge(case, lambda _problem: change(right))


def test_a_state_of_the_reference_is_compared_under_a_name_of_its_own() -> None:
    solution = palpate.solve(palpate.load_case("block").problem)
    named = dataclasses.replace(solution, label="reference P1", simulator="reference")
    judged = palpate.compare("block", named)
    assert judged.candidate == "reference P1 (candidate)"
    assert judged.verdict is palpate.Verdict.PASSED


def test_a_motion_with_a_tool_in_memory_is_compared_with_its_forces() -> None:
    case = palpate.load_case("slide")
    state = palpate.solve(case.problem)
    assert state.tool_forces is not None

    def failed(solution: palpate.State) -> set[str]:
        # Of the truth its cells are too coarse to come near.
        checks = [c for c in palpate.compare(case, solution).checks if c.against == "same_mesh"]
        assert len(checks) > 2
        return {c.metric for c in checks if c.verdict == "failed"}

    assert failed(state) == set()
    doubled = dataclasses.replace(state, tool_forces=2.0 * state.tool_forces)
    assert failed(doubled) == {"tool_force"}
