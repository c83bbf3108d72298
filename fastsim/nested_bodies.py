"""Bodies in each other, or side by side, as one mesh: organ, vessel, tumour.

Each region, what a surface encloses less what lies in it, is meshed by itself and preserves all
facets; so regions share points and facets, and the whole is conforming. Where two surfaces have a
facet in common neither region there needs it: it cancels.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.mesher import MeshingError, MeshingReport, mesh_surface
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.shells import winding_numbers
from palpate.meshes.surface_checks import merge_equal_points, require_closed
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import NonManifoldError, SurfaceError, TriSurface

# Largest number of pairs of crossing facets to find.
_MOST_PAIRS = 1000


class CrossingBodiesError(SurfaceError):
    """Two surfaces that cut or touch each other; `.names`, `.pairs` and `.why` state which and how.

    Pairs are numbers of facets in the two surfaces; `.places` are centres of the first ones [m].
    """

    def __init__(
        self, names: tuple[str, str], pairs: Sequence[tuple[int, int]], positions: Points, why: str
    ) -> None:
        self.names, self.why = names, why
        self.pairs = [(int(a), int(b)) for a, b in pairs]
        self.positions = positions
        some = [
            f"facet {a} and facet {b} at ({', '.join(f'{x + 0.0:.6g}' for x in position)}) m"
            for (a, b), position in zip(self.pairs[:3], positions, strict=False)
        ]
        super().__init__(
            f"{names[0]} and {names[1]} {why}: {len(pairs)} pair(s) of facets, counted from 0: "
            f"{'; '.join(some)}; keep them apart, or give them these facets in common"
        )


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Named surfaces on common points [m], each with the innermost surface around it, or -1."""

    names: list[str]
    points: Points
    facets: list[Indices]
    parent: list[int]


def mesh_bodies(
    surfaces: Mapping[str, TriSurface],
    *,
    make: Callable[[TriSurface, Callable[[MeshingReport], None]], TetMesh] | None = None,
) -> TetMesh:
    """Fill closed surfaces, which may lie in each other or share facets, with one mesh.

    Args:
        surfaces: By name [m]; each bounds a solid. Points with equal coordinates are one point.
        make: Fills one region and reports; `mesh_surface` where None.

    Returns:
        A mesh whose cell groups, by name, are what lies in each surface but in none within it.
        Facets of all surfaces are facets of it.

    Raises:
        CrossingBodiesError: Surfaces that cut each other, or touch at points or edges alone.
        SurfaceError: One that bounds no solid.
        InputError: Two that are the same, or one that is apart from all others.
        MeshingError: A region that cannot be meshed without another point on a facet.
    """
    bodies = _common(surfaces)
    regions = {name: _region(bodies, number) for number, name in enumerate(bodies.names)}
    try:
        return mesh_regions(bodies.points, regions, make=make)
    except _OpenRegionError as error:
        raise _touching(bodies, bodies.names.index(error.name), error.error) from error


class _OpenRegionError(SurfaceError):
    """A region whose facets bound no solid; `.name` and `.error` say which, and why."""

    def __init__(self, name: str, error: NonManifoldError) -> None:
        self.name, self.error = name, error
        super().__init__(f"{name}: {error}")


def mesh_regions(
    points: Points,
    regions: Mapping[str, Indices],
    *,
    make: Callable[[TriSurface, Callable[[MeshingReport], None]], TetMesh] | None = None,
) -> TetMesh:
    """Fill regions that may have facets in common, as walls between them, with one mesh.

    Args:
        points: Of all of them [m], shape (num_points, 3).
        regions: Facets around each, outward, by name; one without facets is left out. Any number
            of regions may meet along an edge.
        make: Fills one region and reports; `mesh_surface` where None.

    Returns:
        A mesh with a group of cells for each region, and all facets of all.

    Raises:
        SurfaceError: Facets that bound no solid.
        MeshingError: A region that cannot be meshed without another point on a facet.
    """
    fill = make or (lambda surface, report: mesh_surface(surface, report=report))
    parts, cells, groups = [points], [], {}
    count = 0
    for name, facets in regions.items():
        if not len(facets):
            continue
        region = TriSurface(points, facets)
        try:
            require_closed(region)
        except NonManifoldError as error:
            raise _OpenRegionError(name, error) from error
        done: list[MeshingReport] = []
        mesh = fill(region, done.append)
        if done and done[0].boundary_steiner_points:
            raise MeshingError(
                f"{name}: {done[0].boundary_steiner_points} point(s) would be needed on facets, "
                "and its neighbours would not have them; use rounder facets there"
            )
        used = np.unique(facets)
        start = sum(map(len, parts)) - len(used)
        own = np.arange(mesh.num_points) + start
        own[: len(used)] = used
        parts.append(mesh.points[len(used) :])
        cells.append(own[mesh.cells])
        groups[name] = np.arange(count, count + mesh.num_cells)
        count += mesh.num_cells
    return TetMesh(np.vstack(parts), np.vstack(cells), cell_groups=groups)


