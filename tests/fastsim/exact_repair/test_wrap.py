"""New surfaces around anything: closed, without crossings, within the distance."""

from __future__ import annotations

import re

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.exact_repair.patch_repairs import all_crossings
from palpate.fastsim.exact_repair.wrap import WrapError, WrapReport, wrap_surface
from palpate.fastsim.mesher import TimeLimitError
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.shells import winding_numbers
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import EmptySurfaceError, TriSurface

BALL = shape_sphere(1.0, edge_length=0.2)


def ignore(_cubes: int) -> None:
    """A watch that lets it go on."""


def require_wrapped(given: TriSurface, distance: float) -> tuple[TriSurface, WrapReport]:
    new, report = wrap_surface(given, distance=distance)
    require_closed(new)
    assert len(all_crossings(new.points, new.facets)) == 0
    assert 0.0 < report.from_given <= distance
    return new, report


def test_a_sound_surface_keeps_its_place_and_volume() -> None:
    new, report = require_wrapped(BALL, 0.2)
    assert report.bridging == report.lost == 0.0
    # A layer of half the distance on its area is the most that could come or go.
    assert abs(new.volume - BALL.volume) < 0.1 * BALL.area
    nearest = _core.SurfaceDistance(BALL.points, BALL.facets).distances(new.points)
    assert nearest.max() <= report.from_given


def test_soup_with_gaps_is_closed() -> None:
    rng = np.random.default_rng(3)
    corners = BALL.points[BALL.facets]
    corners = corners + 0.01 * rng.standard_normal(corners.shape)
    corners = corners[rng.random(len(corners)) < 0.9]
    soup = TriSurface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    new, _ = require_wrapped(soup, 0.25)
    assert new.volume == pytest.approx(BALL.volume, rel=0.1)


def test_bodies_that_cross_become_one_and_a_wall_within_is_told() -> None:
    both = TriSurface(
        np.vstack([BALL.points, BALL.points + np.array([1.0, 0.0, 0.0])]),
        np.vstack([BALL.facets, BALL.facets + len(BALL.points)]),
    )
    new, report = require_wrapped(both, 0.2)
    assert len(require_closed(new)) == 1
    # Two balls less their lens, pi (4 + d) (2 - d)^2 / 12 for a distance d of unit balls, with
    # the volume of these polyhedra instead of 4 pi / 3.
    lens = np.pi * 5.0 / 12.0
    assert new.volume == pytest.approx(2 * BALL.volume - lens, rel=0.05)
    assert report.lost > 0.1
    assert "inner or thin" in report.line()


def test_a_hole_is_bridged_and_told() -> None:
    top = BALL.points[BALL.facets].mean(axis=1)[:, 2] > 0.7
    new, report = require_wrapped(TriSurface(BALL.points, BALL.facets[~top]), 0.15)
    assert report.bridging > 0.0
    assert report.bridge_distance > 0.15
    assert "bridge holes" in report.line()
    assert new.volume == pytest.approx(BALL.volume, rel=0.15)


def test_what_cannot_be_wrapped_is_refused() -> None:
    sheet = TriSurface(BALL.points, BALL.facets[BALL.points[BALL.facets, 2].min(axis=1) > 0.9])
    with pytest.raises(WrapError, match="enclose nothing"):
        wrap_surface(sheet, distance=0.2)
    with pytest.raises(WrapError, match="enclose nothing"):
        wrap_surface(BALL, distance=1e170)  # so coarse that the number of cubes is 0.0
    with pytest.raises(WrapError, match=r"about 3\.\de\+19 cubes.* 0\.00\d+ m would do"):
        wrap_surface(BALL, distance=1e-9)
    with pytest.raises(EmptySurfaceError):
        wrap_surface(TriSurface(BALL.points, BALL.facets[:, [0, 0, 1]]), distance=0.1)
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError):
            wrap_surface(BALL, distance=bad)


