"""Slips of supports, materials and loads of a static case, each named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.diagnosis import Cause, Diagnosis, diagnose
from palpate.validation.metrics import make_state
from palpate.validation.states import State

Field = NDArray[np.float64]


def state(problem: Problem, displacement: Field, strain: Strain = Strain.GREEN) -> State:
    return make_state(problem.mesh, displacement, label="c", simulator="c", strain=strain)


def name_of(diagnosis: Diagnosis) -> str:
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
def test_a_support_that_moves_otherwise_is_named(
    change: tuple[float, float, float], name: str, problem: Problem
) -> None:
    moved = np.flatnonzero(problem.mesh.points[:, 1] > 1.0 - 1e-9).astype(np.int32)[-6:]

    def with_support(displacement: tuple[float, float, float]) -> Problem:
        held = Support(moved, displacement=displacement)
        return dataclasses.replace(problem, supports=(*problem.supports, held))

    asked = with_support((0.1, 0.0, 0.04))
    answered = solve_static(with_support(change)).displacement
    truth = state(asked, solve_static(asked).displacement)
    for reference in (truth, None):
        diagnosis = diagnose(asked, state(asked, answered), reference)
        assert name_of(diagnosis) == name


def test_supports_of_single_components_are_named_where_one_is_missing_or_one_too_many() -> None:
    """A bar in plane strain: its sides are held along z."""
    problem = load_case("csm1").problem
    clamp, *sides = problem.supports
    assert [s.components for s in sides] == [(False, False, True)] * 2
    loose = dataclasses.replace(problem, supports=(clamp, sides[0]))
    answered = state(problem, solve_static(loose).displacement)
    assert name_of(diagnose(problem, answered, None)) == "support 3 is not fixed"
    # The clamp and the sides hold everything but y at the bottom's points.
    firm = dataclasses.replace(sides[0], components=(True, False, True))
    stiff = dataclasses.replace(problem, supports=(clamp, firm, sides[1]))
    answered = state(problem, solve_static(stiff).displacement)
    assert name_of(diagnose(problem, answered, None)) == "support 2 fixes x as well"


def test_inclusions_that_are_left_out_are_named(problem: Problem) -> None:
    from palpate.meshes.problem import Inclusion

    cells = np.arange(10, dtype=np.int32)
    hard = Inclusion(cells, Material(3000.0, 0.3))
    asked = dataclasses.replace(problem, inclusions=(hard,))
    answered = state(asked, solve_static(problem).displacement)
    assert name_of(diagnose(asked, answered, None)) == (
        "inclusions left out: one material everywhere"
    )


def test_poissons_ratio_is_found_where_no_force_says_how_stiff_the_body_is() -> None:
    mesh = brick_box((3, 2, 2), (0.03, 0.02, 0.02), ragged=0.2)
    x = mesh.points[:, 0]
    supports = (
        Support(np.flatnonzero(x < 1e-9).astype(np.int32)),
        Support(np.flatnonzero(x > 0.03 - 1e-9).astype(np.int32), displacement=(3e-3, 1e-3, 0.0)),
    )
    asked = Problem(mesh, Material(1e4, 0.4), supports, ())
    other = dataclasses.replace(asked, material=Material(1e4, 0.3))
    answered = state(asked, solve_static(other).displacement)
    assert name_of(diagnose(asked, answered, None)) == "Poisson's ratio 0.3 in the place of 0.4"
    stiffer = dataclasses.replace(asked, material=Material(2e4, 0.4))
    same = diagnose(asked, state(asked, solve_static(stiffer).displacement), None)
    assert [e.cause for e in same.explanations] == [Cause.AGREES]


def test_loads_that_are_each_wrong_in_their_own_way_are_told_apart() -> None:
    problem = load_case("block").problem
    first, second, third = problem.loads
    given = dataclasses.replace(
        problem,
        loads=(
            dataclasses.replace(first, pressure=0.7 * first.pressure),
            second,
            dataclasses.replace(third, traction=tuple(1.2 * t for t in third.traction)),
        ),
    )
    answered = state(problem, solve_static(given).displacement)
    assert name_of(diagnose(problem, answered, None)) == (
        "load 1 (pressure) 0.7 times what was asked, load 3 (traction) 1.2 times what was asked"
    )


def test_a_traction_shared_equally_between_its_points_is_named(problem: Problem) -> None:
    from palpate.meshes.boundary_conditions import PointForce
    from palpate.validation.exchange.nodal_arrays import nodal_force

    (load,) = problem.loads
    total = nodal_force(problem.mesh, load).sum(axis=0)
    points = np.unique(load.facets).astype(np.int32)
    equal = PointForce(points, np.tile(total / len(points), (len(points), 1)))
    given = dataclasses.replace(problem, loads=(equal,))
    answered = state(problem, solve_static(given).displacement)
    assert name_of(diagnose(problem, answered, None)) == (
        "load 1 (traction) shared equally between its points"
    )
