"""Holes of any form closed by caps that cross nothing and keep their names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.exact_repair.patch_repairs import all_crossings
from palpate.fastsim.exact_repair.solid_repair import repair_to_solid
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.repair.hole_filling import find_hole_loops
from palpate.meshes.shapes import shape_cylinder, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import OpenSurfaceError, TriSurface

Rows = np.ndarray  # type: ignore[type-arg]


def without(body: TriSurface, cut: Callable[[Rows], Rows]) -> TriSurface:
    centres = body.points[body.facets].mean(axis=1)
    return TriSurface(body.points, body.facets[~cut(centres)])


def require_capped(torn: TriSurface, edges: list[int]) -> TriSurface:
    done = repair_to_solid(torn)
    repaired = done.surface
    require_closed(repaired)
    assert len(all_crossings(repaired.points, repaired.facets)) == 0
    assert list(done.caps) == [f"cap {k}" for k in range(1, len(edges) + 1)]
    for rows, count in zip(done.caps.values(), edges, strict=True):
        uses: dict[tuple[int, int], int] = {}
        for f in repaired.facets[rows].tolist():
            for a, b in zip(f, f[1:] + f[:1], strict=True):
                uses[min(a, b), max(a, b)] = uses.get((min(a, b), max(a, b)), 0) + 1
        assert sum(n == 1 for n in uses.values()) == count
    # What was there is there still, facet by facet.
    rest = np.setdiff1d(np.arange(repaired.num_facets), np.concatenate(list(done.caps.values())))
    assert np.array_equal(repaired.points[repaired.facets[rest]], torn.points[torn.facets])
    return repaired


@pytest.mark.parametrize("edge", [11e-3, 7e-3, 4e-3])
def test_a_cut_vessel_has_a_flat_cap(edge: float) -> None:
    tube = shape_cylinder(0.02, 0.08, edge_length=edge)
    open_tube = without(tube, lambda x: (x[:, 2] > 0.08 - 1e-9) | (x[:, 2] < 1e-9))
    edges = len(np.flatnonzero(np.abs(tube.points[:, 2]) < 1e-9))
    rim = [v for v in np.unique(open_tube.facets) if abs(open_tube.points[v, 2]) < 1e-9]
    capped = require_capped(open_tube, [len(rim), len(rim)])
    assert edges > len(rim)
    assert capped.volume == pytest.approx(tube.volume, rel=1e-12)
    assert mesh_surface(capped).volume == pytest.approx(capped.volume, rel=1e-12)


def test_a_slanted_cut_of_an_organ() -> None:
    kidney = shape_kidney(edge_length=7e-3)
    torn = without(kidney, lambda x: x @ np.array([0.3, 0.5, 1.0]) > 0.03)
    (loop,) = find_hole_loops(torn.facets)
    mesh_surface(require_capped(torn, [len(loop)]))


def test_concave_and_annular_holes() -> None:
    ball = shape_sphere(1.0, edge_length=0.15)

    def crescent(x: Rows) -> Rows:
        angle = np.arctan2(x[:, 1], x[:, 0])
        return (x[:, 2] > 0.2) & (x[:, 2] < 0.6) & (np.abs(angle) < 2.0)

    def ring(x: Rows) -> Rows:
        far = np.linalg.norm(x - [0.0, 0.0, 1.0], axis=1)
        return (far > 0.25) & (far < 0.45)

    concave = repair_to_solid(without(ball, crescent))
    require_closed(concave.surface)
    assert concave.surface.volume == pytest.approx(ball.volume, rel=0.05)
    # The island stays where it is: one band joins it to the rest.
    annular = repair_to_solid(without(ball, ring))
    (shell,) = require_closed(annular.surface)
    assert shell.volume == pytest.approx(ball.volume, rel=0.01)
    assert list(annular.caps) == ["cap 1"]


@pytest.mark.parametrize(("half_gap", "num_shells"), [(0.1, 1), (0.7, 2)])
def test_facing_loops_are_joined_where_a_band_is_smaller_than_two_caps(
    half_gap: float, num_shells: int
) -> None:
    tube = shape_cylinder(0.5, 3.0, edge_length=0.15)
    done = repair_to_solid(without(tube, lambda x: np.abs(x[:, 2] - 1.5) < half_gap))
    assert len(require_closed(done.surface)) == num_shells
    assert len(done.caps) == num_shells


def test_the_largest_hole_that_is_closed_is_a_choice() -> None:
    ball = shape_sphere(1.0, edge_length=0.2)
    torn = without(ball, lambda x: x[:, 2] > 0.5)
    with pytest.raises(OpenSurfaceError, match="allow holes of") as caught:
        repair_to_solid(torn, RepairChoices(largest_hole=10))
    edges = len(caught.value.edges)
    assert f"holes of {edges} edges" in str(caught.value)
    repaired = repair_to_solid(torn, RepairChoices(largest_hole=edges))
    require_closed(repaired.surface)


def test_choices_out_of_range_are_refused() -> None:
    for bad in ({"distance": 0.0}, {"largest_hole": -1}, {"smallest_shell": float("nan")}):
        with pytest.raises(InputError):
            RepairChoices(**bad)  # type: ignore[arg-type]
