"""From a label image to one mesh with walls between labels, and a group of cells for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.critical_cells import facet_altitudes
from palpate.fastsim.mesher import (
    BoundaryRecoveryError,
    FlatCellError,
    Interior,
    MeshingReport,
    mesh_surface,
)
from palpate.fastsim.nested_bodies import mesh_regions
from palpate.fastsim.surface_remesher import require_no_self_intersection
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.label_images import LabelImage, choose_labels, coarsen
from palpate.meshes.label_surfaces import LabelSurfaces, make_surfaces, separate_touching
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import SelfIntersectionError, TriSurface
from palpate.meshes.triangles import side_lengths

# Largest change of a label's volume, asked for by those who measure organs.
MOST_CHANGE = 0.01
# With ever less smoothing where walls would cut each other.
_ATTEMPTS = 5
# Facets with a smaller altitude, of the mean edge, are points that have slid onto each other where
# labels meet: they would decide the time step of the whole mesh.
_THIN = 0.04
_METRES = 1e-3


class LabelVolumeError(InputError):
    """A label whose volume would change by more than a limit; `.name`, `.change` [-]."""

    def __init__(self, name: str, change: float) -> None:
        self.name, self.change = name, change
        super().__init__(
            f"label {name}: its volume would change by {100 * change:.2g} %, more than "
            f"{100 * MOST_CHANGE:g} %: it is too small or too thin for its voxels; use finer ones "
            "(a smaller --voxel-edge, or resample the image by nearest neighbour)"
        )


def mesh_labels(
    image: LabelImage,
    names: Mapping[int, str],
    *,
    walls: Mapping[int, str] = MappingProxyType({}),
    smallest_island: int = 27,
    voxel_edge: float | None = None,
    uniform: bool = False,
    time_left: Callable[[], float | None] = lambda: None,
    progress: Callable[[str], None],
) -> TetMesh:
    """Mesh the named labels of an image.

    Args:
        image: The image [mm].
        names: Of labels that are meshed, by number; each is a group of cells.
        walls: Of labels that are not meshed, by number: facets that touch one are a group.
        smallest_island: Loose parts of a label with fewer voxels are said.
        voxel_edge: Edge of the voxels that walls are made of [mm], for coarser meshes; the image's
            where not given. Volumes stay those of the image.
        uniform: Cells as fine inside as the walls; otherwise they grow inwards.
        time_left: Seconds that are left, or None.
        progress: Called with what is done, and what is to be known of the labels.

    Returns:
        The mesh [m].

    Raises:
        LabelVolumeError: A label that would change its volume by more than 1 %.
        InputError: A label that is not there, or no mesh.
    """
    chosen = choose_labels(image, {**names, **walls})
    for label, name in names.items():
        for line in _remarks(chosen, label, smallest_island):
            progress(f"label {name}: {line}")
    low, high = _box(chosen.labels)
    cropped = chosen.labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    affine = chosen.affine.copy()
    affine[:3, 3] += affine[:3, :3] @ low
    voxel = float(np.prod(chosen.spacing))
    volumes = {label: float((cropped == label).sum()) * voxel for label in names}
    given = LabelImage(cropped, affine, image.path)
    fine = None
    coarse = given if voxel_edge is None else coarsen(given, voxel_edge)
    if coarse is not given:
        fine, given = given, coarse
        size = " x ".join(f"{x:.3g}" for x in given.spacing)
        progress(f"walls of voxels of {size} mm, each of the label that fills most of it")
    labels, changed = separate_touching(given.labels)
    if changed:
        progress(f"{changed} voxel(s) changed where a label touched itself at edges or corners")
    clean = LabelImage(labels, given.affine, image.path)

    def make(region: TriSurface, report: Callable[[MeshingReport], None]) -> TetMesh:
        return mesh_surface(
            region,
            interior=Interior.UNIFORM if uniform else Interior.GRADED,
            time_limit=time_left(),
            progress=progress,
            report=report,
        )

    def fill(surfaces: LabelSurfaces, points: Points) -> TetMesh:
        """Mesh of the named labels, with a group of facets for each wall."""
        sides = surfaces.sides
        is_meshed = np.isin(sides, list(names))
        row = np.full(len(points), -1, dtype=np.int32)
        used = np.unique(surfaces.facets[is_meshed.any(axis=1)])
        row[used] = np.arange(len(used))
        regions = {name: row[surfaces.around(label)] for label, name in names.items()}
        mesh = mesh_regions(points[used], regions, make=make)
        groups = {
            name: row[surfaces.facets[((sides == label) & is_meshed[:, ::-1]).any(axis=1)]]
            for label, name in walls.items()
        }
        for name, facets in groups.items():
            if not len(facets):
                raise InputError(f"wall {name}: touches none of the labels that are meshed")
        return TetMesh(mesh.points, mesh.cells, groups, cell_groups=mesh.cell_groups)

    def attempt(
        surfaces: LabelSurfaces, part: NDArray[np.float64], thinnest: float = 0.0
    ) -> TetMesh | None:
        """Mesh with a part of the smoothing; None where there is none, and the part is less."""
        placed = surfaces.smoothed(part)
        points = np.ascontiguousarray(placed * _METRES)
        try:
            require_no_self_intersection(points, np.ascontiguousarray(surfaces.facets), most=1000)
        except SelfIntersectionError as error:
            where = np.unique(surfaces.facets[np.unique(error.pairs)])
            progress(f"less smoothing of {len(where)} point(s), where walls would cut each other")
            part[where] *= 0.5
            return None
        corners = placed[surfaces.facets]
        thin = facet_altitudes(corners) < thinnest * side_lengths(corners).mean()
        if thin.any():
            where = np.unique(surfaces.facets[thin])
            progress(f"less smoothing of {len(where)} point(s), where facets would be too thin")
            part[where] *= 0.5
            return None
        for label, name in names.items():
            _refuse_change(name, surfaces.volume(label, placed), volumes[label])
        farthest = float(np.linalg.norm(placed - surfaces.corners, axis=1).max())
        progress(f"{len(surfaces.facets)} facets, at most {farthest:.3g} mm from the voxels' faces")
        try:
            return fill(surfaces, points)
        except (BoundaryRecoveryError, FlatCellError) as error:
            progress(f"less smoothing: {error}")
            part *= 0.5
            return None

    for of in (None,) if fine is None else (fine, None):
        surfaces = make_surfaces(clean, of, volumes=None if fine is None else volumes)
        part = np.ones(len(surfaces.corners))
        for left in reversed(range(_ATTEMPTS)):
            # Coarser walls are better than thin facets, and these better than no smoothing.
            mesh = attempt(surfaces, part, _THIN if left or of is not None else 0.0)
            if mesh is not None:
                return mesh
    mesh = attempt(surfaces, 0.0 * part)  # the voxels' faces, which never cut each other
    if mesh is not None:
        return mesh
    raise InputError(
        f"{image.path}: no mesh, with or without smoothing; resample it to finer voxels"
    )


def _box(labels: NDArray[np.int32]) -> tuple[list[int], list[int]]:
    used = [np.flatnonzero(labels.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    return [int(u[0]) for u in used], [int(u[-1]) + 1 for u in used]


def _remarks(image: LabelImage, label: int, smallest_island: int) -> Iterator[str]:
    """Small islands, and what is thinner than two voxels."""
    from scipy import ndimage

    low, high = _box(np.where(image.labels == label, 1, 0).astype(np.int32))
    mask = image.labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] == label
    parts, count = ndimage.label(mask)
    sizes = np.bincount(parts.ravel())[1:]
    small = np.flatnonzero(sizes < smallest_island)
    yield f"{mask.sum()} voxels in {count} part(s)"
    if len(small):
        boxes = ndimage.find_objects(parts)
        places = [
            "({:.4g}, {:.4g}, {:.4g})".format(
                *(image.affine @ [*(s.start + a for s, a in zip(boxes[k], low, strict=True)), 1])[
                    :3
                ]
            )
            for k in small[:5]
        ]
        yield (
            f"{len(small)} island(s) of fewer than {smallest_island} voxels, at "
            f"{', '.join(places)} mm{' and more' if len(small) > 5 else ''}; they are meshed as "
            "well: remove them where the labels were made if they are noise"
        )
    thin = int((mask & ~ndimage.binary_opening(mask, np.ones((2, 2, 2)))).sum())
    if thin:
        yield f"{thin} voxel(s) in walls thinner than two voxels, which one layer of cells fills"


def _refuse_change(name: str, volume: float, wanted: float) -> None:
    change = abs(volume - wanted) / wanted
    if change > MOST_CHANGE:
        raise LabelVolumeError(name, change)
