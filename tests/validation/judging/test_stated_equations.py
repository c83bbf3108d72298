"""A result never chooses its own equations: what it states is compared with what was asked.

The case and the caller say by which scheme, step, element, law, precision and contact a result is
judged; a result that states others fails, with words, and is judged by what was asked all the same.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import (
    GREEN,
    case_of,
    failed,
    judge,
    judged_by,
    on_same_mesh,
    references_of,
    state_of,
    stored,
)
from numpy.typing import ArrayLike

import palpate
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Law, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.reference import availability
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.candidates.equations import AskedSteps, differences
from palpate.validation.case import Case, load_case
from palpate.validation.commands.options import near_tool_metres
from palpate.validation.judging import outputs
from palpate.validation.judging.case_references import is_to_be_solved
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.judging.run_comparison import compare_runs
from palpate.validation.references import runs
from palpate.validation.references.reference_set import (
    SAME_MESH,
    SMOOTHED,
    TRUTH,
    ReferenceSet,
)
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.report.html import write_report
from palpate.validation.report.trust import trust_of
from palpate.validation.states import Precision, State, Verdict, in_silence

STATED = "stated_equations"
COARSE = 0.02


@pytest.fixture
def case(let_go: Path) -> Case:
    """A bar let go, with outputs 40 of its steps apart, and a check on the same mesh alone."""
    text = let_go.read_text("utf-8").replace("num_outputs = 5", "num_outputs = 4")
    let_go.write_text(text.replace("end_time = 0.04", "end_time = 0.08"), "utf-8")
    return load_case(let_go)


def sent(folder: Path, displacement: ArrayLike, **about: Any) -> Path:
    """A result file; of a motion its states are at even times to the end."""
    moved = np.asarray(displacement)
    times = {} if moved.ndim == 2 else {"times": np.linspace(0.0, 0.08, len(moved))}
    np.savez(folder / "theirs.npz", displacement=moved, about=json.dumps(about), **times)
    return folder / "theirs.npz"


def solved(case: Case, steps: Steps | None = None) -> State:
    """The reference on the case's mesh, by the case's steps or these."""
    return solve_by_steps(case.problem, Strain.GREEN, steps, in_silence)


def known(case: Case, moved: np.ndarray) -> ReferenceSet:
    """A reference of the bar's motion, as if it were stored."""
    state = state_of(case.problem, moved, label=SAME_MESH, simulator="reference")
    return ReferenceSet({(SAME_MESH, GREEN): state}, {}, "known")


def swing(case: Case, size: float = 1.0) -> np.ndarray:
    """A motion of the bar: its points sink as x^2 and the square of the time."""
    points = case.problem.mesh.points
    sinks = np.zeros_like(points)
    sinks[:, 2] = -size * points[:, 0] ** 2
    return (np.linspace(0.0, 1.0, 5) ** 2)[:, None, None] * sinks


def stated(result: CaseResult) -> list[CheckResult]:
    return [check for check in result.checks if check.metric == STATED]


# --------------------------------------------------------- what used to pass, or to be inconclusive
@pytest.mark.dolfinx
def test_stating_coarse_steps_does_not_make_another_motion_right(case: Case) -> None:
    coarse = Steps(Integrator.BACKWARD_EULER, COARSE)
    own, other = solved(case), solved(case, coarse)
    apart = np.linalg.norm(own.displacements - other.displacements, axis=(1, 2)).max()
    assert apart > 0.3 * np.linalg.norm(own.displacements, axis=(1, 2)).max()
    path = sent(
        case.path.parent, other.displacements, integrator="backward-euler", time_step=COARSE
    )
    result = judge(case, live=True, candidate=result_candidate(path))
    assert result.verdict is Verdict.FAILED
    (check,) = on_same_mesh(result)
    assert check.verdict is Verdict.FAILED
    assert check.value is not None
    assert check.value > 0.3