def _common(surfaces: Mapping[str, TriSurface]) -> _Bodies:
    """All surfaces on common points, without crossings, each with the one around it."""
    names = list(surfaces)
    parts = list(surfaces.values())
    starts = np.cumsum([0, *(len(p.points) for p in parts)])
    facets = np.vstack([p.facets + s for p, s in zip(parts, starts[:-1], strict=True)])
    merged = merge_equal_points(TriSurface(np.vstack([p.points for p in parts]), facets))
    ends = np.cumsum([0, *(p.num_facets for p in parts)])
    own = [merged.facets[a:b] for a, b in itertools.pairwise(ends.tolist())]
    _refuse_crossings(names, merged, ends)
    return _Bodies(names, merged.points, own, _parents(names, merged.points, own))


def _refuse_crossings(names: list[str], union: TriSurface, ends: NDArray[np.int64]) -> None:
    """Refuse surfaces that cross; coincident facets of two surfaces are no crossing."""
    _, first = np.unique(np.sort(union.facets, axis=1), axis=0, return_index=True)
    first = np.sort(first)
    pairs = first[
        _core.find_self_intersections(
            np.ascontiguousarray(union.points),
            np.ascontiguousarray(union.facets[first]),
            _MOST_PAIRS,
        )
    ].reshape(-1, 2)
    if not len(pairs):
        return
    pairs = np.sort(pairs, axis=1)
    owner = np.searchsorted(ends, pairs, side="right") - 1
    chosen = (owner == owner[0]).all(axis=1)
    one, other = owner[0].tolist()
    why = "cut each other" if one != other else "is one surface that cuts itself"
    positions = union.points[union.facets[pairs[chosen, 0]]].mean(axis=1)
    rows = (pairs[chosen] - ends[owner[0]]).tolist()
    raise CrossingBodiesError((names[one], names[other]), [(a, b) for a, b in rows], positions, why)


def _keys(facets: Indices) -> set[tuple[int, ...]]:
    return {tuple(row) for row in np.sort(facets, axis=1).tolist()}


def _parents(names: list[str], points: Points, facets: list[Indices]) -> list[int]:
    keys = [_keys(rows) for rows in facets]
    within: list[set[int]] = []
    for one, rows in enumerate(facets):
        around = set()
        meets = False
        for other, wall in enumerate(facets):
            if other == one:
                continue
            apart = [k for k, row in enumerate(np.sort(rows, axis=1).tolist())
                     if tuple(row) not in keys[other]]  # fmt: skip
            meets = meets or len(apart) < len(rows)
            if not apart:
                if len(rows) == len(wall):
                    raise InputError(f"{names[one]} and {names[other]} are the same surface")
                continue
            probe = points[rows[apart[0]]].mean(axis=0)[None]
            if abs(float(winding_numbers(TriSurface(points, wall), probe)[0])) > 0.5:
                around.add(other)
        if not around and not meets and one > 0:
            raise InputError(
                f"{names[one]} lies outside of {names[0]} and shares no facet with another body; "
                "is it in the same unit and frame?"
            )
        within.append(around)
    # The innermost of those around is the one with most around itself.
    return [max(a, key=lambda k: len(within[k])) if a else -1 for a in within]


def _region(bodies: _Bodies, number: int) -> Indices:
    """Facets around what lies in a surface and in none within it; common ones cancel."""
    rows = [bodies.facets[number]]
    rows += [
        bodies.facets[k][:, ::-1] for k, parent in enumerate(bodies.parent) if parent == number
    ]
    facets = np.vstack(rows)
    key = np.sort(facets, axis=1)
    _, same, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    kept: Indices = facets[counts[same.reshape(-1)] == 1]
    return kept


def _touching(bodies: _Bodies, number: int, error: NonManifoldError) -> CrossingBodiesError:
    """The error that names two surfaces which touch where a region is not manifold."""
    touched = set(error.vertices) | {v for edge in error.edges for v in edge}
    at = np.isin(np.arange(len(bodies.points)), list(touched))
    one = number
    rows = np.flatnonzero(at[bodies.facets[one]].any(axis=1))
    others = [k for k, parent in enumerate(bodies.parent) if parent == number]
    for other in others:
        theirs = np.flatnonzero(at[bodies.facets[other]].any(axis=1))
        if not len(theirs):
            continue
        if not len(rows):
            one, rows = other, theirs
            continue
        count = min(len(rows), len(theirs))
        pairs = list(zip(rows[:count].tolist(), theirs[:count].tolist(), strict=True))
        positions = bodies.points[bodies.facets[one][rows[:count]]].mean(axis=1)
        names = bodies.names[one], bodies.names[other]
        return CrossingBodiesError(names, pairs, positions, "touch at points or edges alone")
    name = bodies.names[number]
    return CrossingBodiesError((name, name), [], np.zeros((0, 3)), "touches itself")
