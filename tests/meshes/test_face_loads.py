"""Tractions that vary over a face: by values, by a profile, as a moment."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.face_loads import (
    Profile,
    affine_traction,
    moment_traction,
    profile_traction,
)
from palpate.meshes.problem import Material, Problem
from palpate.meshes.problem_files import load_problem, problem_arrays, save_problem
from palpate.meshes.transforms import change_units, rotation, scale_loads, turn

MESH = brick_box((2, 3, 4), (1.0, 0.6, 0.8), ragged=0.2)
END = side(MESH, 0, 1.0)


def random_traction() -> Traction:
    rng = np.random.default_rng(3)
    bent = rng.standard_normal((3, 3, 3))
    return Traction(
        END,
        (1.0, -2.0, 0.5),
        gradient=rng.standard_normal((3, 3)),
        curvature=bent + bent.transpose(0, 2, 1),
    )


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_given_values_are_taken_where_they_were_given(count):
    rng = np.random.default_rng(count)
    positions, values = rng.standard_normal((2, count, 3))
    load = affine_traction(END, positions, values)
    assert np.abs(load.at(positions) - values).max() < 1e-12
    assert load.is_uniform == (count == 1)


def test_two_places_say_nothing_across_their_line():
    load = affine_traction(END, [[0, 0, 0], [0, 0, 2]], [[0, 0, 1], [0, 6, 1]])
    assert load.at(np.array([[5.0, -3.0, 1.0]])) == pytest.approx(np.array([[0.0, 3.0, 1.0]]))


def test_values_far_from_the_origin_keep_their_digits():
    positions = np.array([[1e3, 0, 0], [1e3, 0.1, 0], [1e3, 0, 0.1]])
    values = np.array([[1.0, 0, 0], [2.0, 0, 0], [1.0, 5.0, 0]])
    assert np.abs(affine_traction(END, positions, values).at(positions) - values).max() < 1e-10


@pytest.mark.parametrize(
    ("positions", "values"),
    [
        # On one line, and not on one straight slope.
        ([[0, 0, 0], [0, 0, 1], [0, 0, 2]], [[0, 0, 0], [1, 0, 0], [4, 0, 0]]),
        # Four corners of a square, twisted.
        (
            [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]],
            [[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]],
        ),
        # One place, two values.
        ([[1, 2, 3], [1, 2, 3]], [[1, 0, 0], [2, 0, 0]]),
    ],
)
def test_values_of_no_affine_field_are_refused(positions, values):
    with pytest.raises(InputError, match="not those of one affine field"):
        affine_traction(END, positions, values)


@pytest.mark.parametrize("positions", [np.zeros((5, 3)), np.zeros((0, 3)), np.zeros((2, 2))])
def test_other_numbers_of_places_are_refused(positions):
    with pytest.raises(InputError, match="1 to 4 places"):
        affine_traction(END, positions, positions)


def test_nan_is_refused():
    with pytest.raises(InputError, match="NaN"):
        affine_traction(END, [[0, 0, 0]], [[0, np.nan, 0]])
    with pytest.raises(InputError, match="finite"):
        moment_traction(MESH, END, (0.0, np.inf, 0.0))
    with pytest.raises(InputError, match="gradient"):
        Traction(END, (0.0, 0.0, 0.0), gradient=np.full((3, 3), np.nan))
    with pytest.raises(InputError, match="curvature"):
        Traction(END, (0.0, 0.0, 0.0), curvature=np.arange(27.0).reshape(3, 3, 3))


def test_profiles_by_their_definitions():
    start, end, peak = np.array([1.0, 0.1, 0.2]), np.array([1.0, 0.5, 0.2]), np.array([1.0, 2, -3])
    s = np.array([0.0, 0.25, 0.5, 1.0, 1.5])
    positions = start + s[:, None] * (end - start) + np.array([0.3, 0.0, -7.0])  # and across
    for profile, shape in (
        (Profile.UNIFORM, np.ones(5)),
        (Profile.LINEAR, s),
        (Profile.PARABOLIC, 4.0 * s * (1.0 - s)),
    ):
        load = profile_traction(END, peak, profile, start, end)
        assert np.abs(load.at(positions) - shape[:, None] * peak).max() < 1e-12
    with pytest.raises(InputError, match="two places"):
        profile_traction(END, peak, Profile.LINEAR, start, start)


def test_a_moment_has_no_force_and_is_itself():
    from palpate.validation.exchange.nodal_arrays import nodal_force

    # Not flat: one side and the next.
    facets = np.vstack([END, side(MESH, 2, 0.8)])
    moment = np.array([1.0, -2.0, 3.0])
    nodal = nodal_force(MESH, moment_traction(MESH, facets, moment))
    assert np.abs(nodal).sum() > 1.0
    assert np.abs(nodal.sum(axis=0)).max() < 1e-13 * np.abs(nodal).sum()
    for position in ([0.0, 0.0, 0.0], [5.0, -3.0, 1.0]):
        found = np.cross(MESH.points - position, nodal).sum(axis=0)
        assert found == pytest.approx(moment, rel=1e-12)


def test_torsion_and_bending_are_the_stresses_of_the_books():
    # Of the face 0.6 x 0.8 about its middle: Iy = b h^3 / 12 and so on.
    i_y, i_z = 0.6 * 0.8**3 / 12.0, 0.8 * 0.6**3 / 12.0
    centre = np.array([1.0, 0.3, 0.4])
    corner = np.array([[1.0, 0.6, 0.8]])
    bent = moment_traction(MESH, END, (0.0, 5.0, 0.0)).at(corner)
    assert bent == pytest.approx(np.array([[5.0 * 0.4 / i_y, 0.0, 0.0]]), rel=1e-12)
    twisted = moment_traction(MESH, END, (5.0, 0.0, 0.0)).at(corner)
    rate = 5.0 / (i_y + i_z)
    assert twisted == pytest.approx(np.array([[0.0, -rate * 0.4, rate * 0.3]]), rel=1e-12)
    assert np.abs(moment_traction(MESH, END, (5.0, 0.0, 0.0)).at(centre)).max() < 1e-12


def problem_of(load: Traction) -> Problem:
    return Problem(MESH, Material(1e3, 0.3), (support_of(side(MESH, 0, 0.0)),), (load,))


@pytest.mark.parametrize("is_mirror", [False, True])
def test_turned_scaled_and_in_other_units_it_is_the_same_field(is_mirror):
    load, problem = random_traction(), problem_of(random_traction())
    positions = MESH.points[np.unique(END)]
    R = rotation((1.0, 2.0, 3.0), 70.0) @ np.diag([1.0, -1.0 if is_mirror else 1.0, 1.0])
    turned = turn(problem, R)[0].loads[0]
    assert np.abs(turned.at(positions @ R.T) - load.at(positions) @ R.T).max() < 1e-12
    millimetres = change_units(problem, 1e3)[0].loads[0]
    assert np.abs(millimetres.at(1e3 * positions) - 1e-6 * load.at(positions)).max() < 1e-17
    halved = scale_loads(problem, -0.5).loads[0]
    assert np.abs(halved.at(positions) + 0.5 * load.at(positions)).max() < 1e-14


def test_a_problem_file_keeps_it_and_a_uniform_one_is_as_before(tmp_path):
    problem = problem_of(random_traction())
    save_problem(tmp_path / "p.npz", problem)
    (back,) = load_problem(tmp_path / "p.npz").loads
    assert np.array_equal(back.gradient, problem.loads[0].gradient)
    assert np.array_equal(back.curvature, problem.loads[0].curvature)
    plain = problem_arrays(problem_of(Traction(END, (1.0, 0.0, 0.0))))
    assert not any("gradient" in name or "curvature" in name for name in plain)
