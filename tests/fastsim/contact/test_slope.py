"""NAFEMS CGS-4: how hard a block has to be pushed before it slides up a slope."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import side
from palpate.meshes.problem import Element, TimeSpan
from palpate.meshes.rigid_tool import ContactRule, ToolPath
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.stepping import simulate_explicit

SLOPE, FRICTION = 0.1, 0.3
LIMIT = (SLOPE + FRICTION) / (1.0 - FRICTION * SLOPE)  # F / G at the onset of sliding
WEIGHT = 9.81 * 1000.0 * 0.04 * 0.02 * 0.02
WALL = 0.02 * 0.02  # [m2]


def test_the_numbers_of_the_case_are_the_closed_form() -> None:
    case = load_case("slope")
    along, down = (c.expected for c in case.checks if c.metric == "published_tool_force")
    assert pytest.approx(0.412371, abs=5e-7) == LIMIT
    assert along == pytest.approx(LIMIT * WEIGHT, rel=1e-12)
    assert down == pytest.approx(-WEIGHT, rel=1e-12)
    assert case.problem.mesh.volume * 9.81 * 1000.0 == pytest.approx(WEIGHT, rel=1e-12)


@pytest.mark.dolfinx
def test_over_facets_both_find_the_closed_form() -> None:
    problem = load_case("slope").with_contact(ContactRule.FACETS).problem
    assert problem.tools[0].contact is ContactRule.FACETS
    ours, theirs = simulate(problem), simulate_explicit(problem)
    forces = theirs.tool_forces[0]
    assert forces[-1, 0] == pytest.approx(LIMIT * WEIGHT, rel=1e-3)
    assert forces[-1, 2] == pytest.approx(-WEIGHT, rel=1e-3)
    assert np.abs(ours.tools[0].mean_forces - forces).max() < 1e-10 * WEIGHT
    size = np.abs(theirs.displacements).max()
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-10 * size


@pytest.mark.parametrize("rule", list(ContactRule))
@pytest.mark.parametrize("part", [0.98, 1.02])
def test_the_case_tells_two_per_cent_of_friction(part: float, rule: ContactRule) -> None:
    case = load_case("slope").with_contact(rule)
    tool = dataclasses.replace(case.problem.tools[0], friction_coefficient=part * FRICTION)
    found = simulate(dataclasses.replace(case.problem, tools=(tool,)))
    (check,) = [c for c in case.checks if c.component == "x"]
    assert check.expected is not None
    assert abs(found.tools[0].mean_forces[-1, 0] / check.expected - 1.0) > check.limit


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("part", [0.995, 1.005])
def test_a_block_starts_to_slide_within_half_a_percent_of_the_push(
    part: float, element: Element
) -> None:
    problem = load_case("slope").problem
    (tool,), (_, mirror) = problem.tools, problem.supports
    path = ToolPath([0.0], tool.path.positions[:1], tool.path.rotations[:1])
    rising = TabularAmplitude((0.1, 0.4), (0.0, 1.0), True)
    pressure = part * LIMIT * WEIGHT / WALL
    push = Traction(side(problem.mesh, 0, 0.0), (pressure, 0.0, 0.0), amplitude=rising)
    pushed = dataclasses.replace(
        problem,
        supports=(mirror,),
        loads=(*problem.loads, push),
        time=TimeSpan(1.0, stiffness_damping=2e-3, num_outputs=10),
        tools=(dataclasses.replace(tool, path=path),),
    )
    found = simulate(pushed, element=element)
    # What is missing or too much accelerates the block: 0.5 % of F over its mass, for 0.6 s.
    gained = 0.005 * LIMIT * 9.81 * 0.6
    speed = found.velocity.mean(axis=0)[0]
    assert np.abs(found.velocity).max() < 1e-6 * gained if part < 1.0 else speed > 0.5 * gained
    # The slope carries all of the push that does not move the block.
    drag = found.tools[0].mean_forces[-1, 0] / WEIGHT
    assert drag == pytest.approx(min(part, 1.0) * LIMIT, rel=5e-4)