def test_half_the_motion_fails_whatever_step_it_states(case: Case, monkeypatch: Any) -> None:
    # 0.01 s is far beyond the stable step: a reference by central differences blows up.
    path = sent(
        case.path.parent, 0.5 * swing(case), integrator="central-differences", time_step=0.01
    )
    result = judged_by(
        known(case, swing(case)), monkeypatch, case, candidate=result_candidate(path)
    )
    assert result.verdict is Verdict.FAILED
    assert on_same_mesh(result)[0].verdict is Verdict.FAILED


def test_nothing_moved_fails_whatever_element_it_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    references = references_of("block")
    states = {key: state for key, state in references.states.items() if key[0] != SMOOTHED}
    without = dataclasses.replace(references, states=states)
    path = sent(tmp_path, 0.0 * stored("block", SAME_MESH).displacement, element="smoothed")
    given = result_candidate(path)
    result = judged_by(without, monkeypatch, case_of("block"), candidate=given)
    for check in on_same_mesh(result):
        if check.strain is GREEN:
            assert check.verdict is Verdict.FAILED, check.name


def test_no_reference_is_stepped_because_a_result_says_so(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_args: Any, **_more: Any) -> State:
        raise AssertionError("5e7 steps of the reference, past every time limit")

    monkeypatch.setattr(runs, "solve_by_steps", never)
    path = sent(case.path.parent, swing(case), integrator="central-differences", time_step=1e-8)
    result = judged_by(
        known(case, swing(case)), monkeypatch, case, candidate=result_candidate(path)
    )
    assert [check.metric for check in failed(result)] == [STATED]


# ----------------------------------------------------------------------------- what a result states
AGREES = {
    "integrator": "central-differences",
    "time_step": 5e-4,
    "law": "Saint-Venant-Kirchhoff",
    "element": "linear",
    "precision": "float64",
    "iterations": 3,
}
# What palpate does not know is shown, and compared with nothing.
UNKNOWN = {"substep": 1e-5, "element": "C3D4", "law": "rubber", "precision": "half", "tool": "it"}
DIFFERS: list[tuple[dict[str, Any], str]] = [
    ({"integrator": "rk4"}, 'states "rk4"; asked was central-differences: correct'),
    ({"integrator": ["backward-euler"]}, "backward-euler"),
    ({"integrator": "backward-euler"}, "--integrator backward-euler"),
    (
        {"time_step": 0.02},
        "steps of 0.02 s; asked was steps of 0.0005 s: ask for it with --time-step",
    ),
    ({"time_step": "soon"}, "soon"),
    ({"time_step": -1.0}, "-1.0"),
    ({"time_step": float("nan")}, "nan"),
    ({"law": "neo-hookean"}, "--law neo-hookean"),
    (
        {"law": "linear elasticity: sigma = lmbda tr(e) I + 2 mu e, e = sym(grad u)"},
        "asked was saint",
    ),
    ({"precision": "single"}, "--precision single"),
    ({"element": "smoothed"}, "--element smoothed"),
]


def judged(case: Case, monkeypatch: Any, about: dict[str, Any], **options: Any) -> CaseResult:
    """The right motion, with these statements."""
    path = sent(case.path.parent, swing(case), **about)
    candidate = result_candidate(path, **options.pop("asked", {}))
    return judged_by(known(case, swing(case)), monkeypatch, case, candidate=candidate, **options)


@pytest.mark.parametrize(
    "about", [{}, AGREES, UNKNOWN, {"time_step": 0.000500004}, {"time_step": None}]
)
def test_what_is_not_stated_otherwise_is_no_difference(
    case: Case, monkeypatch: Any, about: Any
) -> None:
    result = judged(case, monkeypatch, about)
    assert result.verdict is Verdict.PASSED, [c.message for c in result.checks]
    assert dict(result.candidate_says) == about


