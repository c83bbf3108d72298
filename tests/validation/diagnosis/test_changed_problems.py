"""A static problem is solved with one mistake in it: the diagnosis of the solution names it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from judged import case_of, solved, state_of

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Material, Problem
from palpate.validation.diagnosis import Cause, diagnose
from palpate.validation.exchange.nodal_arrays import nodal_force


def name_of(asked: Problem, answered: Problem, reference=None) -> str:
    """What is named when another problem than the one asked for was solved."""
    state = state_of(asked, solved(answered).displacement)
    diagnosis = diagnose(asked, state, reference)
    assert diagnosis.first is not None, str(diagnosis)
    return diagnosis.first.name


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ((0.0, 0.0, 0.0), "prescribed displacement left out"),
        ((-0.1, 0.0, -0.04), "prescribed displacement reversed"),
        # 0.11 / 0.1 and 0.044 / 0.04
        ((0.11, 0.0, 0.044), "prescribed displacement 1.1 times what was asked"),
    ],
)
def test_a_support_that_moves_otherwise(change, name, problem):
    moved = np.flatnonzero(problem.mesh.points[:, 1] > 1.0 - 1e-9).astype(np.int32)[-6:]

    def with_support(displacement):
        fixed = Support(moved, displacement=displacement)
        return replace(problem, supports=(*problem.supports, fixed))

    asked = with_support((0.1, 0.0, 0.04))
    for reference in (solved(asked), None):
        assert name_of(asked, with_support(change), reference) == name


def test_supports_of_single_components_where_one_is_missing_or_one_too_many():
    """A bar in plane strain: its sides are fixed along z."""
    problem = case_of("csm1").problem
    clamp, *sides = problem.supports
    assert [s.components for s in sides] == [(False, False, True)] * 2
    loose = replace(problem, supports=(clamp, sides[0]))
    assert name_of(problem, loose) == "support 3 is not fixed"
    # The clamp and the sides fix everything but y at the bottom's points.
    firm = replace(sides[0], components=(True, False, True))
    stiff = replace(problem, supports=(clamp, firm, sides[1]))
    assert name_of(problem, stiff) == "support 2 fixes x as well"


def test_inclusions_that_are_left_out(problem):
    hard = Inclusion(np.arange(10, dtype=np.int32), Material(3000.0, 0.3))
    asked = replace(problem, inclusions=(hard,))
    assert name_of(asked, problem) == "inclusions left out: one material everywhere"


def test_poissons_ratio_is_found_where_no_force_says_how_stiff_the_body_is():
    mesh = brick_box((3, 2, 2), (0.03, 0.02, 0.02), ragged=0.2)
    x = mesh.points[:, 0]
    supports = (
        Support(np.flatnonzero(x < 1e-9).astype(np.int32)),
        Support(np.flatnonzero(x > 0.03 - 1e-9).astype(np.int32), displacement=(3e-3, 1e-3, 0.0)),
    )
    asked = Problem(mesh, Material(1e4, 0.4), supports, ())
    other = replace(asked, material=Material(1e4, 0.3))
    assert name_of(asked, other) == "Poisson's ratio 0.3 instead of 0.4"
    stiffer = solved(replace(asked, material=Material(2e4, 0.4)))
    same = diagnose(asked, state_of(asked, stiffer.displacement), None)
    assert [e.cause for e in same.explanations] == [Cause.AGREES]


def test_loads_that_are_each_wrong_in_their_own_way():
    problem = case_of("block").problem
    first, second, third = problem.loads
    first = replace(first, pressure=0.7 * first.pressure)
    third = replace(third, traction=tuple(1.2 * t for t in third.traction))
    assert name_of(problem, replace(problem, loads=(first, second, third))) == (
        "load 1 (pressure) 0.7 times what was asked, load 3 (traction) 1.2 times what was asked"
    )


def test_a_traction_shared_equally_between_its_points(problem):
    (load,) = problem.loads
    total = nodal_force(problem.mesh, load).sum(axis=0)
    points = np.unique(load.facets).astype(np.int32)
    equal = PointForce(points, np.tile(total / len(points), (len(points), 1)))
    words = "load 1 (traction) shared equally between its points"
    assert name_of(problem, replace(problem, loads=(equal,))) == words


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        *(
            ({"law": law}, f"{law} law")
            for law in (
                Law.SAINT_VENANT_KIRCHHOFF,
                Law.NEO_HOOKEAN_STABLE,
                Law.NEO_HOOKEAN_STABLE_LOG,
                Law.NEO_HOOKEAN_ISOCHORIC,
            )
        ),
        ({"poissons_ratio": 0.35}, "Poisson's ratio 0.35 instead of 0.3"),
        ({}, "the stated equations are kept on this mesh"),
    ],
)
def test_a_law_or_modulus_instead_of_neo_hookes(changes, name):
    problem = case_of("stretch").problem
    material = replace(problem.material, law=Law.NEO_HOOKEAN)
    asked = replace(problem, material=material, loads=(BodyForce((0.0, 9e3, -2e4)),))
    assert name_of(asked, replace(asked, material=replace(material, **changes))) == name


# Squeezed between forces: with the sides free both of Lamé's parameters are seen.
@pytest.mark.parametrize(
    ("of_lmbda", "of_mu", "words"),
    [
        (2.0, 1.0, "Lamé's lmbda 2.000 times what was asked"),
        (1.0, 3.0, "Lamé's mu 3.000 times what was asked"),
        (1.0 / 3.0, 1.0, "Lamé's lmbda 0.333 times what was asked"),
        (0.7, 1.0, "Lamé's lmbda 0.700 times what was asked = (1 - nu)"),
        (0.5, 1.0, "Lamé's lmbda 0.500 times what was asked"),
        (1.0, 0.5, "mu instead of 2 mu"),
        # nu = 0.3: 2 nu mu / (1 - 3 nu) = 6 mu, and lmbda = 1.5 mu
        (
            4.0,
            1.0,
            "constants of plane strain, E / (1 - nu^2) and nu / (1 - nu), or Lamé's lmbda 4.000 "
            "times what was asked",
        ),
        (2.003, 1.0, None),
        (1.997, 1.0, None),
        (0.702, 1.0, None),
    ],
)
def test_one_of_lames_parameters_is_named_and_distinguished_from_its_neighbours(
    of_lmbda, of_mu, words
):
    problem = case_of("stretch").problem
    asked = replace(problem, loads=(BodyForce((0.0, 9e3, -2e4)),))
    E, nu = asked.material.youngs_modulus, asked.material.poissons_ratio
    assert nu == 0.3
    lmbda = of_lmbda * E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    mu = of_mu * E / (2.0 * (1.0 + nu))
    has = replace(
        asked.material,
        youngs_modulus=mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu),
        poissons_ratio=0.5 * lmbda / (lmbda + mu),
    )
    found = name_of(asked, replace(asked, material=has))
    if words is None:
        assert "Lamé" not in found
        assert "Poisson's ratio" in found
    else:
        assert found == words


def test_lambda_without_forces_is_one_of_several():
    asked = case_of("stretch").problem
    other = replace(asked, material=replace(asked.material, poissons_ratio=0.375))
    assert name_of(asked, other) == (
        "Lamé's lmbda 2.000 times what was asked, or Poisson's ratio 0.375 instead of 0.3, or mu "
        "instead of 2 mu: without forces they are the same"
    )


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (3.0, "stiffness 3 times what was asked, or every load 0.333333 times what was asked"),
        (0.5, "stiffness 0.5 times what was asked, or every load counted twice"),
        (
            0.91,
            "stiffness 0.91 times what was asked = (1 - nu^2), or every load 1.0989 times what "
            "was asked",
        ),
        (0.911, "stiffness 0.911 times what was asked, or every load 1.09769 times what was asked"),
    ],
)
def test_a_factor_of_the_stiffness_is_named_and_distinguished_from_its_neighbours(factor, words):
    problem = case_of("stretch").problem
    asked = replace(problem, loads=(BodyForce((0.0, 9e3, -2e4)), BodyForce((1e3, 0.0, 0.0))))
    modulus = factor * asked.material.youngs_modulus
    stiffer = replace(asked, material=replace(asked.material, youngs_modulus=modulus))
    assert name_of(asked, stiffer) == words


def test_gravity_that_was_not_asked_for_is_named_with_its_size(problem):
    weight = BodyForce(tuple(1000.0 * g for g in (0.0, 0.01, -0.0981)))
    asked = replace(problem, material=replace(problem.material, density=1000.0))
    heavy = replace(asked, loads=(*asked.loads, weight))
    name = "gravity of (0, 0.01, -0.0981) m/s2 that was not asked for"
    for reference in (solved(asked), None):
        assert re.sub(r"-?\d\.?\d*e-1\d", "0", name_of(asked, heavy, reference)) == name


@pytest.mark.parametrize("angle", [0.5, 60.0, 60.1])
def test_gravity_in_another_frame_is_named_with_its_angle(angle):
    problem = case_of("stretch").problem
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    down = replace(problem, loads=(BodyForce((0.0, 0.0, -2e4)),))
    turned = replace(problem, loads=(BodyForce((0.0, 2e4 * s, -2e4 * c)),))
    assert name_of(down, turned) == (
        f"load 1 (body force) turned by {angle:.2f} degrees about (1, 0, 0): gravity in another "
        "frame, or a parent's rotation left out"
    )