def test_the_grid_alone_is_closed_and_crosses_nothing() -> None:
    box = shape_box((1.0, 0.7, 0.4), edge_length=0.35)
    made = _core.wrap_surface(box.points, box.facets, 0.1, 100_000, ignore)
    new = TriSurface(made.points, made.facets)
    (shell,) = require_closed(new)
    assert shell.volume > 0.0
    assert len(all_crossings(new.points, new.facets)) == 0
    # Inside of it is where the box's winding number is one.
    cells = np.random.default_rng(1).uniform([-0.1, -0.1, -0.1], [1.1, 0.8, 0.5], (200, 3))
    far = _core.SurfaceDistance(box.points, box.facets).distances(cells) > 0.1
    assert np.array_equal(
        winding_numbers(new, cells[far]) > 0.5, winding_numbers(box, cells[far]) > 0.5
    )
    assert _core.wrap_surface(box.points, box.facets, 0.1, 10, ignore).is_too_fine


@pytest.mark.parametrize("body", [BALL, shape_box((1.0, 0.7, 0.4), edge_length=0.35)])
def test_the_distance_that_is_said_to_do_does(
    body: TriSurface, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.fastsim.exact_repair.wrap._MOST_CUBES", 1_500)
    with pytest.raises(WrapError, match="would do") as caught:
        wrap_surface(body, distance=0.01)
    (enough,) = re.findall(r"([\d.]+) m would do", str(caught.value))
    require_wrapped(body, float(enough))
    with pytest.raises(WrapError, match="would do"):
        wrap_surface(body, distance=0.95 * float(enough))


def test_a_wide_hole_that_takes_too_many_cubes_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    half = BALL.facets[BALL.points[BALL.facets].mean(axis=1)[:, 2] < 0.0]
    monkeypatch.setattr("palpate.fastsim.exact_repair.wrap._MOST_CUBES", 1_900)
    with pytest.raises(WrapError, match=r"holes are bridged.* try 0\.2 m"):
        wrap_surface(TriSurface(BALL.points, half), distance=0.1)


def test_facets_that_face_inwards_are_taken_the_other_way_round() -> None:
    inward = TriSurface(BALL.points, BALL.facets[:, ::-1])
    new, report = require_wrapped(inward, 0.2)
    outward, _ = require_wrapped(BALL, 0.2)
    assert report.is_inward
    assert "the facets face inwards" in report.line()
    assert new.volume == outward.volume


def test_distances_are_upper_bounds() -> None:
    top = BALL.points[BALL.facets].mean(axis=1)[:, 2] > 0.7
    given = TriSurface(BALL.points, BALL.facets[~top])
    new, report = require_wrapped(given, 0.15)
    weights = np.random.default_rng(1).dirichlet([1.0, 1.0, 1.0], 50)
    samples = np.einsum("sk,fkx->fsx", weights, new.points[new.facets]).reshape(-1, 3)
    far = _core.SurfaceDistance(given.points, given.facets).distances(samples).max()
    assert far <= report.bridge_distance <= 1.05 * far
    (said,) = re.findall(r"up to ([\d.]+) m away", report.line())
    assert float(said) >= report.bridge_distance


def test_it_keeps_to_its_time_and_says_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(100_000))
    monkeypatch.setattr("palpate.fastsim.exact_repair.wrap.time.monotonic", lambda: next(clock))
    lines: list[str] = []
    with pytest.raises(TimeLimitError, match=r"no mesh within 9 s: .* while wrapping the surface"):
        wrap_surface(BALL, distance=0.02, time_limit=9.0, progress=lines.append)
    assert lines
    assert all(re.fullmatch(r"[a-z ]+: \d+ %", line) for line in lines)


def test_far_off_coordinates_that_leave_no_digits_are_refused() -> None:
    far = TriSurface(BALL.points + 1e14, BALL.facets)
    with pytest.raises(WrapError, match="no digits; move the surface near the origin"):
        wrap_surface(far, distance=0.1)
