"""Motions by another scheme, step or mass matrix than the case's are named; others are not."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bank import loaded_bar
from judged import case_of, state_of, stored

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.problem import Problem, Strain, TimeSpan
from palpate.reference.schemes import Integrator
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.diagnosis import Diagnosis, diagnose
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.implicit_stepping import ImplicitStepper, consistent_mass
from palpate.validation.metrics.stepping import MotionHypothesis, Stepper
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.states import in_silence

GREEN = Strain.GREEN
OTHERS = Path(__file__).parents[1] / "candidates" / "other_integrators.py"
WORDS = "another time integration: "
NEWMARK = f"{WORDS}the trapezoidal rule (Newmark, gamma = 1/2, beta = 1/4), steps of"
IMPLICIT = [scheme for scheme in Integrator if scheme.is_implicit]


def swinging() -> Problem:
    """A bar under a weight that grows over the first half, and falls back; damped by its mass."""
    ramp = TabularAmplitude((0.0, 0.02, 0.04), (0.0, 1.0, 0.2))
    times = TimeSpan(0.04, time_step=1e-3, num_outputs=8, mass_damping=3.0)
    weight = BodyForce((0.0, 200.0, -600.0), ramp)
    return replace(loaded_bar((3, 1, 1)), loads=(weight,), time=times)


def of_motion(problem: Problem, states: object, **says: float) -> Diagnosis:
    first = np.zeros((1, problem.mesh.num_points, 3))
    state = state_of(problem, np.concatenate([first, list(states)]), GREEN)
    return diagnose(problem, replace(state, says=says), None)


@pytest.mark.dolfinx
@pytest.mark.parametrize("scheme", IMPLICIT)
def test_the_judges_implicit_steps_are_those_of_the_reference(scheme: Integrator) -> None:
    from palpate.reference.stepping import simulate_by

    problem = swinging()
    theirs = simulate_by(problem, scheme).displacements
    mine = list(ImplicitStepper(body_of(problem, GREEN), scheme, 5, 8).outputs())
    assert np.abs(mine - theirs[1:]).max() < 1e-8 * np.abs(theirs).max()


def test_the_consistent_mass_has_the_lumped_ones_sums() -> None:
    body = body_of(swinging(), GREEN)
    full = consistent_mass(body).toarray()
    one = np.ones(len(full))
    assert full @ one == pytest.approx(Stepper(body, 1.0, 1, 1)._mass, rel=1e-12)
    # Of linear functions on tetrahedra the integral of N_a^2 is twice that of N_a N_b.
    x = body.mesh.points[:, 0]
    corners = x[body.mesh.cells]
    squared = (corners.sum(1) ** 2 + (corners**2).sum(1)) / 20.0
    density = body.problem.material.density
    assert x @ full @ x == pytest.approx(density * (body.volumes @ squared), rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "name"),
    [("newmark", f"{NEWMARK} 0.0025 s"), ("euler", "")],
)
def test_another_simulators_scheme_is_named_where_its_step_is_known(
    method: str, name: str, tmp_path: Path
) -> None:
    """The step of its Newmark is a quarter of an output; that of its Euler nobody knows."""
    case = case_of("block-motion")
    write_case_folder(tmp_path / "case", case.problem, case.strain, name="case")
    result = tmp_path / "r.npz"
    subprocess.run([sys.executable, OTHERS, tmp_path / "case", result, method], check=True)
    state = result_candidate(result).solve(case.problem, case.strain, in_silence)
    found = diagnose(case.problem, state, stored("block-motion", SAME_MESH, case.strain))
    assert [each.name for each in found.explanations] == ([name] if name else [])


@pytest.mark.parametrize("scheme", IMPLICIT)
@pytest.mark.parametrize("is_full", [False, True])
def test_each_scheme_and_mass_is_told_from_the_others(scheme: Integrator, is_full: bool) -> None:
    problem = swinging()
    made = ImplicitStepper(body_of(problem, GREEN), scheme, 2, 8, is_full)
    (found,) = of_motion(problem, made.outputs()).explanations
    assert found.name.startswith(WORDS)
    assert found.name.endswith("the consistent mass matrix") is is_full
    assert "steps of 0.0025 s" in found.name
    assert found.cause == "time"


def test_a_step_that_is_neither_usual_nor_stated_is_not_guessed() -> None:
    problem = swinging()
    body = body_of(problem, GREEN)
    states = list(ImplicitStepper(body, Integrator.BACKWARD_EULER, 7, 8).outputs())
    assert of_motion(problem, states).explanations == ()
    (found,) = of_motion(problem, states, time_step=0.005 / 7).explanations
    assert found.name == f"{WORDS}backward Euler, steps of 0.0007143 s"
    # As in palpate's own words for semi-implicit Euler: damping at the end of a step.
    own = Stepper(body, 0.005 / 9, 9, 8)
    states = list(own.outputs(MotionHypothesis(is_semi_implicit=True, is_damped_at_end=True)))
    (found,) = of_motion(problem, states, time_step=0.005 / 9).explanations
    assert found.name == (
        f"{WORDS}semi-implicit Euler, damping at the end of a step, 9 steps to an output"
    )
