"""Strain, energy, force and local-volume metrics against closed forms of homogeneous states."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bank import made_state
from making import look_up
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.meshes.boundary_conditions import Pressure, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics import CATALOGUE, inverted_cells, measure
from palpate.validation.metrics.body import body_of, load_force
from palpate.validation.states import State, Verdict

E, NU = 1000.0, 0.25
LMBDA, MU = 400.0, 400.0  # both are E / 2.5 at Poisson's ratio 0.25
MESH = brick_box((3, 2, 2), (3.0, 1.0, 2.0), ragged=0.2)
LEFT = np.flatnonzero(MESH.points[:, 0] == 0.0).astype(np.int32)
RIGHT = np.flatnonzero(MESH.points[:, 0] == 3.0).astype(np.int32)
PROBLEM = Problem(MESH, Material(E, NU), (Support(LEFT), Support(RIGHT)), ())
VOLUME, SECTION = 6.0, 2.0
ROUNDING = 1e3 * np.finfo(float).eps


def stretched(a: float) -> State:
    """Confined stretch: x becomes a x."""
    return made_state(MESH, MESH.points * [a - 1.0, 0, 0])


def test_energy_of_a_confined_stretch() -> None:
    # psi = (lmbda + 2 mu)/2 E11^2 with E11 = (a^2 - 1)/2.
    a = 1.2
    expected = VOLUME * (LMBDA + 2 * MU) / 2 * ((a * a - 1) / 2) ** 2
    found = body_of(PROBLEM, Strain.GREEN).energy(stretched(a).displacement)
    assert found == pytest.approx(expected, rel=ROUNDING)
    linear = body_of(PROBLEM, Strain.LINEAR).energy(stretched(a).displacement)
    assert linear == pytest.approx(VOLUME * (LMBDA + 2 * MU) / 2 * (a - 1) ** 2, rel=ROUNDING)


def test_support_forces_of_a_confined_stretch() -> None:
    # P11 = a (lmbda + 2 mu)(a^2 - 1)/2 on the section, pulled apart; free sides push nothing along.
    a = 0.9
    force = SECTION * a * (LMBDA + 2 * MU) * (a * a - 1) / 2
    found = body_of(PROBLEM, Strain.GREEN).support_reactions(stretched(a).displacement)
    assert found[1, 0] == pytest.approx(force, rel=ROUNDING)
    assert found[0, 0] == pytest.approx(-force, rel=ROUNDING)


def test_the_judges_force_is_the_derivative_of_its_energy_and_fastsims_own() -> None:
    rng = np.random.default_rng(5)
    u = 0.03 * rng.standard_normal(MESH.points.shape)
    for strain in Strain:
        force = body_of(PROBLEM, strain).internal(u)
        assert np.linalg.norm(force) > 1.0
        direction = rng.standard_normal(u.shape)
        step = 1e-5
        energies = [body_of(PROBLEM, strain).energy(u + s * step * direction) for s in (1, -1)]
        slope = (energies[0] - energies[1]) / (2 * step)
        assert slope == pytest.approx(float((force * direction).sum()), rel=1e-6)
        theirs = Body(MESH, PROBLEM.material, strain).internal_force(u)
        np.testing.assert_allclose(force, theirs, rtol=0.0, atol=ROUNDING * np.abs(theirs).max())
        ours = body_of(PROBLEM, strain).energy(u)
        assert ours == pytest.approx(
            Body(MESH, PROBLEM.material, strain).strain_energy(u), rel=ROUNDING
        )


def test_an_inclusion_counts_with_its_own_stiffness() -> None:
    cells = np.arange(10, dtype=np.int32)
    mixed = dataclasses.replace(PROBLEM, inclusions=(Inclusion(cells, Material(3 * E, NU)),))
    u = stretched(1.1).displacement
    part = body_of(mixed, Strain.GREEN).energy(u) - body_of(PROBLEM, Strain.GREEN).energy(u)
    corners = MESH.points[MESH.cells[:10]]
    inside = np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6.0
    expected = 2.0 * inside * (LMBDA + 2 * MU) / 2 * ((1.1**2 - 1) / 2) ** 2
    assert part == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # Stretches of 1.1 and 1.102: gradients 0.1 and 0.102.
        ("displacement_h1", 0.02),
        ("energy_norm", 0.02),
        ("local_volume", 0.02),
        ("strain_energy", ((1.102**2 - 1) / (1.1**2 - 1)) ** 2 - 1),
        ("reaction_force", 1.102 * (1.102**2 - 1) / (1.1 * (1.1**2 - 1)) - 1),
    ],
)
def test_errors_of_a_stretch_two_per_cent_too_large(name: str, expected: float) -> None:
    along = [Support(p, components=(True, False, False)) for p in (LEFT, RIGHT)]
    problem = dataclasses.replace(PROBLEM, supports=tuple(along))
    found = measure(name, problem, stretched(1.102), stretched(1.1)).value
    assert found == pytest.approx(expected, rel=1e-9)


def test_local_volume_sees_what_total_volume_does_not() -> None:
    # x^2-like motion: half of the body swells, half is squeezed, the ends stay.
    u = np.zeros_like(MESH.points)
    u[:, 0] = 0.05 * MESH.points[:, 0] * (3.0 - MESH.points[:, 0])
    bulged = made_state(MESH, u)
    rest = stretched(1.0)
    assert measure("volume", PROBLEM, bulged, rest).value < 1e-9
    assert measure("local_volume", PROBLEM, bulged, rest).value > 10.0


def test_inverted_cells_are_counted() -> None:
    u = np.zeros_like(MESH.points)
    assert inverted_cells(MESH, u) == 0
    inner = np.setdiff1d(np.arange(MESH.num_points), MESH.boundary_facets)[0]
    around = int((MESH.cells == inner).any(axis=1).sum())
    u[inner] = [100.0, 0.0, 0.0]
    count = inverted_cells(MESH, u)
    assert 0 < count < around
    state = made_state(MESH, u)
    spec = CheckSpec(metric="inverted_cells", against="candidate", limit=0.0, reason="r")
    check = judge_check(spec, Strain.GREEN, PROBLEM, state, None, 0.0, "")
    assert check.verdict is Verdict.FAILED
    assert check.unit == "cells"
    u[inner, 0] = math.nan
    assert inverted_cells(MESH, u) == around


def test_every_metric_of_a_case_file_is_in_the_catalogue_and_says_what_it_means() -> None:
    named = CheckSpec.model_fields["metric"].annotation
    assert set(named.__args__) == set(CATALOGUE)  # type: ignore[union-attr]
    for metric in CATALOGUE.values():
        assert metric.meaning
        assert metric.scale


# A function and a row of the table are all that a metric is made of.
NEW_METRIC = """
import sys
import numpy as np
import palpate
from palpate.meshes.problem import Strain
from palpate.validation.metrics import catalogue, comparison, make_state