@pytest.mark.parametrize(("about", "message"), DIFFERS)
def test_what_is_stated_otherwise_fails_with_words(
    case: Case, monkeypatch: Any, about: Any, message: str
) -> None:
    result = judged(case, monkeypatch, about)
    assert result.verdict is Verdict.FAILED
    (check,) = stated(result)
    assert check.verdict is Verdict.FAILED
    assert message in check.message
    assert check.name == "stated_equations (own, green)"
    # The motion is right by the case's own equations, and judged by these.
    (right,) = on_same_mesh(result)
    assert right.verdict is Verdict.PASSED
    assert right.limit == 1e-6


def test_single_precision_that_is_granted_is_no_difference(case: Case, monkeypatch: Any) -> None:
    for word in ("single", "double"):
        about = {"precision": word}
        result = judged(case, monkeypatch, about, precision=Precision.SINGLE)
        assert result.verdict is Verdict.PASSED


def test_contact_is_compared_with_that_of_the_tools() -> None:
    case = case_of("press")
    pressed = stored("press", SAME_MESH)
    for rule, option in (("facets", ""), ("vertices", "--contact vertices"), ("somewhere", "")):
        state = dataclasses.replace(pressed, says={"contact": rule})
        found = differences(
            case.problem, state, element=Element.LINEAR, steps=AskedSteps(), is_stepped=False,
            precision=Precision.DOUBLE,
        )  # fmt: skip
        assert [each.option for each in found] == ([option] if option else [])


def test_scheme_and_step_are_nobodys_business_where_no_check_is_about_them(case: Case) -> None:
    state = state_of(case.problem, swing(case), says={"integrator": "rk4", "time_step": 1.0})
    more = {"element": Element.LINEAR, "precision": Precision.DOUBLE, "is_stepped": False}
    assert differences(case.problem, state, steps=AskedSteps(), **more) == []
    for asked in (AskedSteps(Integrator.BDF2), AskedSteps(time_step=1e-3)):
        assert len(differences(case.problem, state, steps=asked, **more)) == 1


# ------------------------------------------------------------------------- what the caller asks for
BY_EULER = AskedSteps(Integrator.BACKWARD_EULER, COARSE)
TRUTH_CHECK = """
[[check]]
metric = "trajectory_l2"
against = "truth"
limit = 0.02
reason = "what a user needs"
"""


