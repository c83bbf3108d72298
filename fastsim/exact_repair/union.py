"""Bodies that run into each other become one: an exact union of their solids.

By manifold3d (Apache-2.0, the extra `union`), whose booleans always bound a solid. A union keeps
the points and facets that are outside bit for bit, cuts facets where bodies meet, and removes what
is inside: no other repair of bodies deep in each other leaves their outside where it was.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.exact_repair.patch_repairs import MOST_PAIRS, all_crossings, is_clean
from palpate.meshes.arrays import Integers
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import SurfaceError, TriSurface
from palpate.meshes.triangles import connected_parts, facet_parts

INSTALL = "pip install 'palpate[union]'"


@dataclass(frozen=True, eq=False)
class United:
    """A surface of united bodies.

    Attributes:
        surface: Closed; the bodies that meet no other come first.
        number: Facet before that each facet is, or is a piece of, shape (num_facets,).
        num_bodies: How many bodies ran into another.
    """

    surface: TriSurface
    number: Integers
    num_bodies: int

    def line(self) -> str:
        """Report in one line."""
        return f"{self.num_bodies} bodies that run into each other united, their outside as it was"


def is_available() -> bool:
    """Whether manifold3d is installed."""
    return importlib.util.find_spec("manifold3d") is not None


def bodies_that_meet(surface: TriSurface) -> Integers:
    """Set of each facet's body among those that run into each other, -1 of others.

    None are where a body is a cavity, or cuts itself: what is inside then is not known. Shape
    (num_facets,).
    """
    none = np.full(surface.num_facets, -1)
    pairs = all_crossings(surface.points, surface.facets)
    if not 0 < len(pairs) < MOST_PAIRS:
        return none
    body = facet_parts(surface.facets)
    ends = body[pairs]
    corners = surface.points[surface.facets] - surface.points.mean(axis=0)
    volumes = np.linalg.det(corners) / 6.0
    if np.any(ends[:, 0] == ends[:, 1]) or np.bincount(body, volumes).min() <= 0.0:
        return none
    found = connected_parts(int(body.max()) + 1, ends)[body]
    return np.where(np.isin(body, ends), found, -1)


def unite(surface: TriSurface) -> United | None:
    """Unite the bodies of a closed, outward surface that run into each other.

    None where no bodies do, where manifold3d is not installed, or where the union has facets that
    no mesher can use.
    """
    if not is_available():
        return None
    group = bodies_that_meet(surface)
    if np.all(group < 0):
        return None
    from manifold3d import Manifold, Mesh64, OpType

    body = facet_parts(surface.facets)
    points, facets = [surface.points], [surface.facets[group < 0]]
    number = [np.flatnonzero(group < 0)]
    start = len(surface.points)
    for some in np.unique(group[group >= 0]):
        solids = []
        for one in np.unique(body[group == some]):
            rows = np.flatnonzero(body == one)
            used, corners = np.unique(surface.facets[rows], return_inverse=True)
            # Pieces of facets bear the facet's number.
            solids.append(
                Manifold(
                    Mesh64(
                        np.ascontiguousarray(surface.points[used]),
                        corners.reshape(-1, 3).astype(np.uint64),
                        face_id=rows.astype(np.uint64),
                    )
                )
            )
        made = Manifold.batch_boolean(solids, OpType.Add).to_mesh64()
        if not len(made.tri_verts):
            return None
        points.append(np.asarray(made.vert_properties, dtype=np.float64)[:, :3])
        facets.append(np.asarray(made.tri_verts).astype(np.int32) + np.int32(start))
        number.append(np.asarray(made.face_id).astype(np.int64))
        start += len(points[-1])
    used, corners = np.unique(np.vstack(facets), return_inverse=True)
    whole = TriSurface(np.vstack(points)[used], corners.reshape(-1, 3).astype(np.int32))
    of = np.concatenate(number)
    try:
        require_closed(whole)
    except SurfaceError:
        return None
    if not is_clean(whole.points, whole.facets, group[of] >= 0):
        return None
    return United(whole, of, len(np.unique(body[group >= 0])))
