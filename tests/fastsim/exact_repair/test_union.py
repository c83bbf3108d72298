"""Bodies that run into each other: refused, or united by choice, their outside bit for bit."""

from __future__ import annotations

import re

import numpy as np
import pytest

from palpate.fastsim.exact_repair import solid_repair, union
from palpate.fastsim.exact_repair.patch_repairs import all_crossings
from palpate.fastsim.exact_repair.solid_repair import repair_to_solid
from palpate.fastsim.exact_repair.union import bodies_that_meet, unite
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_box, shape_hollow_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import SurfaceError, TriSurface
from palpate.meshes.triangles import facet_normals

pytest.importorskip("manifold3d")

BOX = shape_box(edge_length=0.2)
SHIFT = np.array([0.5, 0.3, 0.2])
FAR = np.array([5.0, 0.0, 0.0])


def joined(*parts: TriSurface) -> TriSurface:
    starts = np.cumsum([0, *(len(one.points) for one in parts)])
    return TriSurface(
        np.vstack([one.points for one in parts]),
        np.vstack([one.facets + start for one, start in zip(parts, starts[:-1], strict=True)]),
    )


def moved(body: TriSurface, shift: np.ndarray) -> TriSurface:  # type: ignore[type-arg]
    return TriSurface(body.points + shift, body.facets)


TWO = joined(BOX, moved(BOX, SHIFT))


def corners_of(surface: TriSurface, rows: np.ndarray) -> set[bytes]:  # type: ignore[type-arg]
    return {np.sort(surface.points[f], axis=0).tobytes() for f in surface.facets[rows]}


def test_two_boxes_have_the_volume_of_their_union_and_all_of_their_outside() -> None:
    given = joined(TWO, moved(BOX, FAR))
    made = unite(given)
    assert made is not None
    require_closed(made.surface)
    assert not len(all_crossings(made.surface.points, made.surface.facets))
    # They have 0.5 x 0.7 x 0.8 in common; the third box stands alone.
    assert made.surface.volume == pytest.approx(3.0 - 0.28, rel=1e-12)
    assert made.num_bodies == 2
    # A facet that no corner of the other box, and no part of it, comes near is there as it was.
    low, high = (f(given.points[given.facets], axis=1) for f in (np.min, np.max))
    is_first = np.arange(given.num_facets) < BOX.num_facets
    outside = (high < SHIFT).any(axis=1) & is_first | (low > 1.0).any(axis=1) & ~is_first
    everything = np.arange(made.surface.num_facets)
    assert corners_of(given, outside) <= corners_of(made.surface, everything)
    # A facet, or a piece of one: of the same plane, facing alike.
    old = facet_normals(given.points[given.facets])[made.number]
    new = facet_normals(made.surface.points[made.surface.facets])
    cosine = np.einsum("ij,ij->i", old, new) / (
        np.linalg.norm(old, axis=1) * np.linalg.norm(new, axis=1)
    )
    assert cosine.min() > 1.0 - 1e-9


def test_fused_by_choice_alone_and_what_is_suggested_does() -> None:
    with pytest.raises(SurfaceError, match="unites bodies that run into") as caught:
        repair_to_solid(TWO)
    said = re.search(
        r"limit of 100 % and a repair distance of ([\d.e-]+) m unites", str(caught.value)
    )
    assert said is not None
    done = repair_to_solid(TWO, RepairChoices(limit=100.0, distance=float(said[1])))
    assert done.lines == ["2 bodies that run into each other united, their outside as it was"]
    (change,) = done.changes
    assert change.is_fused
    assert change.volume_change == pytest.approx(14.0, rel=1e-9)  # 0.28 of 2
    assert mesh_surface(done.surface).volume == pytest.approx(1.72, rel=1e-12)
    # Less of either is refused.
    for less in (
        RepairChoices(limit=99.0, distance=float(said[1])),
        RepairChoices(limit=100.0, distance=0.98 * float(said[1])),
    ):
        with pytest.raises(SurfaceError):
            repair_to_solid(TWO, less)


def test_nothing_is_united_where_it_is_not_known_what_is_inside() -> None:
    hollow = shape_hollow_sphere(1.0, 0.5, edge_length=0.3)
    assert np.all(bodies_that_meet(joined(hollow, moved(hollow, SHIFT))) < 0)
    points = TWO.points.copy()
    points[0] += 3.0
    assert np.all(bodies_that_meet(TriSurface(points, TWO.facets)) < 0)
    assert np.all(bodies_that_meet(joined(BOX, moved(BOX, FAR))) < 0)
    assert unite(joined(BOX, moved(BOX, FAR))) is None


def test_without_manifold3d_the_refusal_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in (union, solid_repair):
        monkeypatch.setattr(module, "is_available", lambda: False)
    with pytest.raises(SurfaceError, match=r"pip install 'palpate\[union\]', then a repair limit"):
        repair_to_solid(TWO)
