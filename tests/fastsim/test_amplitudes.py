"""Loads and supports over time: each with an amplitude of its own."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.amplitudes import Histories, smooth_ramp
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import Precision
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.bricks import side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)


def ends(mesh: TetMesh) -> tuple[np.ndarray, np.ndarray]:
    x = mesh.points[:, 0]
    return tuple(np.flatnonzero(np.abs(x - at) < 1e-9).astype(np.int32) for at in (0.0, x.max()))  # type: ignore[return-value]


def test_a_smooth_ramp_rises_from_0_to_1_without_jumps() -> None:
    ramp = smooth_ramp(2.0)
    assert [ramp(t) for t in (-1.0, 0.0, 1.0, 2.0, 9.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    times = np.linspace(0.0, 2.0, 2001)
    values = np.array([ramp(t) for t in times])
    assert (np.diff(values) >= 0.0).all()
    assert np.abs(np.diff(values, 2))[[0, -1]].max() < 1e-8
    with pytest.raises(InputError, match="ramp"):
        smooth_ramp(0.0)


@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("num_threads", [1, 2])
def test_moving_supports_are_where_their_amplitudes_say(
    ragged_box: TetMesh, precision: Precision, num_threads: int
) -> None:
    left, right = ends(ragged_box)
    supports = (
        Support(left, displacement=(0.0, 0.0, 0.05)),
        Support(right, components=(True, False, False), displacement=(0.1, 9.0, 9.0)),
    )
    problem = Problem(ragged_box, SOFT, supports, (), TimeSpan(1.0, num_outputs=10))
    result = simulate(
        problem,
        support_amplitude=[None, lambda t: np.sin(3.0 * t)],
        precision=precision,
        num_threads=num_threads,
    )
    exact = 0.1 * np.sin(3.0 * result.times)[:, None]
    assert np.abs(result.displacements[:, right, 0] - exact).max() < 1e-7
    assert np.abs(result.displacements[:, left, 2] - 0.05).max() < 1e-8
    assert not result.displacements[:, left, :2].any()
    # Free to move sideways, and it does: it gets thinner where it is pulled.
    assert np.abs(result.displacements[5][right, 1:]).max() > 1e-3
    # The central velocity of the support: (s(t + dt) - s(t - dt)) / 2 dt.
    dt = result.time_step
    speed = 0.1 * np.cos(3.0) * np.sin(3.0 * dt) / dt
    assert result.velocity[right, 0] == pytest.approx(speed, rel=1e-5)


def test_each_load_has_its_own_amplitude(ragged_box: TetMesh) -> None:
    """Three loads over time are the sum of each alone: the linear solid superposes."""
    left, _ = ends(ragged_box)
    loads = (
        Traction(side(ragged_box, 0, 1.6), (100.0, 20.0, 0.0)),
        BodyForce((0.0, 0.0, -100.0)),
        Pressure(side(ragged_box, 0, 1.6), 50.0),
    )
    amplitudes = (lambda t: np.sin(4.0 * t), None, smooth_ramp(0.5))
    span = TimeSpan(1.0, num_outputs=4)

    def run(chosen: tuple[int, ...]) -> np.ndarray:
        problem = Problem(ragged_box, SOFT, (Support(left),), tuple(loads[k] for k in chosen), span)
        factors = [amplitudes[k] for k in chosen]
        return simulate(problem, strain=Strain.LINEAR, amplitude=factors).displacements

    together = run((0, 1, 2))
    parts = [run((k,)) for k in range(3)]
    scale = min(np.abs(part[-1]).max() for part in parts)
    assert scale > 1e-4
    assert np.abs(together - sum(parts)).max() < 1e-11 * np.abs(together).max()


def test_one_amplitude_for_all_is_the_same_as_one_for_each(ragged_box: TetMesh) -> None:
    left, _ = ends(ragged_box)
    loads = (
        BodyForce((0.0, 0.0, -100.0)),
        Pressure(side(ragged_box, 0, 1.6), 50.0),
    )
    problem = Problem(ragged_box, SOFT, (Support(left),), loads, TimeSpan(0.5, num_outputs=2))
    ramp = smooth_ramp(0.4)
    one = simulate(problem, amplitude=ramp).displacements
    each = simulate(problem, amplitude=[ramp, ramp]).displacements
    np.testing.assert_array_equal(one, each)
    assert len(Histories(problem, [ramp, ramp], ramp)) == 2


def test_loads_and_supports_bring_their_own_amplitudes(ragged_box: TetMesh) -> None:
    left, right = ends(ragged_box)
    ramp, wave = smooth_ramp(0.4), TabularAmplitude((0.0, 0.1, 0.5), (0.0, 1.0, -1.0))
    span = TimeSpan(0.5, num_outputs=2)

    def run(own: bool) -> np.ndarray:
        problem = Problem(
            ragged_box,
            SOFT,
            (
                Support(left),
                Support(right, displacement=(0.0, 0.0, 0.01), amplitude=ramp if own else None),
            ),
            (BodyForce((0.0, 0.0, -100.0), wave if own else None),),
            span,
        )
        given = {} if own else {"amplitude": wave, "support_amplitude": [None, ramp]}
        return simulate(problem, **given).displacements

    np.testing.assert_array_equal(run(own=True), run(own=False))
    assert np.abs(run(own=True)[-1]).max() > 1e-3


@pytest.mark.parametrize("num_outputs", [1, 3, 300])
def test_outputs_do_not_stop_or_change_the_run(ragged_box: TetMesh, num_outputs: int) -> None:
    """900 steps with 1, 3 or 300 states stored: the last one is the same bit for bit."""
    left, _ = ends(ragged_box)
    step = 2e-3
    span = TimeSpan(900 * step, step, 1.0, num_outputs)
    problem = Problem(ragged_box, SOFT, (Support(left),), (BodyForce((0.0, 0.0, -200.0)),), span)
    result = simulate(problem, num_threads=2)
    whole = simulate(
        Problem(
            ragged_box, SOFT, problem.supports, problem.loads, TimeSpan(900 * step, step, 1.0, 900)
        ),
        num_threads=2,
    )
    assert result.displacements.shape[0] == num_outputs + 1
    np.testing.assert_array_equal(result.displacements, whole.displacements[:: 900 // num_outputs])
    np.testing.assert_array_equal(result.velocity, whole.velocity)


def test_what_cannot_be_followed_is_refused(ragged_box: TetMesh) -> None:
    left, right = ends(ragged_box)
    load = BodyForce((0.0, 0.0, -100.0))
    problem = Problem(ragged_box, SOFT, (Support(left),), (load,), TimeSpan(0.1))
    with pytest.raises(InputError, match="amplitude at t"):
        simulate(problem, amplitude=lambda t: float("nan"))  # noqa: ARG005
    with pytest.raises(InputError, match="2 amplitudes for 1 loads"):
        simulate(problem, amplitude=[None, None])
    both = (
        Support(right, displacement=(0.1, 0.0, 0.0)),
        Support(right, displacement=(0.1, 0.0, 0.0)),
    )
    twice = Problem(ragged_box, SOFT, both, (), TimeSpan(0.1))
    with pytest.raises(InputError, match="different amplitudes"):
        simulate(twice, support_amplitude=[None, smooth_ramp(1.0)])
