"""Energy over 10 000 steps at half the critical step; strain energy from psi(F), not from work."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import FINITE_LAWS, SOFT, facets_at, points_at

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body, lame_parameters
from palpate.fastsim.dynamics import DynamicResult, Recorder, simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

RAMPED, SUDDEN = 1e-5, 3e-3


def block() -> TetMesh:
    return brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)


def run(
    mesh: TetMesh,
    load: Load | None,
    damping: float = 0.0,
    *,
    moved: tuple[float, float, float] | None = None,
    ramped: bool = True,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
) -> DynamicResult:
    """10 000 steps; the ramp takes the first half of them."""
    step = 0.5 * Body(mesh, SOFT).critical_time_step()
    span = TimeSpan(10_000 * step, step, damping, 50)
    supports = [Support(points_at(mesh, 0, 0.0))]
    if moved:
        supports.append(Support(points_at(mesh, 0, 2.0), displacement=moved))
    ramp = smooth_ramp(0.5 * span.end_time) if ramped else None
    problem = Problem(mesh, SOFT, tuple(supports), (load,) if load else (), span)
    result = simulate(
        problem,
        strain=strain,
        element=element,
        amplitude=ramp,
        support_amplitude=ramp,
        tracks_energy=True,
    )
    assert result.num_steps == 10_000
    return result


def imbalance(result: DynamicResult, *, strain_share: float = 0.3) -> float:
    """Largest change of the balance over the largest work."""
    assert result.energies is not None
    total = np.abs(result.energies.external_work).max()
    assert total > 1.0
    assert result.energies.strain.max() > strain_share * total
    return float(np.abs(result.energies.balance - result.energies.balance[0]).max() / total)


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("kind", ["weight", "traction", "pressure"])
def test_energy_is_balanced_for_a_ramped_load(kind: str, damping: float, strain: Strain) -> None:
    if (kind, strain) == ("pressure", Strain.LINEAR):
        strain = Strain.GREEN  # under linear strain a pressure is a traction
    mesh = block()
    loads: dict[str, Load] = {
        "weight": BodyForce((0.0, 60.0, -300.0)),
        "traction": Traction(facets_at(mesh, 0, 2.0), (800.0, 0.0, -200.0)),
        "pressure": Pressure(facets_at(mesh, 2, 1.0), 300.0),
    }
    assert imbalance(run(mesh, loads[kind], damping, strain=strain)) < RAMPED


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_energy_is_balanced_where_supports_are_moved(damping: float, element: Element) -> None:
    result = run(block(), None, damping, moved=(0.2, 0.1, 0.0), element=element)
    assert imbalance(result) < RAMPED


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_energy_is_balanced_on_a_shaken_support(damping: float) -> None:
    """Sine from the first step on, well below the resonances."""
    mesh = block()
    step = 0.5 * Body(mesh, SOFT).critical_time_step()
    span = TimeSpan(10_000 * step, step, damping, 50)
    supports = (
        Support(points_at(mesh, 0, 0.0)),
        Support(points_at(mesh, 0, 2.0), displacement=(0.1, 0.05, 0.0)),
    )
    result = simulate(
        Problem(mesh, SOFT, supports, (), span),
        support_amplitude=[None, lambda t: np.sin(0.5 * t)],
        tracks_energy=True,
    )
    # With damping the shaking goes on paying for what is lost.
    assert imbalance(result, strain_share=0.01 if damping else 0.3) < SUDDEN


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_energy_is_balanced_for_a_sudden_load(
    damping: float, strain: Strain, element: Element
) -> None:
    load = BodyForce((0.0, 40.0, -200.0))
    result = run(block(), load, damping, ramped=False, strain=strain, element=element)
    assert imbalance(result) < SUDDEN


@pytest.mark.parametrize(("ramped", "limit"), [(True, RAMPED), (False, SUDDEN)])
def test_a_wrong_force_breaks_the_balance(ramped: bool, limit: float) -> None:
    """The step has a shear modulus 1 % too large; psi(F) does not."""
    mesh = block()
    step = 0.5 * Body(mesh, SOFT).critical_time_step()
    span = TimeSpan(10_000 * step, step, num_outputs=50)
    # The same lmbda with 1.01 mu: E = mu (3 lmbda + 2 mu) / (lmbda + mu).
    lmbda, mu = lame_parameters(SOFT)
    mu *= 1.01
    stiffer = Material(mu * (3 * lmbda + 2 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu), 1000.0)
    assert lame_parameters(stiffer) == pytest.approx((lmbda, mu))
    fixed = Support(points_at(mesh, 0, 0.0))
    problem = Problem(mesh, stiffer, (fixed,), (BodyForce((0.0, 40.0, -200.0)),), span)
    ramp = smooth_ramp(0.5 * span.end_time) if ramped else None
    body = ExplicitBody(problem, amplitude=ramp, tracks_energy=True)
    body.elastic = Body(mesh, SOFT)
    recorder = Recorder(body, tracks_energy=True)
    for output in range(len(recorder.times)):
        if output > 0:
            body.step(body.steps_per_output)
        recorder.record(output)
    assert imbalance(recorder.result()) > limit


def test_tracking_energy_changes_no_bit_of_the_trajectory() -> None:
    mesh = block()
    fixed = Support(points_at(mesh, 0, 0.0))
    pull = Traction(facets_at(mesh, 0, 2.0), (500.0, 0.0, -100.0))
    problem = Problem(mesh, SOFT, (fixed,), (pull,), TimeSpan(3.0, num_outputs=5))
    tracked, plain = (simulate(problem, tracks_energy=t).displacements for t in (True, False))
    np.testing.assert_array_equal(tracked, plain)


@pytest.mark.parametrize("law", FINITE_LAWS)
def test_motion_of_every_law_keeps_its_energy(law: Law) -> None:
    mesh = brick_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    fixed = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    load = Traction(facets_at(mesh, 0, 2.0), (0.0, 0.0, -100.0))
    step = 0.25 * Body(mesh, example_material(law)).critical_time_step()
    span = TimeSpan(4000 * step, step, num_outputs=20)
    problem = Problem(mesh, example_material(law), (fixed,), (load,), span)
    ramp = smooth_ramp(0.5 * span.end_time)
    result = simulate(problem, amplitude=ramp, tracks_energy=True)
    energies = result.energies
    assert energies is not None
    total = np.abs(energies.external_work).max()
    assert total > 1.0
    assert energies.strain.max() > 0.3 * total
    assert np.abs(energies.balance - energies.balance[0]).max() < 1e-5 * total
