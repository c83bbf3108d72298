"""Warp's kernels on the processor against the compiled core: forces, motions, energies."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.fastsim.errors import BlowUpError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.tet_mesh import TetMesh

pytest.importorskip("warp", reason="the extra `gpu` is not installed")

# `PALPATE_TEST_DEVICE=cuda:0` runs these on a GPU.
WARP = os.environ.get("PALPATE_TEST_DEVICE", "warp:cpu")
SOFT, HARD = Material(1e4, 0.3, 1000.0), Material(4e4, 0.4, 1100.0)
UP = TabularAmplitude((0.0, 0.3, 1.0), (0.0, 1.0, 0.6))
ELEMENTS = pytest.mark.parametrize("element", list(Element))


def facets_where(mesh: TetMesh, axis: int, value: float) -> np.ndarray:
    on = np.abs(mesh.points[mesh.boundary_facets][:, :, axis] - value).max(axis=1) < 1e-9
    return mesh.boundary_facets[on]


def points_where(mesh: TetMesh, axis: int, value: float) -> np.ndarray:
    return np.flatnonzero(np.abs(mesh.points[:, axis] - value) < 1e-9).astype(np.int32)


def driven(mesh: TetMesh, *tools: RigidTool, end_time: float = 0.5) -> Problem:
    """Two materials, every kind of load, a support that turns, one that slides, damping."""
    low, high = points_where(mesh, 0, 0.0), points_where(mesh, 0, 1.6)
    wall = np.setdiff1d(points_where(mesh, 1, 0.0), np.union1d(low, high)).astype(np.int32)
    supports = (
        Support(low, displacement=(0.02, 0.0, 0.01), amplitude=UP),
        Support(high, rotation=Rotation((1.0, 0.0, 0.0), (1.6, 0.5, 0.6), 0.2), amplitude=UP),
        Support(wall, normal=(0.1, 1.0, 0.0)),
    )
    loads = (
        BodyForce((0.0, 0.0, -400.0)),
        Traction(facets_where(mesh, 1, 1.0), (0.0, 50.0, 20.0), amplitude=UP),
        Pressure(facets_where(mesh, 2, 1.2), 80.0, amplitude=UP),
    )
    stiff = Inclusion(np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 1.1), HARD)
    span = TimeSpan(end_time, mass_damping=2.0, num_outputs=2)
    return Problem(mesh, SOFT, supports, loads, span, tools, (stiff,))


def standing(mesh: TetMesh, *tools: RigidTool, end_time: float = 0.4) -> Problem:
    fixed = Support(points_where(mesh, 2, 0.0))
    return Problem(mesh, SOFT, (fixed,), (), TimeSpan(end_time, num_outputs=2), tools)


def apart(one: DynamicResult, other: DynamicResult) -> float:
    size = np.abs(one.displacements).max()
    assert size > 1e-3
    assert one.num_steps == other.num_steps
    return float(np.abs(one.displacements - other.displacements).max() / size)


@pytest.mark.parametrize("strain", list(Strain))
@ELEMENTS
@pytest.mark.parametrize(("precision", "limit"), [("float32", 1e-6), ("float64", 1e-12)])
@pytest.mark.parametrize("is_repeatable", [True, False])
def test_forces_are_the_cores(
    ragged_box: TetMesh,
    strain: Strain,
    element: Element,
    precision: str,
    limit: float,
    is_repeatable: bool,
) -> None:
    problem = dataclasses.replace(driven(ragged_box), supports=())
    body = ExplicitBody(
        problem,
        strain=strain,
        element=element,
        precision=Precision(precision),
        device=WARP,
        is_repeatable=is_repeatable,
    )
    u = np.random.default_rng(3).uniform(-0.03, 0.03, ragged_box.points.shape)
    body.set_state(u)
    found, expected = np.empty_like(u), body.elastic.internal_force(u)
    body.run.internal_force(found)  # type: ignore[attr-defined]
    assert np.abs(found - expected).max() <= limit * np.abs(expected).max()


@pytest.mark.parametrize("strain", list(Strain))
@ELEMENTS
def test_a_thousand_steps_are_the_cores(
    ragged_box: TetMesh, strain: Strain, element: Element
) -> None:
    problem = driven(ragged_box)
    critical = ExplicitBody(problem, strain=strain, element=element).critical_time_step
    span = TimeSpan(0.5 * critical * 1000, mass_damping=2.0, num_outputs=2,
                    time_step=0.5 * critical)  # fmt: skip
    problem = dataclasses.replace(problem, time=span)
    runs = [
        simulate(problem, strain=strain, element=element, device=device, tracks_energy=True)
        for device in ("cpu", WARP)
    ]
    assert runs[0].num_steps >= 1000
    assert apart(*runs) <= 1e-10
    np.testing.assert_allclose(runs[1].velocity, runs[0].velocity, rtol=0, atol=1e-9)
    core, device = (run.energies for run in runs)
    assert core is not None
    assert device is not None
    scale = np.abs(core.external_work).max()
    assert scale > 1e-3
    for name in ("strain", "kinetic", "external_work", "damping_loss"):
        difference = getattr(device, name) - getattr(core, name)
        assert np.abs(difference).max() <= 1e-10 * scale, name


def test_single_precision_stays_near(ragged_box: TetMesh) -> None:
    problem = driven(ragged_box)
    core = simulate(problem)
    assert apart(core, simulate(problem, precision=Precision.SINGLE, device=WARP)) <= 1e-4


def test_a_repeatable_run_has_the_same_bits_twice(ragged_box: TetMesh) -> None:
    problem = driven(ragged_box)
    runs = [simulate(problem, device=WARP, precision=Precision.SINGLE) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].displacements, runs[1].displacements)
    np.testing.assert_array_equal(runs[0].velocity, runs[1].velocity)


def test_stepping_in_pieces_is_the_same_run(ragged_box: TetMesh) -> None:
    whole, pieces = (ExplicitBody(driven(ragged_box), device=WARP) for _ in range(2))
    for body in (whole, pieces):
        body.apply_force([[0.0, 3.0, 0.0]], points=[40])
    whole.step(30)
    for count in (1, 2, 17, 10):
        pieces.look()
        pieces.step(count)
    np.testing.assert_array_equal(whole.displacement, pieces.displacement)
    assert whole.time == pieces.time
    plain = ExplicitBody(driven(ragged_box), device=WARP)
    plain.step(30)
    assert np.abs(plain.displacement - whole.displacement).max() > 1e-5


@pytest.mark.parametrize("is_repeatable", [True, False])
def test_captured_blocks_of_steps_are_the_same_run(
    ragged_box: TetMesh, is_repeatable: bool
) -> None:
    plain, captured = (
        ExplicitBody(
            driven(ragged_box), device=WARP, is_repeatable=is_repeatable, tracks_energy=True
        )
        for _ in range(2)
    )
    captured.run.batch.uses_graphs = True  # type: ignore[attr-defined]
    for body in (plain, captured):
        body.step(20)
        body.step(45)
        body.set_mass_damping(5.0)
        body.step(50)
    assert captured.run.batch._graphs  # type: ignore[attr-defined]
    # A GPU adds up forces in any order where it need not repeat: rounding of 115 steps.
    close = 0.0 if is_repeatable or WARP == "warp:cpu" else 1e-12
    np.testing.assert_allclose(captured.displacement, plain.displacement, rtol=0.0, atol=close)
    for one, other in zip(captured.energies(), plain.energies(), strict=True):
        assert one == pytest.approx(other, rel=close, abs=close)


SHAPES: list[tuple[ToolShape, float]] = [
    (SphereShape(0.4), 1.61),
    (CapsuleShape(0.3, 0.2), 1.71),
    (BoxShape((0.35, 0.3, 0.3)), 1.51),
    (PlaneShape(), 1.21),
]


@pytest.mark.parametrize("form", list(ContactForm))
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("shape", "height"), SHAPES)
def test_tools_push_as_the_cores(
    ragged_box: TetMesh, form: ContactForm, friction: float, shape: ToolShape, height: float
) -> None:
    # A plane faces down when turned about x by pi.
    turn = [0.0, 1.0, 0.0, 0.0] if isinstance(shape, PlaneShape) else [1.0, 0.0, 0.0, 0.0]
    ends = np.array([[0.8, 0.5, height], [0.85, 0.5, height - 0.12]])
    path = ToolPath(np.array([0.0, 0.7]), ends, np.array([turn, turn]))
    problem = standing(
        ragged_box, RigidTool(shape, path, friction_coefficient=friction), end_time=0.7
    )
    law = ContactLaw(form)
    core, device = (simulate(problem, contact=law, device=name) for name in ("cpu", WARP))
    assert apart(core, device) <= 1e-9
    of_core, of_device = core.tools[0], device.tools[0]
    assert np.abs(of_core.mean_forces).max() > 1.0
    scale = np.abs(of_core.mean_forces).max()
    for name in ("positions", "forces", "moments", "mean_forces"):
        difference = getattr(of_device, name) - getattr(of_core, name)
        assert np.abs(difference).max() <= 1e-8 * scale, name


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_tool_driven_by_a_force_moves_as_the_cores(ragged_box: TetMesh, friction: float) -> None:
    drive = ForceDrive((0.6, 0.0, -0.8), 30.0, TabularAmplitude((0.0,), (1.0,)), mass=20.0)
    start = ToolPath(np.array([0.0]), np.array([[0.8, 0.5, 1.605]]))
    problem = standing(ragged_box, RigidTool(SphereShape(0.4), start, friction, drive=drive))
    core, device = (simulate(problem, device=name) for name in ("cpu", WARP))
    assert apart(core, device) <= 1e-9
    moved = core.tools[0].positions[-1, 2] - core.tools[0].positions[0, 2]
    assert abs(moved) > 1e-2
    np.testing.assert_allclose(device.tools[0].positions, core.tools[0].positions, atol=1e-10)


@pytest.mark.parametrize("load", [3e4, 1e7])
def test_a_run_that_fails_fails_as_the_cores(ragged_box: TetMesh, load: float) -> None:
    low = Support(points_where(ragged_box, 0, 0.0))
    point = points_where(ragged_box, 0, 1.6)[:1]
    push = PointForce(point, np.array([[-load, 0.0, 0.0]]))
    problem = Problem(ragged_box, SOFT, (low,), (push,), TimeSpan(0.5))
    errors = []
    for device in ("cpu", WARP):
        with pytest.raises(BlowUpError) as caught:
            simulate(problem, device=device)
        errors.append(caught.value)
    core, device_error = errors
    assert (device_error.reason, device_error.step, device_error.cell) == (
        core.reason, core.step, core.cell
    )  # fmt: skip
    np.testing.assert_allclose(device_error.displacement, core.displacement, atol=1e-9)


def test_energy_from_nothing_is_seen(ragged_box: TetMesh) -> None:
    """A step above the critical one, slipped past the check by made-up masses."""
    problem = dataclasses.replace(standing(ragged_box), time=None)
    reasons = []
    for device in ("cpu", WARP):
        light = np.full(ragged_box.num_points, 1.0)
        body = ExplicitBody(problem, strain=Strain.LINEAR, mass=light, time_step=1.0, device=device)
        noise = np.random.default_rng(0).uniform(-1e-3, 1e-3, ragged_box.points.shape)
        body.set_state(noise)
        with pytest.raises(BlowUpError) as caught:
            body.step(2000)
        reasons.append(caught.value.reason)
    assert reasons[0] == reasons[1]
