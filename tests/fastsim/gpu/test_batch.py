"""Several bodies in one launch are the single runs, bit for bit; arrays are shared, not copied."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest

from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.fastsim.errors import BlowUpError
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh

pytest.importorskip("warp", reason="the extra `gpu` is not installed")
# `PALPATE_TEST_DEVICE=cuda:0` runs these on a GPU.
WARP = os.environ.get("PALPATE_TEST_DEVICE", "warp:cpu")


def varied(mesh: TetMesh, number: int) -> Problem:
    """Another material, load, support, tool way and step for each number."""
    fixed = np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32)
    above = (mesh.points[mesh.boundary_facets][:, :, 2] > 1.2 - 1e-9).all(axis=1)
    loads: list[BodyForce | Pressure | PointForce] = [BodyForce((40.0 * number, 0.0, -50.0))]
    if number % 3 == 1:
        loads.append(Pressure(mesh.boundary_facets[above], 30.0 + number))
    if number % 3 == 2:
        loads.append(PointForce(np.array([40], np.int32), np.array([[0.0, 2.0 * number, 0.0]])))
    shift = (0.001 * number, 0.0, 0.0) if number % 2 else (0.0, 0.0, 0.0)
    ends = np.array([[0.8, 0.5, 1.61], [0.8, 0.5, 1.6 - 0.002 * number]])
    tool = RigidTool(SphereShape(0.4), ToolPath(np.array([0.0, 0.1]), ends))
    material = Material(1e4 * (1 + 0.2 * number), 0.2 + 0.015 * number, 1000.0 + 10 * number)
    span = TimeSpan(0.5 + 0.025 * number, mass_damping=0.5 * number, num_outputs=2)
    held_at = Support(fixed, displacement=shift)
    return Problem(mesh, material, (held_at,), tuple(loads), span, (tool,))


@pytest.mark.parametrize("element", list(Element))
def test_a_batch_of_sixteen_is_sixteen_single_runs(ragged_box: TetMesh, element: Element) -> None:
    from palpate.fastsim.gpu.batch import simulate_batch

    problems = [varied(ragged_box, number) for number in range(16)]
    batch = simulate_batch(problems, device=WARP, element=element, tracks_energy=True)
    assert len({one.num_steps for one in batch if isinstance(one, DynamicResult)}) > 4
    for problem, together in zip(problems, batch, strict=True):
        alone = simulate(problem, device=WARP, element=element, tracks_energy=True)
        assert isinstance(together, DynamicResult)
        assert np.abs(alone.displacements).max() > 1e-4
        np.testing.assert_array_equal(together.displacements, alone.displacements)
        np.testing.assert_array_equal(together.tools[0].mean_forces, alone.tools[0].mean_forces)
        assert together.energies is not None
        assert alone.energies is not None
        np.testing.assert_array_equal(together.energies.balance, alone.energies.balance)


def test_one_that_blows_up_does_not_end_the_others(ragged_box: TetMesh) -> None:
    from palpate.fastsim.gpu.batch import simulate_batch

    good = varied(ragged_box, 2)
    torn = PointForce(np.array([ragged_box.num_points - 1], np.int32), np.array([[-3e4, 0.0, 0.0]]))
    bad = dataclasses.replace(good, loads=(torn,))
    first, second, third = simulate_batch([good, bad, good], device=WARP)
    assert isinstance(second, BlowUpError)
    assert isinstance(first, DynamicResult)
    assert isinstance(third, DynamicResult)
    np.testing.assert_array_equal(first.displacements, third.displacements)
    with pytest.raises(BlowUpError) as alone:
        simulate(bad, device=WARP)
    assert (alone.value.step, alone.value.cell) == (second.step, second.cell)


def test_what_does_not_go_together_is_refused(ragged_box: TetMesh, single_cell: TetMesh) -> None:
    from palpate.fastsim.gpu.batch import simulate_batch

    one = varied(ragged_box, 1)
    with pytest.raises(InputError, match="at least one problem"):
        simulate_batch([], device=WARP)
    other = Problem(single_cell, one.material, (), (), one.time)
    with pytest.raises(InputError, match="same mesh"):
        simulate_batch([one, other], device=WARP)
    longer = dataclasses.replace(one, time=TimeSpan(0.1, num_outputs=3))
    with pytest.raises(InputError, match="outputs"):
        simulate_batch([one, longer], device=WARP)
    with pytest.raises(InputError, match="warp:cpu"):
        simulate_batch([one], device="cpu")


@pytest.mark.skipif(WARP != "warp:cpu", reason="NumPy takes no array of a GPU")
def test_the_state_is_shared_without_a_copy(ragged_box: TetMesh) -> None:
    from palpate.fastsim.gpu.batch import shared_state

    body = ExplicitBody(varied(ragged_box, 1), device=WARP)
    state = shared_state(body)
    seen = np.from_dlpack(state["displacement"])
    assert seen.shape == ragged_box.points.shape
    body.step(20)
    assert np.abs(seen).max() > 1e-6
    np.testing.assert_array_equal(seen, body.displacement)
    np.testing.assert_array_equal(
        np.from_dlpack(state["displacement"]), np.from_dlpack(shared_state(body)["displacement"])
    )
    with pytest.raises(InputError, match="device"):
        shared_state(ExplicitBody(varied(ragged_box, 1)))
