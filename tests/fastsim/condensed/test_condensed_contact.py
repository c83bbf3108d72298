"""Tools against a condensed body, beside statics with the same tools; and steps one by one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.condensed import (
    CondensedSteps,
    NotCondensableError,
    condense,
    solve_condensed,
)
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import TabularAmplitude
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.shapes import shape_sphere

EQUAL = 1e-10
TOP = 0.03
# Half a turn about x: a half space then lies above.
UPSIDE_DOWN = (0.0, 1.0, 0.0, 0.0)
TOOLS: dict[str, tuple[ToolShape, float, tuple[float, ...]]] = {
    "sphere": (SphereShape(0.02), 0.02, (1.0, 0.0, 0.0, 0.0)),
    "capsule": (CapsuleShape(0.015, 0.01), 0.015, (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)),
    "surface": (SurfaceShape(shape_sphere(0.02, edge_length=0.008)), 0.02, (1.0, 0.0, 0.0, 0.0)),
    "plane": (PlaneShape(), 0.0, UPSIDE_DOWN),
}


def pressed(
    shape: ToolShape,
    height: float,
    quaternion: tuple[float, ...],
    rule: ContactRule = ContactRule.VERTICES,
) -> Problem:
    """A block, clamped below, with a tool that comes down 3 mm onto its top, a little sideways."""
    mesh = brick_box((6, 6, 4), (0.04, 0.04, TOP))
    path = ToolPath(
        [0.0, 1.0],
        [[0.021, 0.0195, TOP + height + 1e-4], [0.0215, 0.02, TOP + height - 3e-3]],
        np.array([quaternion, quaternion]),
    )
    tool = RigidTool(shape, path, contact_facets=side(mesh, 2, TOP), contact=rule)
    return Problem(
        mesh, Material(1e4, 0.4, 1000.0), (support_of(side(mesh, 2, 0.0)),), (), tools=(tool,)
    )


@pytest.mark.parametrize("rule", ContactRule)
@pytest.mark.parametrize("form", ContactForm)
@pytest.mark.parametrize("name", TOOLS)
def test_the_same_equilibrium_as_statics_finds(
    name: str, form: ContactForm, rule: ContactRule
) -> None:
    problem, law = pressed(*TOOLS[name], rule), ContactLaw(form)
    found = solve_condensed(problem, contact=law)
    expected = solve_contact(problem, strain=Strain.LINEAR, law=law, relative_tolerance=1e-12)
    u = expected.displacements[-1]
    assert np.abs(found.displacement - u).max() <= EQUAL * np.abs(u).max()
    force = expected.forces[-1]
    assert np.abs(found.tool_forces - force).max() <= 1e-8 * np.abs(force).max()
    assert force[0, 2] > 0.05


@pytest.mark.parametrize("rule", ContactRule)
def test_smoothed_tetrahedra_and_two_tools_at_once(rule: ContactRule) -> None:
    problem = pressed(*TOOLS["sphere"], rule)
    (one,) = problem.tools
    start, end = np.array(one.path.positions)
    other = dataclasses.replace(
        one, shape=SphereShape(0.01), path=ToolPath([0.0, 1.0], [start - [0.012, 0.0, 0.0099],
                                                              end - [0.012, 0.0, 0.0095]])
    )  # fmt: skip
    problem = dataclasses.replace(problem, tools=(one, other))
    found = solve_condensed(problem, element=Element.SMOOTHED)
    expected = solve_contact(
        problem, strain=Strain.LINEAR, element=Element.SMOOTHED, relative_tolerance=1e-12
    )
    u = expected.displacements[-1]
    assert np.abs(found.displacement - u).max() <= EQUAL * np.abs(u).max()
    assert (expected.forces[-1][:, 2] > 1e-3).all()


def pose_at(height: float) -> Floats:
    return np.array([[0.02, 0.02, TOP + 0.02 + height, *np.eye(3).ravel()]])


def test_steps_push_and_let_go() -> None:
    steps = CondensedSteps(condense(pressed(*TOOLS["sphere"])))
    away = steps.step(pose_at(1e-3))
    assert away.touching == 0
    assert not away.forces.any()
    assert not away.displacement.any()
    forces = [steps.step(pose_at(-depth)).forces[0, 2] for depth in (1e-3, 2e-3, 3e-3)]
    assert 0.0 < forces[0] < forces[1] < forces[2]
    state = steps.step(pose_at(-3e-3))
    # What acts on the tool and what acts on the body add up to nothing, and no vertex is inside.
    assert np.allclose(state.forces[0] + steps.contact_forces.sum(axis=0), 0.0, atol=1e-14)
    model = steps.model
    places = model.problem.mesh.points[model.touched] + state.displacement
    distances = np.linalg.norm(places - pose_at(-3e-3)[0, :3], axis=1) - 0.02
    assert distances.min() >= -1e-12
    assert state.touching == int((np.abs(steps.contact_forces).max(axis=1) > 0.0).sum()) >= 4
    steps.clear()
    again = steps.step(pose_at(-3e-3))
    assert np.allclose(again.forces, state.forces, rtol=1e-8)
    assert not steps.step(pose_at(1e-3)).displacement.any()


def test_facets_beside_points_that_are_fixed_and_what_acts_on_the_tool() -> None:
    """Over a whole side, down to the clamp: corners there are at rest."""
    problem = pressed(*TOOLS["sphere"], ContactRule.FACETS)
    (tool,) = problem.tools
    mesh, low = problem.mesh, 0.012
    start = [-0.02 - 1e-4, 0.021, low]
    path = ToolPath([0.0, 1.0], [start, [-0.018, 0.021, low]])
    facets = side(mesh, 0, 0.0)
    problem = dataclasses.replace(
        problem, tools=(dataclasses.replace(tool, path=path, contact_facets=facets),)
    )
    expected = solve_contact(problem, strain=Strain.LINEAR, relative_tolerance=1e-12)
    steps = CondensedSteps(condense(problem))
    state = steps.step([path.pose_at(time) for time in (1.0,)])
    for found, known in ((state.forces, expected.forces), (state.moments, expected.moments)):
        size = np.abs(expected.forces[-1]).max() * (1.0 if found is state.forces else 0.02)
        assert np.abs(found - known[-1]).max() <= 1e-7 * size
    moved = dataclasses.replace(problem.supports[0], displacement=(1e-4, 0.0, 0.0))
    with pytest.raises(NotCondensableError, match="which a support moves"):
        CondensedSteps(condense(dataclasses.replace(problem, supports=(moved,))))


def test_columns_kept_from_step_to_step_are_those_of_the_compliance() -> None:
    """A plane pushes more points than columns are cached; a ball on its way uses them again."""
    problem = pressed(*TOOLS["plane"])
    mesh = brick_box((12, 12, 2), (0.04, 0.04, TOP))
    (plane,) = problem.tools
    top = side(mesh, 2, TOP)
    one = dataclasses.replace(plane, contact_facets=top)
    other = RigidTool(SphereShape(0.01), ToolPath([0.0], [[0.0, 0.0, 1.0]]), contact_facets=top)
    problem = dataclasses.replace(
        problem, mesh=mesh, supports=(support_of(side(mesh, 2, 0.0)),), tools=(one, other)
    )
    steps = CondensedSteps(condense(problem))
    turned = np.diag([1.0, -1.0, -1.0]).ravel()
    pushed = []
    for height, x in ((1e-3, 0.01), (-1e-3, 0.01), (1e-3, 0.03), (1e-3, 0.012)):
        poses = np.array([[0.02, 0.02, TOP + height, *turned],
                          [x, 0.02, TOP + 9e-3, *np.eye(3).ravel()]])  # fmt: skip
        state = steps.step(poses)
        expected = steps.model.compliance.response(steps.contact_forces)
        assert difference(state.displacement, expected) <= 1e-13
        pushed.append(state.touching)
    assert pushed[1] > 64 > pushed[2] >= 1


def difference(found: Points, expected: Points) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def test_other_forces_and_supports_act_beside_the_tool() -> None:
    problem = pressed(*TOOLS["sphere"])
    steps = CondensedSteps(condense(problem))
    before = steps.step(pose_at(-2e-3))
    forces = np.zeros((len(steps.model.touched), 3))
    forces[:, 2] = -2e-4
    steps.set_base(forces)
    after = steps.step(pose_at(-2e-3))
    assert after.forces[0, 2] < before.forces[0, 2]
    steps.set_base()
    assert np.allclose(steps.step(pose_at(-2e-3)).forces, before.forces, rtol=1e-8)


def test_what_it_cannot_pose_is_refused_with_the_reason() -> None:
    problem = pressed(*TOOLS["sphere"])
    with pytest.raises(NotCondensableError, match="Green strain"):
        solve_condensed(problem, strain=Strain.GREEN)
    with pytest.raises(NotCondensableError, match="no inertia"):
        solve_condensed(dataclasses.replace(problem, time=TimeSpan(1.0, 2)))
    (tool,) = problem.tools
    rough = dataclasses.replace(tool, friction_coefficient=0.2)
    with pytest.raises(NotCondensableError, match="has friction"):
        solve_condensed(dataclasses.replace(problem, tools=(rough,)))
    box = dataclasses.replace(tool, shape=BoxShape((0.01, 0.01, 0.01)))
    with pytest.raises(NotCondensableError, match="is a box"):
        solve_condensed(dataclasses.replace(problem, tools=(box,)))
    start = ToolPath([0.0], [tool.path.positions[0]])
    drive = ForceDrive((0.0, 0.0, -1.0), 0.1, TabularAmplitude((0.0,), (1.0,)), mass=0.1)
    driven = dataclasses.replace(tool, path=start, drive=drive)
    with pytest.raises(NotCondensableError, match="driven by a force"):
        solve_condensed(dataclasses.replace(problem, tools=(driven,)))
    few = condense(problem, touched=condense(problem).touched[:3])
    with pytest.raises(NotCondensableError, match="knows no compliance"):
        CondensedSteps(few)
    steps = CondensedSteps(condense(problem))
    with pytest.raises(InputError, match="1 tools"):
        steps.step([])
    with pytest.raises(InputError, match="NaN"):
        steps.step(np.full((1, 12), np.nan))
