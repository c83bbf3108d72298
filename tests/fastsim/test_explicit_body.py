"""Every way in which an explicit run can fail: it stops at that step and says what was seen."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim import explicit_body
from palpate.fastsim.amplitudes import Amplitude
from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.explicit_body import Precision
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)
PRECISIONS = pytest.mark.parametrize("precision", list(Precision))
THREADS = pytest.mark.parametrize("num_threads", [1, 2])


def held_block(mesh: TetMesh, span: TimeSpan, *loads: Load) -> Problem:
    return Problem(mesh, SOFT, (clamped(mesh),), loads, span)


def crushed(mesh: TetMesh, num_outputs: int) -> Problem:
    step = 0.5 * Body(mesh, SOFT).critical_time_step()
    span = TimeSpan(1200 * step, step, num_outputs=num_outputs)
    return held_block(mesh, span, Traction(side(mesh, 0, 1.6), (-2e4, 0.0, 0.0)))


@pytest.fixture
def no_check_of_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a wrong step through, to see that it is caught later."""

    class Patient(Body):
        def critical_time_step(self, **state: Any) -> float:
            return super().critical_time_step(**state) if state else 1e9

    monkeypatch.setattr(explicit_body, "Body", Patient)


@PRECISIONS
@THREADS
@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("num_outputs", [1, 60])
def test_an_inverted_cell_stops_the_run_at_that_step(
    ragged_box: TetMesh, precision: Precision, num_threads: int, num_outputs: int, element: Element
) -> None:
    problem = crushed(ragged_box, num_outputs)
    with pytest.raises(BlowUpError, match="a cell inverted") as caught:
        simulate(problem, element=element, precision=precision, num_threads=num_threads)
    error = caught.value
    assert problem.time is not None
    step = problem.time.time_step
    assert step is not None
    assert error.step > 0
    assert error.time == error.step * step
    # The last good state is that of a run which ends there, and has no inverted cell.
    for steps in (error.step, error.step + 1):
        span = TimeSpan(steps * step, step, num_outputs=1)
        shorter = dataclasses.replace(problem, time=span)
        if steps > error.step:
            # One step more and the cell named is inverted.
            with pytest.raises(BlowUpError) as again:
                simulate(shorter, element=element, precision=precision, num_threads=num_threads)
            assert (again.value.step, again.value.cell) == (error.step, error.cell)
            break
        good = simulate(shorter, element=element, precision=precision, num_threads=num_threads)
        scale = np.abs(good.displacements).max()
        assert np.abs(error.displacement - good.displacements[-1]).max() < 1e-6 * scale
    values = Body(ragged_box, SOFT).det_f(error.displacement)
    assert values.min() == error.smallest_det_f > 0.0
    corners = ragged_box.points[ragged_box.cells[error.cell]]
    assert error.position == pytest.approx(corners.mean(axis=0))
    assert "lower the load" in error.suggestion
    # Smaller cells fold sooner.
    way_out = "neo-hookean-stable" if element is Element.SMOOTHED else "refine the mesh there"
    assert way_out in error.suggestion
    assert f"step {error.step} " in str(error)
    assert f"cell {error.cell}" in str(error)


def test_a_body_inverted_from_the_start_does_no_step(ragged_box: TetMesh) -> None:
    flat = -1.1 * ragged_box.points * np.array([1.0, 0.0, 0.0])
    problem = dataclasses.replace(held_block(ragged_box, TimeSpan(0.1)), supports=())
    with pytest.raises(BlowUpError, match="a cell inverted") as caught:
        simulate(problem, displacement=flat)
    assert caught.value.step == 0
    np.testing.assert_array_equal(caught.value.displacement, flat)


@PRECISIONS
@THREADS
@pytest.mark.parametrize("weight", [1e12, 1e30])
def test_a_run_beyond_all_bounds_returns_nothing_that_is_not_finite(
    ragged_box: TetMesh, precision: Precision, num_threads: int, weight: float
) -> None:
    problem = held_block(ragged_box, TimeSpan(10.0, num_outputs=5), BodyForce((0.0, 0.0, -weight)))
    with pytest.raises(BlowUpError, match="left all bounds") as caught:
        simulate(problem, strain=Strain.LINEAR, precision=precision, num_threads=num_threads)
    assert np.isfinite(caught.value.displacement).all()
    assert np.isfinite(caught.value.time)


@pytest.mark.usefixtures("no_check_of_the_step")
@PRECISIONS
@THREADS
@pytest.mark.parametrize("num_outputs", [1, 40])
def test_energy_from_nothing_stops_a_run_with_too_long_a_step(
    precision: Precision, num_threads: int, num_outputs: int
) -> None:
    """Linear strain, so that no cell counts as inverted; 5 % above the critical step."""
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    sharp = Body(mesh, SOFT).critical_time_step()
    span = TimeSpan(40_000 * sharp, 1.05 * sharp, num_outputs=num_outputs)
    problem = held_block(mesh, span, BodyForce((0.0, 0.0, -20.0)))
    with pytest.raises(BlowUpError, match="energy grew") as caught:
        simulate(problem, strain=Strain.LINEAR, precision=precision, num_threads=num_threads)
    error = caught.value
    # Amplification (1.05 + sqrt(1.05^2 - 1))^2 = 1.88 a step: seen within some tens of steps.
    assert error.step < 200
    # Nothing has moved further than the load can push it, twice the static 0.1 m or so.
    assert np.abs(error.displacement).max() < 0.3
    assert error.critical_time_step == pytest.approx(sharp, rel=1e-3)
    assert "too long" in error.suggestion
    assert f"{0.8 * error.critical_time_step:.3g} s" in str(error)


