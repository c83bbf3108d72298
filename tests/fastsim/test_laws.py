"""Every law, element by element: derivatives, small strains, precision, motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.newton import Iteration
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

MakeBox = Callable[..., TetMesh]
FINITE = [law for law in Law if not law.is_linear_in_strain]
LAWS = pytest.mark.parametrize("law", FINITE)


def shake(mesh: TetMesh, size: float) -> np.ndarray:
    return size * np.random.default_rng(3).standard_normal(mesh.points.shape)


def facets_at(mesh: TetMesh, axis: int, place: float) -> np.ndarray:
    corners = mesh.points[mesh.boundary_facets]
    return mesh.boundary_facets[(np.abs(corners[:, :, axis] - place) < 1e-9).all(axis=1)]


@LAWS
def test_force_is_the_derivative_of_energy_and_tangent_that_of_force(
    make_box: MakeBox, law: Law
) -> None:
    mesh = make_box((2, 2, 2), (1.0, 1.0, 1.0), ragged=0.2)
    body, u = Body(mesh, example_material(law)), shake(mesh, 0.05)
    way = np.random.default_rng(4).standard_normal(u.shape)
    way /= np.linalg.norm(way)
    h = 1e-5
    force = body.internal_force(u)
    ahead, behind = u + h * way, u - h * way
    work = (body.strain_energy(ahead) - body.strain_energy(behind)) / (2 * h)
    assert abs(float(np.sum(force * way))) > 0.05 * np.linalg.norm(force)
    assert work == pytest.approx(float(np.sum(force * way)), rel=1e-6)
    change = (body.internal_force(ahead) - body.internal_force(behind)) / (2 * h)
    body.core.assemble_tangent(u)
    product = body.core.multiply(way)
    assert np.linalg.norm(product - change) < 1e-7 * np.linalg.norm(change)


@LAWS
def test_at_rest_it_is_hookes_law(make_box: MakeBox, law: Law) -> None:
    """No stress, the stiffness of linear strain, and all digits of small displacements."""
    mesh = make_box((2, 2, 2), (1.0, 1.0, 1.0), ragged=0.2)
    body, hooke = (
        Body(mesh, example_material(law)),
        Body(mesh, example_material(law), Strain.LINEAR),
    )
    assert not body.internal_force(np.zeros_like(mesh.points)).any()
    assert body.strain_energy(np.zeros_like(mesh.points)) == 0.0
    way = shake(mesh, 1.0)
    for b in (body, hooke):
        b.core.assemble_tangent(np.zeros_like(way))
    stiff = hooke.core.multiply(way)
    assert np.abs(body.core.multiply(way) - stiff).max() < 1e-13 * np.abs(stiff).max()
    # Of a displacement by 1e-9, terms of second order are 1e-9 of the force; rounding is 1e-14.
    for size in (1e-9, 1e-12):
        force = body.internal_force(size * way)
        assert np.abs(force / size - stiff).max() < (20 * size + 1e-13) * np.abs(stiff).max()


@LAWS
def test_turned_bodies_have_turned_forces(make_box: MakeBox, law: Law) -> None:
    mesh = make_box((2, 1, 1), (1.0, 0.5, 0.5), ragged=0.2)
    body, u = Body(mesh, example_material(law)), shake(mesh, 0.05)
    Q, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    turned = (mesh.points + u) @ Q.T - mesh.points
    force = body.internal_force(u)
    assert np.abs(body.internal_force(turned) - force @ Q.T).max() < 1e-12 * np.abs(force).max()
    assert body.strain_energy(turned) == pytest.approx(body.strain_energy(u), rel=1e-12)


@LAWS
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("at_most", ["baseline", "avx2", "avx512"])
@pytest.mark.parametrize("mixed", [False, True])
def test_the_step_has_the_forces_of_the_plain_loop(
    make_box: MakeBox, law: Law, precision: Precision, at_most: str, mixed: bool
) -> None:
    """Also where the volume changes by half: logarithms and roots far from 1."""
    mesh = make_box((3, 3, 3), (1.0, 1.0, 1.0), ragged=0.2)
    stiff = dataclasses.replace(example_material(law), youngs_modulus=3e4)
    inclusions = (Inclusion(np.arange(0, 60, 2), stiff),) if mixed else ()
    body = Body(mesh, example_material(law), inclusions=inclusions)
    run = _core.ExplicitRun.make(
        body.core,
        body.lumped_mass,
        np.ones(mesh.points.shape, dtype=np.uint8),
        time_step=1e-3,
        mass_damping=0.0,
        displacement_limit=1e3,
        num_threads=1,
        at_most=getattr(_core.InstructionSet, at_most),
        stiffness_damping=0.0,
        is_single=precision is Precision.SINGLE,
        tracks_energy=False,
    )
    limit = 1e-12 if precision is Precision.DOUBLE else 1e-5
    for stretch in (-0.25, 0.0, 0.3):
        u = shake(mesh, 0.02) + stretch * mesh.points
        run.set_state(u, np.zeros_like(u), 0.0)
        force = np.empty_like(u)
        run.internal_force(force)
        right = body.internal_force(u)
        assert np.abs(force - right).max() < limit * np.abs(right).max(), stretch


@LAWS
@pytest.mark.parametrize("volume", [1e-3, 0.03, 0.7, 1.45, 3.0, 400.0])
def test_logarithm_and_root_hold_from_crushed_to_blown_up(
    make_box: MakeBox, law: Law, volume: float
) -> None:
    mesh = make_box((1, 1, 1), (1.0, 1.0, 1.0))
    body = Body(mesh, example_material(law))
    u = (np.cbrt(volume) - 1.0) * mesh.points
    stepped = ExplicitBody(
        Problem(mesh, example_material(law), (), ()), displacement=u, time_step=1e-6
    )
    u = stepped.displacement
    force = np.empty_like(u)
    stepped.run.internal_force(force)
    right = body.internal_force(u)
    assert np.abs(force - right).max() < 2e-6 * np.abs(right).max()


@LAWS
def test_free_motion_keeps_its_energy(make_box: MakeBox, law: Law) -> None:
    mesh = make_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    held = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    load = Traction(facets_at(mesh, 0, 2.0), (0.0, 0.0, -100.0))
    step = 0.25 * Body(mesh, example_material(law)).critical_time_step()
    span = TimeSpan(4000 * step, step, num_outputs=20)
    problem = Problem(mesh, example_material(law), (held,), (load,), span)
    ramp = smooth_ramp(0.5 * span.end_time)
    result = simulate(problem, amplitude=ramp, tracks_energy=True)
    energies = result.energies
    assert energies is not None
    total = np.abs(energies.external_work).max()
    assert total > 1.0
    assert energies.strain.max() > 0.3 * total
    assert np.abs(energies.balance - energies.balance[0]).max() < 1e-5 * total


def test_what_knows_one_law_says_so(make_box: MakeBox) -> None:
    mesh = make_box((1, 1, 1), (1.0, 1.0, 1.0))
    rubber = example_material(Law.NEO_HOOKEAN)
    held = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    problem = Problem(mesh, rubber, (held,), (Pressure(facets_at(mesh, 0, 1.0), 10.0),))
    with pytest.raises(InputError, match=r"secant.*follows neo-hookean"):
        solve_static(problem, iteration=Iteration.SECANT)
