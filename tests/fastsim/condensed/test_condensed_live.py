"""A driven condensed body: tools and anchors are moved, arrays stay, nonsense is refused."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.condensed import (
    CondensedBody,
    CondensedSteps,
    NotCondensableError,
    UnsettledContactError,
    condense,
)
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.statics import solve_static
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import CapsuleShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.spring import AnchorPath, Spring

TOP, RADIUS = 0.03, 0.02
START = (0.02, 0.02, TOP + RADIUS + 1e-3)


BALL = SphereShape(RADIUS)


def block(shape: SphereShape | CapsuleShape = BALL) -> Problem:
    mesh = brick_box((6, 6, 4), (0.04, 0.04, TOP))
    tool = RigidTool(shape, ToolPath([0.0], [START]), contact_facets=side(mesh, 2, TOP))
    spring = Spring.on(mesh, (0.04, 0.02, 0.02), 0.012, 30.0, AnchorPath([0.0], [[1e-3, 0, 2e-3]]))
    return Problem(
        mesh,
        Material(1e4, 0.4),
        (support_of(side(mesh, 2, 0.0)),),
        (),
        tools=(tool,),
        springs=(spring,),
    )


def test_a_tool_is_sent_and_feels_what_steps_say() -> None:
    model = condense(block())
    body = CondensedBody(model)
    (tool,) = body.tools
    assert not tool.force.any()
    assert not body.displacement.any()
    positions = body.positions
    tool.move_to((0.02, 0.02, TOP + RADIUS - 2e-3))
    assert tool.position[2] == START[2]  # it goes with the step
    body.step()
    assert body.touching >= 4
    assert body.positions is positions
    steps = CondensedSteps(model)
    steps.set_base(anchors=np.zeros((1, 3)))
    expected = steps.step([(tool.position, tool.rotation)])
    assert np.allclose(tool.force, expected.forces[0], rtol=1e-9)
    assert np.allclose(tool.moment, expected.moments[0], rtol=1e-9, atol=1e-12)
    assert np.allclose(body.displacement, expected.displacement, rtol=1e-9, atol=1e-15)
    assert np.array_equal(positions, model.problem.mesh.points[body.points] + body.displacement)
    assert body.facets.max() < len(body.points) == len(positions)
    with pytest.raises(ValueError, match="read-only"):
        positions[0] = 0.0
    body.reset()
    assert not tool.force.any()
    assert np.array_equal(tool.position, START)


def test_a_capsule_is_turned() -> None:
    body = CondensedBody(condense(block(CapsuleShape(RADIUS, 0.03))))
    (tool,) = body.tools
    above = (0.02, 0.02, TOP + RADIUS + 5e-3)
    tool.move_to(above)
    body.step()
    assert body.touching > 0  # upright it reaches down by half its length
    tool.move_to(above, (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0))
    body.step()
    assert body.touching == 0
    assert np.allclose(tool.rotation[:, 2], [1.0, 0.0, 0.0])


def test_the_hand_feels_a_spring_as_in_statics() -> None:
    problem = block()
    body = CondensedBody(condense(problem, seen=np.arange(problem.mesh.num_points)))
    (spring,) = body.springs
    assert np.allclose(spring.force, 0.0)
    end = problem.springs[0].path.end
    spring.move_to(np.array(spring.description.center) + end)
    body.step()
    expected = solve_static(problem, strain=Strain.LINEAR, relative_tolerance=1e-13).displacement
    pull = PatchSprings(problem.mesh.points, problem.springs)
    on_body = pull.resultants(expected, end[None], np.ones(1))[0]
    assert np.linalg.norm(on_body) > 1e-3
    assert np.allclose(spring.force, -on_body, rtol=1e-8)


def test_what_is_no_pose_is_refused_and_contact_that_does_not_settle_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = CondensedBody(condense(block()))
    (tool,), (spring,) = body.tools, body.springs
    for place, turn in (((0.0, 0.0), None), ((0.0, 0.0, np.nan), None), (START, (1, 1, 0, 0))):
        with pytest.raises(InputError, match="of tool 1"):
            tool.move_to(place, turn)
    with pytest.raises(InputError, match="of an anchor"):
        spring.move_to((0.0, 0.0, np.inf))
    tool.move_to((0.02, 0.02, TOP + RADIUS - 2e-3))
    body.step()
    force, positions = tool.force.copy(), body.positions.copy()
    tool.move_to((0.02, 0.02, TOP + RADIUS - 3e-3))
    monkeypatch.setattr(body._steps, "_most", 0)
    with pytest.raises(UnsettledContactError):
        body.step()
    assert np.array_equal(tool.force, force)
    assert np.array_equal(body.positions, positions)
    few = CondensedBody(condense(block(), touched=np.unique(side(block().mesh, 2, TOP))))
    with pytest.raises(NotCondensableError, match="name them among `seen`"):
        _ = few.springs[0].force