@pytest.fixture
def reference_by_steps(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """A reference that solves nothing: a right motion by any steps; and how it was asked."""
    calls: list[dict[str, Any]] = []

    def solve(problem: Any, strain: Any, steps: Any, _progress: Any, **more: Any) -> State:
        calls.append({"steps": steps, **more})
        moved = np.zeros((5, problem.mesh.num_points, 3))
        moved[:, :, 2] = -(np.linspace(0, 1, 5)[:, None] ** 2) * problem.mesh.points[:, 0] ** 2
        return state_of(problem, moved, strain, label=SAME_MESH, simulator="reference")

    monkeypatch.setattr(runs, "solve_by_steps", solve)
    return calls


def test_the_caller_asks_for_steps_and_the_result_agrees(
    case: Case, monkeypatch: Any, reference_by_steps: list[dict[str, Any]]
) -> None:
    about = {"integrator": "backward-euler", "time_step": COARSE}
    asked = dataclasses.replace(BY_EULER, time_limit=77.0)
    result = judged(case, monkeypatch, about, asked={"asked": asked})
    assert stated(result) == []
    assert [check.verdict for check in result.checks] == [Verdict.PASSED]
    (call,) = reference_by_steps
    assert str(call["steps"]) == "backward-euler, steps of 0.02 s"
    assert call["time_limit"] == 77.0
    # Solved right by such steps is not right.
    assert result.verdict is Verdict.INCONCLUSIVE
    assert any("how far such steps lead from the case's motion" in n for n in result.notes)
    assert "does not support a verdict" in trust_of(result).answer
    # The case's own steps, said in full, are no others.
    own = AskedSteps(Integrator.CENTRAL_DIFFERENCES, 5e-4)
    assert judged(case, monkeypatch, AGREES, asked={"asked": own}).verdict is Verdict.PASSED
    assert len(reference_by_steps) == 1


@pytest.mark.parametrize(("size", "verdict"), [(1.0, Verdict.PASSED), (1.1, Verdict.FAILED)])
def test_with_a_check_against_the_truth_asked_steps_may_pass(
    case: Case, monkeypatch: Any, reference_by_steps: Any, size: float, verdict: Verdict
) -> None:
    case.path.write_text(case.text + TRUTH_CHECK, "utf-8")
    both = load_case(case.path)
    truth = state_of(both.problem, swing(case, size), label=TRUTH, simulator="reference")
    of_mesh = known(case, swing(case)).states
    references = ReferenceSet(
        {**of_mesh, (TRUTH, GREEN): truth}, {("trajectory_l2", GREEN): 1e-3}, "known"
    )
    path = sent(case.path.parent, swing(case))
    candidate = result_candidate(path, asked=BY_EULER)
    result = judged_by(references, monkeypatch, both, candidate=candidate)
    assert result.verdict is verdict
    assert reference_by_steps


def test_a_reference_that_takes_too_long_says_so(case: Case, monkeypatch: Any) -> None:
    def late(*_args: Any, **more: Any) -> State:
        raise ReferenceFailedError(f"no solution within {more['time_limit']:g} s")

    monkeypatch.setattr(runs, "solve_by_steps", late)
    result = judged(case, monkeypatch, {}, asked={"asked": BY_EULER})
    assert result.verdict is Verdict.INCONCLUSIVE
    assert "no solution within 600 s" in on_same_mesh(result)[0].message


@pytest.mark.parametrize(
    ("step", "limit", "message"),
    [
        (1e-9, 600.0, "8e.07 steps to 0.08 s, and the reference takes at least"),
        (1e-8, 60.0, "longer --time-limit"),
        (1e-12, 600.0, "at most 1e.09 are taken"),
        (1.0, 600.0, "longer than the motion"),
        (-1.0, 600.0, "above 0"),
    ],
)
def test_steps_past_every_limit_are_refused_before_anything_is_solved(
    case: Case, monkeypatch: Any, reference_by_steps: Any, step: float, limit: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        judged(case, monkeypatch, {}, asked={"asked": AskedSteps(None, step, limit)})
    assert reference_by_steps == []


def test_the_front_door_asks_with_keywords(
    case: Case, monkeypatch: Any, reference_by_steps: list[dict[str, Any]]
) -> None:
    references = known(case, swing(case))
    monkeypatch.setattr(
        "palpate.validation.judging.judge.find_references", lambda *_a, **_k: references
    )
    steps: list[float | None] = []

    def theirs(problem: Any) -> np.ndarray:
        steps.append(problem.time.time_step)
        return swing(case)

    asked: dict[str, Any] = {"integrator": "backward-euler", "time_step": COARSE}
    result = palpate.judge(case, theirs, **asked, time_limit=9.0)
    assert steps == [COARSE]
    assert reference_by_steps[0]["time_limit"] == 9.0
    assert result.verdict is Verdict.INCONCLUSIVE
    assert palpate.judge(case, theirs).verdict is Verdict.PASSED
    assert palpate.compare(case, swing(case), **asked).verdict is Verdict.INCONCLUSIVE
    assert palpate.compare(case, swing(case), precision="single").verdict is Verdict.PASSED
    for wrong, message in (
        ({"integrator": "rk4"}, "known are"),
        ({"precision": "half"}, "precision = 'half'"),
        ({"contact": "facets"}, "no .tool."),
        ({"law": "rubber"}, "law = 'rubber'"),
    ):
        with pytest.raises(InputError, match=message):
            palpate.compare(case, swing(case), **wrong)


def test_a_state_does_not_choose_its_element() -> None:
    smoothed = palpate.solve(case_of("block").problem, element="smoothed")
    chosen = palpate.compare(case_of("block"), smoothed)
    assert chosen.verdict is Verdict.FAILED
    assert len(stated(chosen)) == 1
    asked = palpate.compare(case_of("block"), smoothed, element="smoothed")
    assert asked.verdict is Verdict.PASSED


# Cases whose truths are stored under these laws too.
STORED_LAWS = [
    (name, law)
    for name in ("block", "stretch", "shear", "confined", "cantilever")
    for law in (Law.NEO_HOOKEAN, Law.COROTATIONAL)
]


@pytest.mark.parametrize(("name", "law"), STORED_LAWS)
def test_another_law_is_judged_by_what_is_stored_for_it(
    name: str, law: Law, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(availability, "is_available", lambda: False)
    case = load_case(name)
    other = case.under(law)

    def of_law(problem: Problem) -> Points:
        assert problem.material.law is law
        return palpate.solve(problem, element="smoothed").displacement

    def of_case(_problem: Problem) -> Points:
        return palpate.solve(case.problem, element="smoothed").displacement

    right = palpate.judge(case, of_law, law=law, element="smoothed")
    same = {check.verdict for check in right.checks if check.against == "same_mesh"}
    # A function solves with the case's strain measure alone.
    assert same - {Verdict.SKIPPED} == {Verdict.PASSED}
    wrong = palpate.judge(case, of_case, law=law, element="smoothed")
    assert wrong.verdict is Verdict.FAILED
    assert (other.is_changed, is_to_be_solved(other)) == (True, False)
    assert is_to_be_solved(case.under(Law.NEO_HOOKEAN_STABLE))


def test_contact_is_asked_for_on_every_tool() -> None:
    case = case_of("press")
    other = case.with_contact(ContactRule.VERTICES)
    assert case.with_contact(ContactRule.FACETS) is case
    assert (other.name, other.is_changed) == ("press-vertices", True)
    assert {tool.contact for tool in other.problem.tools} == {ContactRule.VERTICES}


def test_every_output_has_the_difference(case: Case, monkeypatch: Any, tmp_path: Path) -> None:
    result = judged(case, monkeypatch, {"integrator": "backward-euler", "time_step": COARSE})
    path = tmp_path / "results.json"
    path.write_text(outputs.results_json([result], "1"), "utf-8")
    (row,) = json.loads(path.read_text("utf-8"))["cases"]
    assert [c["verdict"] for c in row["checks"] if c["metric"] == STATED] == ["failed"]
    assert {pair.change for pair in compare_runs(path, path).pairs} == {"same"}
    page = write_report([result], tmp_path).read_text("utf-8")
    assert "theirs says that it solved other equations: the result states backward-euler" in page
    for text in (page, outputs.junit_xml([result]), outputs.summary_markdown([result])):
        assert STATED in text
        assert "backward-euler" in text


def test_the_command_line_asks(case: Case, command_line: Any, capsys: Any) -> None:
    path = sent(case.path.parent, swing(case))
    for words, message in (
        (("compare", case.path, path, "--time-step", "1"), "longer than the motion"),
        (("compare", case.path, path, "--time-step", "1e-9"), "longer --time-limit"),
        (("compare", case.path, path, "--integrator", "rk4"), "rk4"),
        (("compare", case.path, path, "--contact", "facets"), "has no [tool]"),
        (("gate", case.path, "--contact", "facets"), "has no [tool]"),
        (("gate", "press", "--contact", "vertices", "--expected"), "--contact"),
        (("report", "press", "-o", path.parent / "x", "--law", "ogden", "--expected"), "--law"),
    ):
        assert command_line(*words) == 2
        assert message in " ".join(capsys.readouterr().err.split())


def test_a_mesh_near_tools_is_of_the_case() -> None:
    case = load_case("press")
    finer = case.near_tools(0.005)
    assert (finer.name, finer.is_changed) == ("press-near-tool", False)
    assert finer.problem.mesh.num_cells > case.problem.mesh.num_cells
    assert "refined near tools to edges of 5 mm, from 486 to" in finer.mesh_origin
    with pytest.raises(InputError, match=r"has no \[tool\]"):
        load_case("block").near_tools()
    with pytest.raises(InputError, match="needs a finite length above 0, in mm"):
        near_tool_metres(0.0)
