"""A simulator is judged on the same mesh by the scheme and step that the caller asks for."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import on_same_mesh, solved
from typer.testing import CliRunner

import palpate.validation
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.reference.schemes import Integrator
from palpate.validation.candidates.candidate import candidates_for, outside_candidate
from palpate.validation.candidates.outside import CommandError, OutsideSimulator
from palpate.validation.case import load_case
from palpate.validation.case.load import Case
from palpate.validation.cli import app
from palpate.validation.judging.checks import STATED
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.reference_set import SAME_MESH, ReferenceSet
from palpate.validation.states import CandidateFailedError, Verdict, in_silence

ADAPTERS = Path(palpate.validation.__file__).parent / "peers/adapters"
DESCENT = f"{sys.executable} {ADAPTERS / 'vertex_block_descent.py'} {{case}} {{result}}"
XPBD = DESCENT + " {iterations} method=xpbd"
STEP = 2e-3
EULER = Integrator.BACKWARD_EULER


@pytest.fixture
def case(let_go: Path) -> Case:
    return load_case(let_go)


def judged(case: Case, command: str, **stepping: Any) -> tuple[CaseResult, float]:
    """The result, and the value of its one check of the motion."""
    candidates = candidates_for(command, 300.0, **stepping)
    result = judge_case(case, live=True, candidate=candidates)
    (check,) = on_same_mesh(result)
    assert check.value is not None, check.message
    return result, check.value


def sending_file(folder: Path, **arrays: Any) -> str:
    """The command of a simulator that sends these arrays."""
    np.savez(folder / "sent.npz", **arrays)
    return f"sh -c 'cp {folder / 'sent.npz'} $0' {{result}} {{case}}"


@pytest.mark.dolfinx
@pytest.mark.parametrize("law", ["saint-venant-kirchhoff", "neo-hookean-stable"])
@pytest.mark.nightly
@pytest.mark.long
def test_block_descent_comes_to_the_reference_by_backward_euler(case: Case, law: str) -> None:
    if law != case.problem.material.law:
        text = case.text.replace("[material]", f'[material]\nlaw = "{law}"')
        case.path.write_text(text, "utf-8")
        case = load_case(case.path)
    command = DESCENT + " {iterations}"
    asked = {"integrator": EULER, "time_step": STEP}
    result, value = judged(case, command, **asked, iterations=120)
    (check,) = result.checks
    assert check.verdict is Verdict.PASSED, value
    assert any("backward-euler, steps of 0.002 s" in note for note in result.notes)
    # Each step is solved right; how far such steps lead from the motion, no check says.
    assert result.verdict is Verdict.INCONCLUSIVE
    assert any("how far such steps lead" in note for note in result.notes)
    # Against central differences, which nobody asked it to leave, it is another scheme's motion.
    other, apart = judged(case, command, time_step=STEP, iterations=120)
    assert other.verdict is Verdict.FAILED
    assert apart > 1e-3
    (stated,) = (check for check in other.checks if check.metric == STATED)
    assert "--integrator backward-euler" in stated.message
    few, left = judged(case, command, **asked, iterations=3)
    assert few.verdict is Verdict.FAILED
    assert left > 1e-3


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_xpbd_comes_to_it_with_shorter_steps_and_not_with_more_iterations(case: Case) -> None:
    left = {
        (step, many): judged(case, XPBD, integrator=EULER, time_step=step, iterations=many)[1]
        for step, many in ((8e-3, 40), (8e-3, 160), (STEP, 160))
    }
    assert left[8e-3, 160] > 1e-5
    assert left[8e-3, 160] > 0.5 * left[8e-3, 40]
    assert left[STEP, 160] < 0.3 * left[8e-3, 160]


@pytest.mark.dolfinx
@pytest.mark.long
def test_a_result_that_states_nothing_is_judged_by_what_is_asked(
    case: Case, tmp_path: Path
) -> None:
    # The explicit motion, called so and called another scheme's.
    motion = solved(case.problem).trajectory
    assert motion is not None
    command = sending_file(tmp_path, displacement=motion.displacements, times=motion.times)
    plain, value = judged(case, command)
    assert plain.verdict is Verdict.PASSED
    assert value < 1e-9
    other, value = judged(case, command, integrator=EULER)
    assert other.verdict is Verdict.FAILED
    assert value > 1e-3


# Outputs of `let_go` are 8e-3 s apart, which is no whole number of these.
BESIDE_OUTPUTS = 3e-3


@pytest.mark.dolfinx
@pytest.mark.long
def test_steps_that_do_not_divide_the_outputs_are_judged_at_the_steps(
    case: Case, tmp_path: Path
) -> None:
    stepping = {"integrator": EULER, "time_step": BESIDE_OUTPUTS, "iterations": 200}
    result, value = judged(case, DESCENT + " {iterations}", **stepping)
    (check,) = on_same_mesh(result)
    reference = next(s for s in result.states if s.is_reference and s.sent is not None)
    assert reference.sent is not None
    np.testing.assert_allclose(np.diff(reference.sent.times)[:-1], BESIDE_OUTPUTS, rtol=1e-9)
    # The same states at the same steps: what reading between them may be off by is as small.
    assert value < 1e-6
    assert check.reference_error is not None
    assert check.reference_error < 1e-6
    # Who reads straight lines between its steps itself is off by that; the reference's own
    # reading at the outputs is a bar.
    (candidate,) = (s for s in result.states if not s.is_reference)
    assert candidate.sent is not None
    times, states = candidate.sent.times, candidate.sent.displacements
    assert case.problem.time is not None
    wanted = np.linspace(0.0, case.problem.time.end_time, case.problem.time.num_outputs + 1)
    flat = states.reshape(len(times), -1)
    read = np.array([np.interp(wanted, times, u) for u in flat.T]).T
    command = sending_file(tmp_path, displacement=read.reshape(-1, *states.shape[1:]), times=wanted)
    del stepping["iterations"]
    result, value = judged(case, command, **stepping)
    (check,) = on_same_mesh(result)
    assert check.reference_error is not None
    assert 1e-6 < check.reference_error < value < 0.01


@pytest.mark.dolfinx
@pytest.mark.long
def test_a_poor_motion_is_off_by_a_number_since_a_step(case: Case) -> None:
    stepping = {"integrator": EULER, "time_step": STEP, "iterations": 1}
    result, value = judged(case, DESCENT + " {iterations}", **stepping)
    (check,) = on_same_mesh(result)
    assert check.verdict is Verdict.FAILED
    # Four steps to an output.
    assert f"off by {100.0 * value:.3g} % of the largest displacement" in check.message
    assert "1 % from 0.008 s on (output 1, step 4)" in check.message
    assert any(note.startswith("No diagnosis: ") for note in result.notes)


def test_steps_that_cannot_be_meant_are_refused(case: Case) -> None:
    problem = case.problem
    for step, message in ((1.0, "longer than the motion"), (-1.0, "above 0")):
        with pytest.raises(InputError, match=message):
            outside_candidate(OutsideSimulator(DESCENT, time_step=step)).solve(
                problem, Strain.GREEN, in_silence
            )
    still = dataclasses.replace(problem, time=None)
    with pytest.raises(InputError, match="takes no steps"):
        outside_candidate(OutsideSimulator(DESCENT, time_step=1.0)).solve(
            still, Strain.GREEN, in_silence
        )
    for command, iterations in ((DESCENT, 3), (DESCENT + " {iterations}", None)):
        with pytest.raises(CommandError, match="together"):
            OutsideSimulator(command, 60.0, iterations)
    with pytest.raises(CommandError, match="at least 1"):
        OutsideSimulator(DESCENT + " {iterations}", 60.0, 0)
    with pytest.raises(InputError, match="give --simulator"):
        candidates_for(None, 60.0, iterations=3)


@pytest.mark.dolfinx
@pytest.mark.long
def test_the_gate_takes_scheme_step_and_iterations(case: Case) -> None:
    words = ["gate", str(case.path), "--live", "--simulator", DESCENT + " {iterations}"]
    words += ["--integrator", "backward-euler", "--time-step", "0.008", "--iterations", "200"]
    found = CliRunner().invoke(app, words)
    # No check of this case is against the truth.
    assert found.exit_code == 3, found.output
    said = " ".join(found.output.split())
    assert "backward-euler, steps of 0.008 s" in said
    assert "Add a check against the truth" in said


def test_time_step_is_filled_into_the_command(case: Case, tmp_path: Path) -> None:
    script = tmp_path / "echo.py"
    script.write_text("import sys\nprint(sys.argv[3])\nsys.exit(1)\n", "utf-8")
    command = f"{sys.executable} {script} {{case}} {{result}} {{time_step}}"
    candidate = outside_candidate(OutsideSimulator(command, time_step=STEP))
    with pytest.raises(CandidateFailedError, match=f"{STEP:.17g}"):
        candidate.solve(case.problem, Strain.GREEN, in_silence)


def test_of_a_reference_that_has_failed_by_the_steps_nothing_else_is_said() -> None:
    found = ReferenceSet({}, {}, "nowhere").with_same_mesh(Strain.GREEN, None, "solved", "why not")
    assert found.remarks == ()
    assert found.failures == {(SAME_MESH, Strain.GREEN): "why not"}
