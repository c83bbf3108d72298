"""Mistakes seeded into a simulator that is not palpate's: each is named, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from judged import case_of, references_of

from palpate.meshes.problem import Strain
from palpate.validation.diagnosis import Cause, Diagnosis, diagnose
from palpate.validation.diagnosis.explanation import DOUBLE, FAR_BETTER
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.solving import simulate
from palpate.validation.states import State

OTHER = {Strain.GREEN: Strain.LINEAR, Strain.LINEAR: Strain.GREEN}
# Mistakes of the result: its body does not balance as it is written down.
OF_SOLUTION = {
    "millimetres": "displacement in millimetres",
    "sign": "displacement reversed in sign",
    "swapped-axes": "components x and y exchanged",
    "positions": "positions sent for displacements",
}
ABOUT_Z = "turned by 60.00 degrees about (0, 0, 1)"
OF_ORDER = {
    "solution-turned": f"displacement {ABOUT_Z}: a parent's rotation left out",
    "positions-turned": f"positions {ABOUT_Z}: a parent's rotation left out",
    "other-order": "points in another order",
    "numbered-from-1": "points numbered one off",
}
# Mistakes of the problem: the body balances by other equations.
OF_PROBLEM = {
    "other-strain": "linear strain instead of Green strain",
    "engineering-shear": "engineering shear strain taken for tensor shear: shear stresses doubled",
    "not-pushed-forward": "second Piola-Kirchhoff stress not pushed forward (P = S instead of F S)",
    "neo-hookean": "neo-Hookean law, with ln J",
    "pressure-sign": "sign of the pressure reversed: load 1 (pressure) pulls",
    "dead-pressure": "pressure does not follow the surface (dead load)",
    "no-pressure": "load 1 (pressure) left out",
    "no-dead-loads": "dead loads (external_force) all left out",
    # The block's body force is its weight, which the simulator adds once more.
    "weight-twice": "load 2 (body force) counted twice",
    "pascal-as-kilopascal": "stiffness 1000 times too large (stress in kPa where Pa was asked), "
    "or every load 1000 times too small",
    "softer": "stiffness 0.98 times what was asked, or every load 1.02041 times what was asked",
    # 1 / 0.98 = 1.02041
    "loads-98": "stiffness 1.02041 times what was asked, or every load 0.98 times what was asked",
    # 0.4 + 0.03
    "poisson": "Poisson's ratio 0.43 instead of 0.4",
    "swapped-lame": "Lamé's parameters exchanged",
    # lmbda + 2 mu = 10 kPa 0.6 / (1.4 0.2) = 21429 Pa, and mu = 10 kPa / 2.8 = 3571 Pa more.
    # (1 - 2 nu) / (1 - nu) at nu = 0.4
    "plane-stress": "lmbda of plane stress, or Lamé's lmbda 0.333 times what was asked",
    "plane-stress-ratio": "Poisson's ratio nu / (1 + nu), of plane stress",
    "young-for-shear": "Young's modulus instead of mu",
    "weight-turned": "load 2 (body force) turned by 90.00 degrees about (-1, 0, 0): gravity in "
    "another frame",
    # R f = load, and so f = R^T load: turned back.
    "parent-turned": "every load turned by 60.00 degrees about (0, 0, -1): a load in another "
    "frame, or a parent's rotation left out",
    "orthotropic": "the law is not isotropic: C11 25000 Pa where 21429 Pa was asked",
    "half-support": "support 1 is fixed in part: 3 of its 9 points are not fixed",
    "millimetre-mesh": "lengths given 1000 times too large, the displacement with them; forces "
    "and stresses as they are",
}
# Those that make the block so soft that it bears a third of its loads alone.
OF_SOFTER = {
    "tensor-shear": "tensor shear strain taken for engineering shear: shear stresses halved",
    # 1 / 2.8 and 1 - 0.4
    "shear-for-young": "stiffness 0.357143 times what was asked = 1 / (2 (1 + nu)), or every load "
    "2.8 times what was asked",
    "one-minus-nu": "stiffness 0.6 times what was asked = (1 - nu), or every load 1.66667 times "
    "what was asked",
}
OF_MOTION = {
    "no-damping": "damping left out",
    "damping-twice": "damping twice what was asked (D = 2 lambda M)",
    "heavier": "density 1.02 times what was asked",
    "masses-by-cells": "another lumping: by the number of cells at a point, not by volume",
    "equal-masses": "another lumping: every point the same mass",
    "wrong-start": "wrong start: the step before the first taken for the first, without half of "
    "its acceleration",
    "semi-implicit": "another time integration: semi-implicit Euler",
    "one-output-late": "time shifted: 1 output late",
    "half-step": "a time step 2 times shorter",
    "other-strain": "linear strain instead of Green strain",
    "softer": "stiffness 0.98 times what was asked",
}


def named(diagnosis: Diagnosis) -> str:
    first = diagnosis.first
    assert first is not None, str(diagnosis)
    assert first.residual <= DOUBLE
    assert FAR_BETTER * first.residual <= first.stated
    assert f"fits '{first.name}'" in str(diagnosis)
    return first.name


def test_every_mistake_that_can_be_seeded_is_tried_here() -> None:
    from .conftest import load_simulator

    mistakes = load_simulator().MISTAKES
    assert set(mistakes["statics"]) == {
        *(*OF_SOLUTION, *OF_ORDER, *OF_PROBLEM, *OF_SOFTER, "single")
    }
    assert set(mistakes["motion"]) == set(OF_MOTION)


@pytest.mark.parametrize(("mistake", "name"), (OF_SOLUTION | OF_ORDER | OF_PROBLEM).items())
def test_a_seeded_mistake_is_named(
    mistake: str, name: str, solutions: Any, reference: Callable[[str], State]
) -> None:
    problem = case_of("block").problem
    diagnosis = diagnose(problem, solutions.of("block", mistake), reference("block"))
    assert named(diagnosis) == name
    # The block is lopsided: no other mistake does the same to it.
    assert len(diagnosis.explanations) == 1


@pytest.mark.parametrize(("mistake", "name"), (OF_SOLUTION | OF_PROBLEM).items())
def test_a_seeded_mistake_is_named_without_a_reference(
    mistake: str, name: str, solutions: Any
) -> None:
    problem = case_of("block").problem
    assert named(diagnose(problem, solutions.of("block", mistake), None)) == name


@pytest.mark.parametrize(("mistake", "name"), OF_SOFTER.items())
def test_a_mistake_that_makes_the_body_softer_is_named(
    mistake: str, name: str, solutions: Any
) -> None:
    problem = case_of("block").problem
    pressure, weight, force = problem.loads
    loads = (
        replace(pressure, pressure=0.3 * pressure.pressure),
        replace(weight, force_density=tuple(0.3 * f for f in weight.force_density)),
        replace(force, traction=tuple(0.3 * f for f in force.traction)),
    )
    problem = replace(problem, loads=loads)
    diagnosis = diagnose(problem, solutions.to(problem, Strain.GREEN, mistake), None)
    assert named(diagnosis) == name
    assert len(diagnosis.explanations) == 1


@pytest.mark.parametrize(("mistake", "name"), OF_MOTION.items())
@pytest.mark.long
def test_a_mistake_in_a_motion_is_named(
    mistake: str, name: str, solutions: Any, reference: Callable[[str], State]
) -> None:
    problem = case_of("block-motion").problem
    diagnosis = diagnose(problem, solutions.of("block-motion", mistake), reference("block-motion"))
    assert named(diagnosis) == name
    assert len(diagnosis.explanations) == 1


@pytest.mark.parametrize(
    ("factor", "name"),
    [
        (0.0, "stiffness damping left out"),
        (2.0, "stiffness damping twice what was asked"),
        pytest.param(
            1.25, "stiffness damping 1.25 times what was asked", marks=pytest.mark.nightly
        ),
    ],
)
def test_a_mistake_in_stiffness_damping_is_named(factor: float, name: str) -> None:
    problem = case_of("block-motion").problem
    asked, had = (
        replace(problem, time=replace(problem.time, stiffness_damping=beta))
        for beta in (4e-4, 4e-4 * factor)
    )
    assert named(diagnose(asked, simulate(had), None)) == name


# Every pair of case, mistake and reference; all three together by night.
UNNAMED = [
    pytest.param(
        case,
        mistake,
        has_reference,
        marks=() if (k + m + has_reference) % 2 else pytest.mark.nightly,
    )
    for k, case in enumerate(("block", "block-motion"))
    for m, mistake in enumerate(("noise", "corner", "dropped-cell", "moved-node"))
    for has_reference in (True, False)
]


@pytest.mark.parametrize(("case", "mistake", "has_reference"), UNNAMED)
@pytest.mark.long
def test_a_mistake_that_nothing_fits_is_given_no_name(
    case: str,
    mistake: str,
    has_reference: bool,
    solutions: Any,
    reference: Callable[[str], State],
) -> None:
    known = reference(case) if has_reference else None
    diagnosis = diagnose(case_of(case).problem, solutions.of(case, mistake), known)
    assert diagnosis.explanations == ()
    assert str(diagnosis).startswith(f"none of {diagnosis.tested} explanations fits")
    # In motion, without a reference, only the steps are left to try.
    assert diagnosis.tested > 40


@pytest.mark.parametrize(
    ("case", "mistake"), [("block", "unconverged"), ("block-motion", "jitter")]
)
@pytest.mark.long
def test_a_wrong_number_that_is_no_mistake_is_given_no_name(
    case: str, mistake: str, solutions: Any, reference: Callable[[str], State]
) -> None:
    diagnosis = diagnose(case_of(case).problem, solutions.of(case, mistake), reference(case))
    assert diagnosis.explanations == ()
    assert diagnosis.stated > 1e-3


def test_a_solution_that_is_perturbed_at_one_point_is_located(
    solutions: Any, reference: Callable[[str], State]
) -> None:
    problem = case_of("block").problem
    reported = diagnose(problem, solutions.of("block", "corner"), reference("block")).hint
    # The corner (40, 25, 20) mm and the points that share a cell with it.
    assert "hold but at 4 of 44 points, about (37.5, 21.8" in reported


@pytest.mark.parametrize("case", ["block", "block-motion"])
def test_a_right_solution_is_said_to_agree(
    case: str, solutions: Any, reference: Callable[[str], State]
) -> None:
    diagnosis = diagnose(case_of(case).problem, solutions.of(case), reference(case))
    assert [e.cause for e in diagnosis.explanations] == [Cause.AGREES]
    assert "fits" not in str(diagnosis)


def test_single_precision_is_distinguished_from_a_mistake(
    solutions: Any, reference: Callable[[str], State]
) -> None:
    problem = case_of("block").problem
    diagnosis = diagnose(problem, solutions.of("block", "single"), reference("block"))
    assert [e.cause for e in diagnosis.explanations] == [Cause.PRECISION]
    assert "agrees to single precision" in str(diagnosis)


def test_green_strain_instead_of_linear_strain_is_named(solutions: Any) -> None:
    """The other way round, against the reference's linear solution."""
    problem = case_of("block").problem
    states = references_of("block").states
    state = solutions.to(problem, Strain.LINEAR, "other-strain")
    other = states[SAME_MESH, Strain.GREEN]
    for reference in (states[SAME_MESH, Strain.LINEAR], None):
        diagnosis = diagnose(problem, state, reference, other_strain=other)
        assert named(diagnosis) == "Green strain instead of linear strain"


def test_what_a_linear_case_cannot_tell_apart_is_listed(solutions: Any) -> None:
    """Twice the loads, half the stiffness, twice the solution: the same numbers."""
    problem = case_of("block").problem
    reference = references_of("block").states[SAME_MESH, Strain.LINEAR]
    state = solutions.to(problem, Strain.LINEAR, "millimetres")
    diagnosis = diagnose(problem, state, reference)
    assert named(diagnosis) == "displacement in millimetres"
    others = [e.name for e in diagnosis.explanations[1:]]
    assert any("every load 1000 times too large" in name for name in others)
    assert "this case cannot tell them apart" in str(diagnosis)
