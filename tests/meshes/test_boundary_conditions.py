"""Supports and loads: their points, supports that contradict each other, facets inside a body."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
    gravity,
    spread_force,
)
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import (
    DisagreeingSupportsError,
    FacetNotOnBoundaryError,
    IndexRangeError,
    InputError,
)
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.meshes.tet_mesh import CELL_FACETS
from palpate.validation.exchange.nodal_arrays import fixed_components
from palpate.validation.metrics.audit import audit_on_own_mesh


def test_the_corners_of_held_facets_are_held_points() -> None:
    facets = np.array([[4, 2, 7], [2, 4, 9]])
    assert Support([], facets).points.tolist() == [2, 4, 7, 9]  # type: ignore[arg-type]
    assert Support(np.array([5, 2]), facets).points.tolist() == [2, 4, 5, 7, 9]
    # What is complete stays as it was given: the key of a problem depends on it.
    given = np.array([9, 7, 4, 2], dtype=np.int32)
    assert Support(given, facets).points is given
    assert Support(given).points is given


def test_whoever_reads_a_problem_sees_points_that_only_facets_name() -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    fixed = facets[(mesh.points[facets][:, :, 0] == 0.0).all(axis=1)]
    loads = (BodyForce((0.0, 0.0, -50.0)),)
    problem = Problem(mesh, Material(1e4, 0.3), (Support((), fixed),), loads)  # type: ignore[arg-type]
    found = solve_static(problem)
    assert (
        np.flatnonzero(fixed_components(problem)[0].all(axis=1)).tolist()
        == np.unique(fixed).tolist()
    )
    audit = audit_on_own_mesh(problem, found.displacement, found.strain)
    assert audit.relative_residual_norm < 1e-8


@pytest.mark.parametrize(
    ("supports", "loads", "words"),
    [
        ((Support([5000]),), (), "points of support 1"),  # type: ignore[arg-type]
        ((Support([0], [[0, 1, -2]]),), (), "points of support 1"),  # type: ignore[arg-type]
        ((), (BodyForce((0.0, 0.0, 1.0)), Traction([[0, 1, 99]], (1.0, 0.0, 0.0))), "load 2"),  # type: ignore[arg-type]
        ((), (Pressure([[0, -1, 2]], 1.0),), "facets of load 1"),  # type: ignore[arg-type]
        ((), (PointForce([12], [[0.0, 0.0, 1.0]]),), "points of load 1"),  # type: ignore[arg-type]
    ],
)
def test_a_point_that_the_mesh_does_not_have_is_refused_by_the_problem(
    supports: tuple[Support, ...], loads: tuple[Load, ...], words: str
) -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))  # 12 points
    with pytest.raises(IndexRangeError, match=words):
        Problem(mesh, Material(1e4, 0.3), supports, loads)


def test_lists_of_points_and_facets_are_as_good_as_arrays() -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    fixed, pulled = (
        facets[(mesh.points[facets][:, :, 0] == x).all(axis=1)].tolist() for x in (0.0, 2.0)
    )
    load = Traction(pulled, (20.0, 0.0, 0.0))
    problem = Problem(mesh, Material(1e4, 0.3), (Support([], fixed),), (load,))  # type: ignore[arg-type]
    assert solve_static(problem).displacement[:, 0].max() > 0.0
    given = problem.loads[0]
    assert dataclasses.replace(problem).loads[0] is given


MESH = brick_box((2, 2, 2), (1.0, 1.0, 1.0))
ROOT, FLOOR = side(MESH, 0, 0.0), side(MESH, 2, 0.0)
SOFT = Material(1e3, 0.3)
EDGE = np.intersect1d(ROOT, FLOOR).tolist()
UP = (False, False, True)


def problem(*supports: Support, time: TimeSpan | None = None) -> Problem:
    return Problem(MESH, SOFT, supports, (), time)


def refused(*supports: Support, time: TimeSpan | None = None) -> DisagreeingSupportsError:
    with pytest.raises(DisagreeingSupportsError) as caught:
        problem(*supports, time=time)
    return caught.value


def test_two_places_of_one_component() -> None:
    lifted = support_of(FLOOR, UP, (0.0, 0.0, 0.01))
    error = refused(support_of(ROOT), lifted)
    assert error.points == EDGE
    assert error.supports == (1, 2)
    assert "along z one wants 0 m and the other 0.01 m; separate" in str(error)
    assert refused(lifted, support_of(side(MESH, 0, 1.0), UP), support_of(ROOT)).supports == (1, 2)
    # Other components, or the same place, or no shared point, agree.
    problem(support_of(ROOT, (True, True, False)), lifted)
    problem(support_of(ROOT, displacement=(0.0, 0.0, 0.01)), lifted)
    problem(support_of(side(MESH, 2, 1.0)), lifted)


def test_a_turn_agrees_where_it_does_not_move() -> None:
    turned = dataclasses.replace(
        support_of(ROOT), rotation=Rotation((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), 0.3)
    )
    problem(turned, support_of(FLOOR, (False, True, False)))
    # The axis runs through the edge, the only points that both hold.
    problem(turned, support_of(FLOOR))
    off = dataclasses.replace(turned, rotation=Rotation((0.0, 1.0, 0.0), (0.0, 0.0, 0.5), 0.3))
    error = refused(off, support_of(FLOOR))
    assert error.points == EDGE
    # By half a turn about the edge's middle line: x goes to 2 r, sin(0.3) / 2 here.
    assert f"{math.sin(0.3) * -0.5:.6g} m" in str(error)
    # A whole turn comes back; half-way it is elsewhere.
    whole = dataclasses.replace(
        turned, rotation=Rotation((0.0, 1.0, 0.0), (0.0, 0.0, 0.5), 2 * math.pi)
    )
    refused(whole, support_of(FLOOR))


def test_slanted_planes_agree_where_they_cross_and_where_one_follows_from_others() -> None:
    s = math.sqrt(0.5)
    slope = Support(np.unique(ROOT), ROOT, normal=(s, 0.0, s))
    floor = support_of(FLOOR, (True, False, True), (0.02, 0.0, 0.0))
    error = refused(floor, slope)
    assert error.points == EDGE
    assert error.supports == (1, 2)
    assert "(0.7071, 0, 0.7071)" in str(error)
    along = dataclasses.replace(slope, displacement=(0.02, 0.0, 0.0))
    problem(floor, along)
    # Rollers leave x free: nothing to disagree on.
    problem(support_of(FLOOR, UP, (0.0, 0.0, 0.01)), slope)
    twice = dataclasses.replace(slope, displacement=(0.0, 0.0, 0.01))
    assert refused(slope, twice).supports == (1, 2)


def test_in_motion_every_time_counts() -> None:
    time = TimeSpan(1.0)
    ramp, late = (
        TabularAmplitude((0.0, t, 1.0), (0.0, 1.0, 1.0), is_smooth=True) for t in (0.2, 0.5)
    )
    lift = (0.0, 0.0, 0.01)
    one = support_of(ROOT, displacement=lift)
    both = [dataclasses.replace(one, amplitude=a) for a in (ramp, late)]
    other = support_of(FLOOR, UP, lift)
    error = refused(both[0], dataclasses.replace(other, amplitude=late), time=time)
    # The middle of the first stretch: half of one lift, 0.1 s into the other's half second.
    assert error.time == pytest.approx(0.1)
    assert "at 0.1 s" in str(error)
    problem(both[0], dataclasses.replace(other, amplitude=ramp), time=time)
    # Statics take amplitudes as 1.
    problem(both[0], dataclasses.replace(other, amplitude=late))


def inside() -> np.ndarray:
    every = MESH.cells[:, CELL_FACETS].reshape(-1, 3)
    known = {tuple(row) for row in np.sort(MESH.boundary_facets, axis=1).tolist()}
    return np.array([row for row in every if tuple(sorted(row.tolist())) not in known][:1])


def test_facets_inside_the_body_are_refused() -> None:
    facets = np.vstack([ROOT, inside()])
    plate = RigidTool(
        PlaneShape(), ToolPath(np.zeros(1), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]))
    )
    for what, given in (
        ("facets of load 1", {"loads": (Pressure(facets, 1.0),)}),
        ("facets of load 1", {"loads": (Traction(facets, (1.0, 0.0, 0.0)),)}),
        ("facets of support 2", {"supports": (support_of(FLOOR), support_of(facets))}),
        (
            "contact_facets of tool 1",
            {"tools": (dataclasses.replace(plate, contact_facets=facets),)},
        ),
    ):
        reported = {"supports": (support_of(FLOOR),), "loads": ()} | given
        with pytest.raises(FacetNotOnBoundaryError, match=what) as caught:
            Problem(MESH, SOFT, **reported)
        assert caught.value.rows == [len(ROOT)]
        assert str(inside()[0].tolist()) in str(caught.value)
        assert "choose boundary facets" in str(caught.value)


def test_a_facet_twice_is_refused_whatever_its_corners_order() -> None:
    twice = np.vstack([ROOT, ROOT[:1, [1, 2, 0]]])
    with pytest.raises(FacetNotOnBoundaryError, match="given twice") as caught:
        Problem(MESH, SOFT, (support_of(FLOOR),), (Traction(twice, (1.0, 0.0, 0.0)),))
    assert caught.value.rows == [len(ROOT)]


def test_a_force_is_spread_over_the_facets_of_a_region_and_over_no_others():
    body = brick_box((3, 2, 2), (0.06, 0.02, 0.02))
    load = spread_force(body, (0.4, -0.2, 0.1), lambda x: x[:, 0] > 0.0599)
    # 20 mm by 20 mm: 0.4 N over 4e-4 m2.
    assert load.traction == pytest.approx((1000.0, -500.0, 250.0), rel=1e-12)
    assert (body.points[load.facets][..., 0] == 0.06).all()
    with pytest.raises(InputError, match="no boundary facet"):
        spread_force(body, (1.0, 0.0, 0.0), lambda x: x[:, 0] > 1.0)
    with pytest.raises(InputError, match="one truth value for each"):
        spread_force(body, (1.0, 0.0, 0.0), lambda _x: np.array([True]))


def test_gravity_is_the_weight_per_volume_of_a_density_above_zero():
    assert gravity((0.0, 0.0, -9.81), 1000.0) == BodyForce((0.0, 0.0, -9810.0))
    for density in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="density"):
            gravity((0.0, 0.0, -9.81), density)