def mean_error(pair):
    return float(np.linalg.norm(pair.error, axis=1).mean()), float(pair.read.doubt.mean())

catalogue.CATALOGUE["mean_error"] = catalogue.Metric(
    "mean_error", "mean error of displacement", "largest displacement of the reference",
    mean_error, comparison.largest_displacement_of,
)
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import judge_check
sys.path.append(sys.argv[1])
from making.look_up import metrics

problem = palpate.load_case("block").problem
right, wrong = (
    make_state(problem.mesh, u, label="x", simulator="x", strain=Strain.GREEN)
    for u in (np.full_like(problem.mesh.points, size) for size in (0.1, 0.11))
)
spec = CheckSpec(metric="mean_error", limit=0.05, reason="r")
for state in (right, wrong):
    print(judge_check(spec, Strain.GREEN, problem, state, right, 0.0, "").verdict)
assert "| `mean_error` | mean error of displacement | largest displacement of" in metrics()
"""


def test_a_new_metric_is_a_function_and_a_row_for_cases_verdicts_and_documentation() -> None:
    folder = Path(look_up.__file__).parent.parent
    command = [sys.executable, "-c", NEW_METRIC, str(folder)]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert ran.stdout.split() == ["passed", "failed"], ran.stderr


def test_a_pressure_all_around_works_on_the_change_of_volume(problem: Problem) -> None:
    """F . v = -p dV/dv: the force of a follower by a difference of volumes, 1e-6 of its size."""
    mesh, rng = problem.mesh, np.random.default_rng(3)
    load = Pressure(mesh.boundary_facets, 7.0)
    displacement, along = 0.05 * rng.standard_normal((2, *mesh.points.shape))
    h = 1e-6

    def volume(u: NDArray[np.float64]) -> float:
        return float(signed_volumes(mesh.points + u, mesh.cells).sum())

    change = (volume(displacement + h * along) - volume(displacement - h * along)) / (2.0 * h)
    force = load_force(mesh, load, displacement, Strain.GREEN)
    assert abs(change) > 1e-3
    assert float((force * along).sum()) == pytest.approx(-7.0 * change, rel=1e-6)
    # With linear strain it pushes on the surface at rest.
    at_rest = load_force(mesh, load, 0.0 * displacement, Strain.GREEN)
    np.testing.assert_array_equal(load_force(mesh, load, displacement, Strain.LINEAR), at_rest)


def test_a_solution_of_fastsim_is_in_balance_and_half_of_it_is_not(
    problem: Problem, solution: NDArray[np.float64]
) -> None:
    residual, scale = body_of(problem, Strain.GREEN).out_of_balance(solution)
    assert np.abs(residual).max() < 1e-9 * scale
    residual, scale = body_of(problem, Strain.GREEN).out_of_balance(0.5 * solution)
    assert np.abs(residual).max() > 0.01 * scale
