"""The rule by which an explanation is named, and mistakes beside its simulator's."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from judged import case_of, state_of

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.diagnosis import Cause, Diagnosis, Explanation, diagnose
from palpate.validation.diagnosis.explanation import (
    OF_FORCE,
    choose,
    displacement_words,
    in_words,
    snapped,
)
from palpate.validation.diagnosis.result_hypotheses import (
    isotropy_hypotheses,
    result_hypotheses,
    turned_otherwise,
)
from palpate.validation.judging.metamorphic import judge_relations
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.laws import green, laws_instead_of, linear
from palpate.validation.states import OwnMesh, State, in_silence


def explanation(
    residual: float, stated: float, complexity: int = 1, name: str = "x"
) -> Explanation:
    return Explanation(name, Cause.LOAD, residual, stated, OF_FORCE, complexity)


def name_of(diagnosis: Diagnosis) -> str:
    assert diagnosis.first is not None, str(diagnosis)
    return diagnosis.first.name


@pytest.mark.parametrize(
    ("residual", "stated", "fits"),
    [
        (1e-12, 1.0, True),
        (9e-5, 1.0, True),
        # Beyond single precision.
        (2e-4, 1e3, False),
        # Not a thousand times better than the truth.
        (1e-7, 9e-5, False),
        (1e-8, 9e-5, True),
        (float("nan"), 1.0, False),
        # Nothing is wrong: nothing explains it.
        (0.0, 0.0, False),
    ],
)
def test_an_explanation_is_named_where_it_fits_far_better_than_the_truth(
    residual: float, stated: float, fits: bool
) -> None:
    assert explanation(residual, stated).fits is fits


def test_the_simplest_comes_first_and_poor_fits_go() -> None:
    fitted = explanation(1e-13, 1.0, 3, "fitted")
    plain = explanation(1e-12, 1.0, 1, "plain")
    poor = explanation(1e-8, 1.0, 1, "poor")
    agrees = explanation(1e-12, 1e-12, 0, "agrees")
    assert [e.name for e in choose([fitted, poor, agrees, plain])] == ["plain", "fitted"]
    assert [e.name for e in choose([agrees, explanation(0.5, 1.0)])] == ["agrees"]


def test_factors_are_known_by_their_digits() -> None:
    assert snapped(1000.0000001) == 1e3
    assert snapped(-1.0 + 1e-9) == -1.0
    assert snapped(1e-12) == 0.0
    assert snapped(1e-6) == 1e-6
    assert snapped(0.98) is None
    # An inch is 25.4 mm.
    assert displacement_words(1.0 / 0.0254) == "displacement in inches"
    assert in_words(0.01) == "100 times too small"


@pytest.mark.parametrize("strain", list(Strain))
def test_every_law_has_the_stated_ones_small_strains_but_for_those_that_are_wrong_there(
    strain: Strain, problem: Problem
) -> None:
    """What is another law for large strains only is the same for small ones, to their size."""
    body = Body(problem, strain)
    H = 1e-7 * np.random.default_rng(0).normal(size=(problem.mesh.num_cells, 3, 3))
    right = (green if strain is Strain.GREEN else linear)(H, body.lmbda, body.mu)
    scale = np.abs(right).max()
    differ = {
        name
        for name, law in laws_instead_of(strain).items()
        if np.abs(law(H, body.lmbda, body.mu) - right).max() > 1e-5 * scale
    }
    assert differ == {
        "engineering shear strain taken for tensor shear: shear stresses doubled",
        "tensor shear strain taken for engineering shear: shear stresses halved",
        "Green strain without its factor 1/2",
    }


def test_a_symmetric_solution_is_explained_by_several_axes() -> None:
    rest = np.random.default_rng(0).normal(size=(20, 3))
    truth = np.random.default_rng(1).normal(size=(1, 20, 3))
    truth[..., 1] = truth[..., 0]
    turned = truth * [1.0, 1.0, -1.0]
    found = choose(result_hypotheses(turned, truth, rest))
    assert [e.name for e in found] == ["z reversed", "components x and y exchanged, z reversed"]


@pytest.mark.long
@pytest.mark.nightly
def test_an_anisotropic_law_is_found_by_turning_the_problem(solutions: Any) -> None:
    problem = case_of("block").problem

    def asked_with(mistake: str) -> Callable[[Problem], Points]:
        return lambda given: solutions.to(given, Strain.GREEN, mistake).displacement

    def tried(mistake: str) -> Explanation:
        solution = solutions.of("block", mistake).displacement
        (found,) = isotropy_hypotheses(problem, solution, asked_with(mistake))
        return found

    assert "not isotropic" in tried("orthotropic").name
    assert tried("orthotropic").fits
    # Isotropic, right or wrong; and wrong by the numbers of points, wherever the axes lie.
    for mistake in ("", "softer", "dropped-cell"):
        assert not tried(mistake).fits


def test_tools_that_are_left_out_and_their_forces_are_named() -> None:
    problem = case_of("press").problem

    def with_mistake(fault: Fault) -> State:
        return with_fault(fastsim_candidate(), fault).solve(problem, Strain.GREEN, in_silence)

    right = with_mistake(Fault.NONE)
    for fault, words in (
        (Fault.DROPPED_TOOL, "tools left out: nothing touches"),
        # Only what the tool does moves the body: a softer one moves just as far.
        (Fault.SOFTER, "force on the tools 0.98 times what was asked"),
        (Fault.REVERSED_TOOL_FORCE, "force on the tools reversed"),
    ):
        assert name_of(diagnose(problem, with_mistake(fault), right)).startswith(words)


def test_on_a_mesh_of_its_own_only_units_are_tried() -> None:
    problem = case_of("block").problem
    truth = state_of(problem, solve_static(problem).displacement)
    finer = refine_problem(problem)
    fine = solve_static(finer).displacement
    own = OwnMesh(finer.mesh, 1e3 * fine[None])
    read = state_of(problem, 1e3 * fine[: problem.mesh.num_points])
    diagnosis = diagnose(problem, dataclasses.replace(read, own=own), truth)
    assert name_of(diagnosis) == "displacement in millimetres"
    assert "mesh of its own" in str(diagnosis)
    healthy = OwnMesh(finer.mesh, fine[None])
    read = dataclasses.replace(state_of(problem, 1e-3 * read.displacement), own=healthy)
    assert diagnose(problem, read, truth).explanations == ()


@pytest.mark.long
def test_a_motion_whose_step_nobody_knows_is_not_stepped_again(solutions: Any) -> None:
    given = case_of("block-motion").problem
    assert given.time is not None
    unknown = dataclasses.replace(given, time=dataclasses.replace(given.time, time_step=None))
    diagnosis = diagnose(unknown, solutions.of("block-motion", "softer"), None)
    assert diagnosis.explanations == ()
    assert "No time step is known" in str(diagnosis)
    # Unless the candidate says what it took.
    reported = dataclasses.replace(
        solutions.of("block-motion", "softer"), says={"time_step": given.time.time_step}
    )
    assert "stiffness 0.98 times" in name_of(diagnose(unknown, reported, None))
    # A step that cannot be is no step.
    for claim in (1e-310, float("inf"), float("nan"), -1.0, "1e-4", [1e-4]):
        reported = dataclasses.replace(reported, says={"time_step": claim})
        assert "mechanical mistakes were not tried" in str(diagnose(unknown, reported, None))


def test_a_motion_of_too_many_steps_says_that_nothing_was_tried() -> None:
    problem = case_of("csm3").problem
    assert problem.time is not None
    still = np.zeros((problem.time.num_outputs + 1, *problem.mesh.points.shape))
    # 0.04 s from output to output: 4 000 steps.
    answered = state_of(problem, still, details={"time_step": 1e-5})
    assert str(diagnose(problem, answered, None)).startswith("nothing was tried. Too many steps")


def test_times_that_run_too_fast_are_found_from_the_trajectory_alone() -> None:
    times = np.linspace(0.0, 1.0, 41)
    shape = np.random.default_rng(0).normal(size=(1, 30, 3))
    truth = np.sin(3.0 * times)[:, None, None] * shape
    fast = np.sin(6.0 * times)[:, None, None] * shape
    rest = np.zeros((30, 3))
    assert [e.name for e in choose(result_hypotheses(fast, truth, rest))] == [
        "time runs 2 times too fast"
    ]


def test_solver_noise_is_no_anisotropy() -> None:
    assert not turned_otherwise(0.0, 1e-8).fits
    assert turned_otherwise(0.0, 1e-2).fits


@pytest.mark.long
@pytest.mark.nightly
def test_relations_that_only_a_law_with_axes_breaks_say_so(solutions: Any) -> None:
    def judged(mistake: str) -> tuple[Diagnosis, ...]:
        def solve(given: Problem, strain: Strain, _progress: Any) -> State:
            return solutions.to(given, strain, mistake)

        return judge_relations(case_of("block"), Candidate("mine", solve), in_silence).diagnoses

    (found,) = judged("orthotropic")
    assert "not isotropic" in name_of(found)
    assert judged("dropped-cell") == ()


def test_a_solution_that_hardly_moves_is_given_no_law() -> None:
    """Constants as large as you like bring any small solution into equilibrium."""
    problem = case_of("block").problem
    right = solve_static(problem, strain=Strain.LINEAR).displacement
    assert (
        diagnose(problem, state_of(problem, 1e-30 * right, Strain.LINEAR), None).explanations == ()
    )
