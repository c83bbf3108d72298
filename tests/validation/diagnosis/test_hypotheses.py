"""Mistakes that are tried, one by one: what each means in numbers known by hand."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bank import loaded_bar
from judged import case_of, solved, state_of

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Traction
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.transforms import rotation
from palpate.validation.diagnosis import diagnose
from palpate.validation.diagnosis.explanation import in_words
from palpate.validation.diagnosis.law_checks import (
    cause_of_stress,
    compare_stress,
    moduli_of,
    seeded_mistakes,
)
from palpate.validation.diagnosis.law_simulators import deformations, example_material
from palpate.validation.diagnosis.material_hypotheses import (
    _material_words,
    lame_factor_words,
    lame_hypotheses,
    lame_of,
)
from palpate.validation.diagnosis.motion_hypotheses import _misfit, motion_hypotheses
from palpate.validation.diagnosis.result_hypotheses import result_hypotheses
from palpate.validation.diagnosis.static_hypotheses import tool_force_hypotheses, turn_between
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.laws import finite_stress
from palpate.validation.metrics.stepping import MotionHypothesis, Stepper

GREEN = Strain.GREEN
ABSOLUTE = "volume of inverted cells by its absolute value (|det F|)"


def test_lames_parameters_as_mistakes_have_them() -> None:
    """Of lmbda = 2 and mu = 3: E = 3 (6 + 6) / 5 = 7.2, K = 2 + 2, plane stress 12 / 8.

    nu = 0.5 2 / 5 = 0.2: nu / (1 - nu) = 1/4, nu / (1 + nu) = 1/6 with the same E; plane strain has
    E' = 7.2 / 0.96 = 7.5 and 1/4, so that lmbda = 7.5 0.25 / (1.25 0.5) = 3.
    """
    expected = {
        "Lamé's parameters exchanged": (3.0, 2.0),
        "bulk modulus instead of Lamé's lmbda": (4.0, 3.0),
        "Lamé's lmbda instead of the bulk modulus": (0.0, 3.0),
        "mu instead of 2 mu": (2.0, 1.5),
        "4 mu instead of 2 mu": (2.0, 6.0),
        "Young's modulus instead of mu": (2.0, 7.2),
        "lmbda of plane stress": (1.5, 3.0),
        "constants of plane strain, E / (1 - nu^2) and nu / (1 - nu)": (3.0, 3.0),
        "Poisson's ratio nu / (1 - nu), of plane strain": (7.2 * 0.25 / (1.25 * 0.5), 7.2 / 2.5),
        "Poisson's ratio nu / (1 + nu), of plane stress": (
            7.2 / 6 / (7 / 6 * 4 / 6),
            7.2 / (14 / 6),
        ),
        "lmbda left out": (0.0, 3.0),
        "Young's modulus and the shear modulus taken for lmbda and mu": (7.2, 3.0),
    }
    found = lame_hypotheses(2.0, 3.0, Law.NEO_HOOKEAN)
    assert set(expected) == set(found)
    for name, pair in expected.items():
        assert tuple(map(float, found[name])) == pytest.approx(pair), name


@pytest.mark.parametrize(
    ("law", "pair"),
    [(Law.NEO_HOOKEAN_STABLE, (-1.0, 3.0)), (Law.NEO_HOOKEAN_STABLE_LOG, (0.125, 2.25))],
)
def test_constants_of_a_stable_law_are_a_mistake_under_it_alone(
    law: Law, pair: tuple[float, float]
) -> None:
    """Of lmbda = 2 and mu = 3: 2 - 3; 2 - 5/8 3 and 3/4 3."""
    more = set(lame_hypotheses(2.0, 3.0, law)) - set(lame_hypotheses(2.0, 3.0, Law.NEO_HOOKEAN))
    (name,) = more
    assert tuple(map(float, lame_hypotheses(2.0, 3.0, law)[name])) == pytest.approx(pair)


@pytest.mark.parametrize("law", list(Law))
@pytest.mark.parametrize("nu", [0.1, 0.3, 0.4, 0.45])
def test_mistakes_of_lames_parameters_are_three_digits_apart(nu: float, law: Law) -> None:
    lmbda, mu = nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu)
    found = {name: np.array(pair) for name, pair in lame_hypotheses(lmbda, mu, law).items()}
    asked = np.array([lmbda, mu])
    for (a, first), (b, second) in itertools.combinations({"asked": asked, **found}.items(), 2):
        assert np.abs(first - second).max() > 1e-3 * asked.max(), (a, b)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.0, "left out"),
        (-1.0, "reversed"),
        (2.0, "counted twice"),
        (0.5, "halved"),
        (1e3, "1000 times too large"),
        (-1e-3, "1000 times too small and reversed"),
        (1.25, "1.25 times what was asked"),
        (-0.5, "-0.5 times what was asked"),
    ],
)
def test_a_factor_in_words(factor: float, words: str) -> None:
    assert in_words(factor) == words


def test_deformations_go_from_three_tenths_to_three_in_order() -> None:
    for kind in ("uniaxial", "volumetric"):
        of = np.linalg.det(deformations(Law.NEO_HOOKEAN)[kind])
        assert (np.diff(of) > 0.0).all()
        assert of[[0, -1]] == pytest.approx([0.3, 3.0])


def test_the_seeded_anisotropy_is_a_tenth_along_one_axis() -> None:
    material = example_material(Law.SAINT_VENANT_KIRCHHOFF)
    law: Any = SimpleNamespace(stress=lambda F: np.ones_like(F))
    (seeded,) = [s for s in seeded_mistakes(law, material) if "along x" in s.name]
    assert np.array_equal(seeded.stress(np.eye(3)[None]), [[[1.1, 1.0, 1.0]] * 3])


def swinging() -> Any:
    """A bar under a weight that grows over the first half, and falls back."""
    problem = loaded_bar((3, 1, 1))
    ramp = TabularAmplitude((0.0, 0.02, 0.04), (0.0, 1.0, 0.2))
    times = TimeSpan(0.04, time_step=1e-3, num_outputs=8, mass_damping=3.0)
    problem = replace(problem, loads=(BodyForce((0.0, 200.0, -600.0), ramp),), time=times)
    run = simulate(problem)
    return problem, run, Stepper(body_of(problem, GREEN), run.time_step, run.num_steps // 8, 8)


def test_the_stepper_makes_the_steps_of_the_equations() -> None:
    _, run, stepper = swinging()
    states = np.array(list(stepper.outputs(MotionHypothesis())))
    largest = np.abs(run.displacements).max()
    assert np.abs(states - run.displacements[1:]).max() < 1e-9 * largest


@pytest.mark.parametrize("late", [-1, 1])
def test_states_that_come_a_step_early_or_late(late: int) -> None:
    """As many outputs; each is the state of a step later, or before."""
    _, run, stepper = swinging()
    every = stepper.per_output
    each = replace(stepper, per_output=1, num_outputs=run.num_steps + 1)
    steps = list(each.outputs(MotionHypothesis()))
    states = list(stepper.outputs(MotionHypothesis(late=late)))
    assert len(states) == 8
    for number, state in enumerate(states, start=1):
        assert np.array_equal(state, steps[number * every - late - 1])


def test_the_distance_of_a_motion_is_over_its_largest_displacement() -> None:
    _, _, stepper = swinging()
    states = np.array(list(stepper.outputs(MotionHypothesis())))
    assert _misfit(stepper, MotionHypothesis(), 2.0 * states, None) == pytest.approx(0.5, rel=1e-12)
    assert _misfit(stepper, MotionHypothesis(), 0.0 * states, None) == np.inf


@pytest.mark.parametrize(
    ("name", "hypothesis"),
    [
        ("damping reversed in sign", MotionHypothesis(damping=-3.0)),
        ("damping left out", MotionHypothesis(damping=0.0)),
        ("every state stored one step late", MotionHypothesis(late=-1)),
        ("every state stored one step early", MotionHypothesis(late=1)),
        (
            "another time integration: semi-implicit Euler",
            MotionHypothesis(is_semi_implicit=True),
        ),
        (
            "another time integration: semi-implicit Euler, damping at the end of a step",
            MotionHypothesis(is_semi_implicit=True, is_damped_at_end=True),
        ),
        (
            "another time integration: explicit Euler",
            MotionHypothesis(is_explicit_euler=True),
        ),
    ],
)
def test_a_motion_with_a_mistake_is_that_of_its_hypothesis(
    name: str, hypothesis: MotionHypothesis
) -> None:
    _, run, stepper = swinging()
    states = np.concatenate([run.displacements[:1], list(stepper.outputs(hypothesis))])
    fitting = [e.name for e in motion_hypotheses(stepper, states) if e.fits]
    assert fitting == [name]


def test_motions_at_other_times_are_compared_by_their_largest_distance() -> None:
    """A point that goes at one speed, another at half of it; everything comes an output late."""
    speed = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    reference = np.arange(6.0)[:, None, None] * speed
    fields = np.concatenate([reference[:1], reference[:-1]])
    found = {e.name: e.residual for e in result_hypotheses(fields, reference, np.zeros((2, 3)))}
    assert found["time shifted: 1 output late"] == 0.0
    assert found["time shifted: 1 output early"] == pytest.approx(2.0 / 5.0)
    assert found["time shifted: 2 outputs late"] == pytest.approx(1.0 / 5.0)


def test_forces_of_tools_are_explained_only_where_the_displacement_is_right() -> None:
    force, u = np.array([[0.0, 0.0, 2.0]]), np.ones((4, 3))
    theirs: Any = SimpleNamespace(tool_forces=force, displacement=u, max_displacement=1.0)

    def found(factor: float, apart: float) -> list[tuple[str, int]]:
        ours: Any = SimpleNamespace(tool_forces=factor * force, displacement=u + apart)
        return [(e.name, e.complexity) for e in tool_force_hypotheses(ours, theirs)]

    assert found(-1.0, 0.0) == [("force on the tools reversed", 1)]
    assert found(1.37, 0.0) == [
        ("force on the tools 1.37 times what was asked: the stiffness, or the unit of force", 2)
    ]
    assert found(-1.0, 0.1) == []


def test_a_right_result_is_said_to_satisfy_the_equations_or_to_be_another_equilibrium() -> None:
    problem = case_of("block").problem
    right = solved(problem)
    uneven = 1.0 + 0.1 * np.arange(problem.mesh.num_points)[:, None] % 0.7
    other = state_of(problem, uneven * right.displacement)
    for reference, says in ((None, "kept on this mesh"), (other, "another equilibrium")):
        first = diagnose(problem, right, reference).first
        assert first is not None
        assert says in first.name


def test_only_few_points_are_said_to_be_where_the_equations_fail() -> None:
    problem = case_of("beam").problem
    right = solved(problem).displacement
    free = np.flatnonzero(body_of(problem, GREEN).free.any(axis=1))
    rng = np.random.default_rng(3)
    for count, is_said in ((1, True), (len(free), False)):
        moved = right.copy()
        moved[free[:count]] += 1e-3 * rng.standard_normal((count, 3)) * np.abs(right).max()
        found = diagnose(problem, state_of(problem, moved), None)
        assert ("hold but at" in found.hint) is is_said


def test_a_motion_of_few_outputs_is_not_explained_by_a_shift_that_leaves_fewer_than_three() -> None:
    reference = np.arange(4.0)[:, None, None] * np.ones((2, 3))
    found = {e.name for e in result_hypotheses(2.5 * reference, reference, np.zeros((2, 3)))}
    late, early = "time shifted: 1 output late", "time shifted: 1 output early"
    assert {name for name in found if name.startswith("time shifted")} == {late, early}


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0, ""),
        (1.234, ""),
        (2.0, "Lamé's lmbda 2.000 times what was asked"),
        (0.7, "Lamé's lmbda 0.700 times what was asked = (1 - nu)"),
        (2.5, "Lamé's lmbda 2.500 times what was asked = 1 / (1 - 2 nu)"),
    ],
)
def test_a_known_factor_of_one_of_lames_parameters_at_nu_0_3(factor: float, words: str) -> None:
    assert lame_factor_words("lmbda", factor, 0.3) == words


@pytest.mark.parametrize("factor", [1e3, 1e-3, 100.0, 0.01, 1e6, 1e-6])
def test_a_result_whose_lengths_were_given_in_another_unit_is_named(factor: float) -> None:
    """The same force on a body so many times as large: its area by the square of that."""
    problem = case_of("block").problem
    points = problem.mesh.points
    facets = problem.mesh.boundary_facets
    end = facets[(points[facets][:, :, 0] > points[:, 0].max() - 1e-9).all(axis=1)]
    x, z = 500.0, 300.0
    pulled = replace(problem, loads=(Traction(end, (factor**2 * x, 0.0, factor**2 * z)),))
    larger = TetMesh(factor * points, problem.mesh.cells)
    stretched = replace(problem, mesh=larger, loads=(Traction(end, (x, 0.0, z)),))
    result = state_of(pulled, solved(stretched).displacement)
    names = [e.name for e in diagnose(pulled, result, None).explanations]
    assert any(name.startswith(f"lengths given {in_words(factor)}") for name in names), names


def test_a_stress_of_no_law_is_said_where_it_is_farthest_off() -> None:
    material = example_material(Law.SAINT_VENANT_KIRCHHOFF)
    F = deformations(material.law)["shear"]
    lmbda, mu = (np.full(len(F), of) for of in lame_of(material))
    right = finite_stress(material.law, F - np.eye(3), lmbda, mu, 0.0 * mu)
    wrong = right.copy()
    wrong[1, 0, 2] += 0.5 * np.abs(right).max()
    assert cause_of_stress(wrong, material, F) == ""
    assert compare_stress(wrong, material, "shear", F, 1e-10).message == (
        f"the stress is of no law known here: P13 = {wrong[1, 0, 2]:.6g} Pa where "
        f"{right[1, 0, 2]:.6g} Pa was stated"
    )


def test_a_stress_that_is_no_number_is_called_so() -> None:
    material = example_material(Law.SAINT_VENANT_KIRCHHOFF)
    F = deformations(material.law)["shear"]
    P = np.zeros_like(F)
    P[1, 0, 2] = np.nan
    message = compare_stress(P, material, "shear", F, 1e-10).message
    assert message == "the stress is no finite number"


def test_moduli_are_called_by_the_one_number_that_is_wrong_or_by_both() -> None:
    """What a simpler explanation costs less decides between two that fit alike."""
    asked = example_material(Law.SAINT_VENANT_KIRCHHOFF)
    E, (lmbda, mu) = asked.youngs_modulus, lame_of(asked)

    def words(lmbda: float, mu: float) -> tuple[str, int]:
        return _material_words(asked, lmbda, mu, has_forces=True)

    assert words(3.0 * lmbda, mu) == ("Lamé's lmbda 3.000 times what was asked", 2)
    assert words(lmbda, 1.5 * mu) == ("Lamé's mu 1.500 times what was asked", 2)
    other = lame_of(replace(asked, poissons_ratio=0.37))
    assert words(*other) == ("Poisson's ratio 0.37 instead of 0.4", 2)
    other = lame_of(replace(asked, youngs_modulus=1.23 * E, poissons_ratio=0.37))
    both = "Young's modulus 1.23 times what was asked, and Poisson's ratio 0.37 instead of 0.4"
    assert words(*other) == (both, 3)


@pytest.mark.parametrize("law", list(Law))
def test_moduli_are_named_from_all_deformations_and_never_from_those_that_do_not_tell(
    law: Law,
) -> None:
    """A shear modulus of 1.03 times; in one kind alone, another pair may give the same stresses."""
    material = example_material(law)
    kinds = deformations(law)
    every = np.concatenate(list(kinds.values()))

    def of(F: Any, lmbda: float, mu: float) -> Any:
        of_lmbda, of_mu, c01, terms = moduli_of(material, len(F))
        H = F - np.eye(3)
        return finite_stress(law, H, lmbda * of_lmbda, mu * of_mu, mu * c01, terms)

    words = "the stress is that of the stated law with lmbda times {:g} and mu times {:g}"
    assert cause_of_stress(of(every, 1.0, 1.03), material, every) == words.format(1, 1.03)
    assert cause_of_stress(of(every, 2.0, 1.0), material, every) == words.format(2, 1)
    assert cause_of_stress(of(every, 1.0, -1.2389), material, every) == ""
    assert cause_of_stress(of(every, -0.5, 1.0), material, every) == ""
    assert cause_of_stress(of(every, 0.0, 1.0), material, every) == words.format(0, 1)
    for F in kinds.values():
        found = cause_of_stress(of(F, 1.0, 1.03), material, F)
        assert found in ("", words.format(1, 1.03)) or "that of" in found
        assert "lmbda times" not in found or found == words.format(1, 1.03)


def test_a_cell_that_changes_its_volume_alone_does_not_tell_the_moduli_apart() -> None:
    material = example_material(Law.SAINT_VENANT_KIRCHHOFF)
    F = deformations(material.law)["volumetric"]
    lmbda, mu, c01, terms = moduli_of(material, len(F))
    P = finite_stress(material.law, F - np.eye(3), lmbda, 1.03 * mu, c01, terms)
    assert cause_of_stress(P, material, F) == ""


@pytest.mark.parametrize("angle", [1e-3, 60.0, 119.99, 180.0])
def test_a_turn_between_vectors_is_found_with_its_axis(angle: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    R = rotation(tuple(axis), angle)
    vectors = np.random.default_rng(4).normal(size=(9, 3))
    found, words = turn_between(vectors, vectors @ R.T) or (np.eye(3), "")
    assert found == pytest.approx(R, abs=1e-12)
    # Of half a turn both ends of the axis are right.
    ends = ("(0.667, -0.333, 0.667)", "(-0.667, 0.333, -0.667)")
    assert words in {f"{angle:.2f} degrees about {end}" for end in ends[: 1 + (angle == 180.0)]}


def test_vectors_of_one_direction_are_turned_by_the_smallest_angle() -> None:
    """Of z to y: about x, backwards; a reversal is none, and neither is nothing."""
    along = np.linspace(1.0, 2.0, 5)[:, None]
    down, right = along * [0.0, 0.0, 1.0], along * [0.0, 1.0, 0.0]
    found, words = turn_between(down, right) or (np.eye(3), "")
    assert words == "90.00 degrees about (-1, 0, 0)"
    assert down @ found.T == pytest.approx(right)
    for to in (-down, down):
        assert turn_between(down, to) is None


def absolute_stress(law: Law, F: Any, lmbda: Any, mu: Any) -> Any:
    """P of neo-Hookean laws with |J| for J: the derivative of |J| is J F^-T times its sign."""
    J = np.linalg.det(F)[:, None, None]
    inverse = np.linalg.inv(F).transpose(0, 2, 1)
    lmbda, mu = lmbda[:, None, None], mu[:, None, None]
    if law is Law.NEO_HOOKEAN:
        return mu * (F - inverse) + lmbda * np.log(np.abs(J)) * inverse
    return mu * F + ((lmbda + mu) * (np.abs(J) - 1.0) - mu) * np.abs(J) * inverse


@pytest.mark.parametrize("law", [Law.NEO_HOOKEAN, Law.NEO_HOOKEAN_STABLE])
def test_inverted_cells_by_the_absolute_value_of_their_volume_are_named(law: Law) -> None:
    """A point beyond its cell's opposite face, loaded as the energy of |det F| asks for."""
    problem = case_of("block").problem
    asked = replace(problem, material=replace(problem.material, law=law), loads=())
    u = solved(problem).displacement
    u[problem.mesh.boundary_facets[-1][0]] -= 0.6 * np.ptp(problem.mesh.points, axis=0)
    body = body_of(asked, GREEN)
    F = np.eye(3) + body.gradient(u)
    assert (np.linalg.det(F) < 0.0).any()
    points = np.arange(problem.mesh.num_points, dtype=np.int32)
    stress = absolute_stress(law, F, body.lmbda, body.mu)
    load = PointForce(points, body.force_of(stress))
    found = diagnose(replace(asked, loads=(load,)), state_of(problem, u), None)
    assert found.first is not None
    assert found.first.name == ABSOLUTE