def test_a_body_that_stiffens_beyond_its_step_is_informed_of_a_shorter_one(
    ragged_box: TetMesh,
) -> None:
    """A step just stable at rest is too long for a body pulled to one and a half its length."""
    sharp = Body(ragged_box, SOFT).critical_time_step()
    span = TimeSpan(20.0, 0.99 * sharp, 1.0, 100)
    pull = Traction(side(ragged_box, 0, 1.6), (6e3, 0.0, 0.0))
    with pytest.raises(BlowUpError) as caught:
        simulate(held_block(ragged_box, span, pull))
    error = caught.value
    assert np.isfinite(error.displacement).all()
    assert error.critical_time_step < 0.9 * sharp
    assert "too long for the body as it is now" in str(error)
    # What is suggested works.
    better = TimeSpan(20.0, 0.8 * error.critical_time_step, 1.0, 2)
    simulate(held_block(ragged_box, better, pull))


def test_a_step_above_the_critical_is_refused_before_it_is_made(ragged_box: TetMesh) -> None:
    sharp = Body(ragged_box, SOFT).critical_time_step()
    with pytest.raises(UnstableStepError, match="above the critical") as caught:
        simulate(held_block(ragged_box, TimeSpan(1.0, 1.01 * sharp)))
    assert caught.value.time_step == 1.01 * sharp
    assert caught.value.critical_time_step == pytest.approx(sharp)


def hammer(time: float) -> float:
    return 1.0 if 0.1 <= time < 0.12 else 0.0


def jump(time: float) -> float:
    return 0.0 if time < 0.1 else 1.0


@PRECISIONS
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(
    ("load", "amplitude", "moved"),
    [
        (BodyForce((0.0, 0.0, -3e4)), hammer, None),
        (Pressure(np.zeros((0, 3), np.int32), 5e3), hammer, None),
        (None, None, jump),
        (None, None, lambda t: np.sin(40.0 * t)),
        (BodyForce((0.0, 0.0, -100.0)), lambda t: np.sin(7.0 * t), None),
    ],
)
def test_rough_but_honest_runs_are_left_alone(
    ragged_box: TetMesh,
    precision: Precision,
    strain: Strain,
    load: Load | None,
    amplitude: Amplitude | None,
    moved: Amplitude | None,
) -> None:
    """Blows of one step, jumping and shaking supports: no energy but what is given."""
    span = TimeSpan(5.0, 0.02, num_outputs=10)
    if isinstance(load, Pressure):
        load = Pressure(side(ragged_box, 0, 1.6), load.pressure)
    problem = held_block(ragged_box, span, *([load] if load else []))
    if moved:
        end = np.unique(side(ragged_box, 0, 1.6)).astype(np.int32)
        shift = Support(end, displacement=(0.02, 0.0, 0.01))
        problem = dataclasses.replace(problem, supports=(*problem.supports, shift))
    result = simulate(
        problem,
        strain=strain,
        precision=precision,
        amplitude=amplitude,
        support_amplitude=[None, moved] if moved else None,
    )
    assert np.abs(result.displacements[1:]).max() > 1e-3
    assert np.isfinite(result.displacements).all()


@PRECISIONS
def test_a_support_that_slows_down_is_no_growth(precision: Precision) -> None:
    """What its own mass gives back as it slows does not count against what the body is given."""
    mesh = brick_box((3, 2, 2), (1.6, 1.0, 1.2), ragged=0.2)
    end = np.unique(side(mesh, 0, mesh.points[:, 0].max())).astype(np.int32)
    shift = Support(end, components=(False, True, False), displacement=(0.0, -6.7e-4, 0.0))
    problem = held_block(mesh, TimeSpan(10.0, 0.0263, num_outputs=1))
    problem = dataclasses.replace(problem, supports=(*problem.supports, shift))
    for frequency in np.linspace(3.0, 6.0, 31):
        result = simulate(
            problem,
            strain=Strain.LINEAR,
            precision=precision,
            support_amplitude=[None, lambda t, w=frequency: np.sin(w * t)],
        )
        assert np.isfinite(result.displacements).all()


@PRECISIONS
@pytest.mark.parametrize("load", [0.0, 1e-12, 1.0])
def test_the_rounding_of_a_body_at_rest_is_no_growth(
    ragged_box: TetMesh, precision: Precision, load: float
) -> None:
    """Turned by a radian without a push: rounding alone moves it, and goes on doing so."""
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = ragged_box.points @ turn.T - ragged_box.points
    loads = (BodyForce((0.0, 0.0, -load)),)
    problem = Problem(ragged_box, SOFT, (), loads, TimeSpan(1000.0, num_outputs=2))
    result = simulate(problem, displacement=turned, precision=precision)
    assert result.num_steps > 15_000
    eps = {Precision.SINGLE: 2.0**-23, Precision.DOUBLE: 2.0**-52}[precision]
    fall = -0.5 * load / 1000.0 * result.times**2
    moved = result.displacements - turned
    moved[:, :, 2] -= fall[:, None]
    # It drifts and turns by some roundings a step, and does not swell.
    assert np.abs(moved).max() < result.num_steps * 100 * eps * max(1.0, abs(fall[-1]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_loads_and_supports_that_are_not_finite_are_refused(
    ragged_box: TetMesh, value: float
) -> None:
    span = TimeSpan(0.1)
    with pytest.raises(InputError, match="load 1"):
        simulate(held_block(ragged_box, span, BodyForce((0.0, value, 0.0))))
    fixed = Support(np.array([0], np.int32), displacement=(value, 0.0, 0.0))
    problem = held_block(ragged_box, span)
    problem = dataclasses.replace(problem, supports=(*problem.supports, fixed))
    with pytest.raises(InputError, match="support 2"):
        simulate(problem)
