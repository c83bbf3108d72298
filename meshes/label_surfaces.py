"""Surfaces of labels with one shared wall between neighbours, by surface nets.

Gibson, S. F. F., *Constrained elastic surface nets*, MICCAI 1998; here `vtkSurfaceNets3D`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.label_images import LabelImage

_BLOCK = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
_ITERATIONS = 16
# Passes over blocks of voxels that touch at edges or corners alone; 1 to 6 are needed.
_MOST_PASSES = 60


@dataclass(frozen=True, eq=False)
class LabelSurfaces:
    """Walls around and between labels.

    Attributes:
        points: [mm], shape (num_points, 3).
        corners: Where they are without smoothing, on the voxels' corners [mm], same shape.
        facets: Shape (num_facets, 3); normals point out of the first label into the second.
        sides: The two labels of each facet, shape (num_facets, 2); 0 is outside.
    """

    points: Points
    corners: Points
    facets: Indices
    sides: NDArray[np.int32]

    def around(self, label: int) -> Indices:
        """Facets around one label, outward."""
        first, second = (self.facets[self.sides[:, k] == label] for k in (0, 1))
        return np.vstack([first, second[:, ::-1]])

    def volume(self, label: int, points: Points | None = None) -> float:
        """Volume within a label's facets [mm3]."""
        at = self.points if points is None else points
        a, b, c = (at[self.around(label)] - at[0]).transpose(1, 0, 2)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def separate_touching(labels: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    """Change voxels until no label touches itself at edges or corners alone; how many were.

    In each block of 2 x 2 x 2 voxels a label and what is not it must be connected over faces:
    the surface around it is then a manifold.

    Raises:
        InputError: Such places are left after many passes.
    """
    table = _bad_patterns()
    work = np.pad(labels, 2)
    before = work.copy()
    names = np.unique(work)
    for _ in range(_MOST_PASSES):
        found = _bad_blocks(work, names, table)
        if not len(found):
            changed = int((work != before).sum())
            return work[2:-2, 2:-2, 2:-2].copy(), changed
        for corner in found.tolist():
            _change_one(work, tuple(corner), table)
    raise InputError(
        f"{len(found)} blocks of voxels touch at edges or corners alone, after {_MOST_PASSES} "
        "passes: smooth the labels (a median filter) where they were made"
    )


def _bad_patterns() -> NDArray[np.bool_]:
    """Of each set of voxels in a block: whether it, or the rest, falls apart."""

    def parts(chosen: set[int]) -> int:
        count = 0
        while chosen:
            count += 1
            front = [chosen.pop()]
            while front:
                at = front.pop()
                near = {at ^ 1, at ^ 2, at ^ 4} & chosen
                chosen -= near
                front += near
        return count

    every = set(range(8))
    sets = [{k for k in every if pattern >> k & 1} for pattern in range(256)]
    return np.array([max(parts(set(s)), parts(every - s)) > 1 for s in sets])


def _bad_blocks(work: NDArray[np.int32], names: Indices, table: NDArray[np.bool_]) -> Indices:
    """First voxels of the blocks in which a label falls apart, shape (n, 3)."""
    shape = tuple(n - 1 for n in work.shape)
    bad = np.zeros(shape, dtype=bool)
    for name in names:
        mask = (work == name).view(np.uint8)
        code = np.zeros(shape, dtype=np.uint8)
        for bit, (a, b, c) in enumerate(_BLOCK):
            part = mask[a : a + shape[0], b : b + shape[1], c : c + shape[2]]
            code |= part << np.uint8(bit)
        bad |= table[code]
    found: Indices = np.argwhere(bad)
    return found


def _change_one(work: NDArray[np.int32], at: tuple[int, ...], table: NDArray[np.bool_]) -> None:
    """Give the voxel of a block another label of it so that the fewest bad blocks are left."""
    i, j, k = at
    window = work[max(i - 1, 0) : i + 3, max(j - 1, 0) : j + 3, max(k - 1, 0) : k + 3]
    names = np.unique(window)
    inside = np.unique(work[i : i + 2, j : j + 2, k : k + 2])
    own = _bad_blocks(work[i : i + 2, j : j + 2, k : k + 2], inside, table)
    if not len(own):  # a change beside it was enough
        return
    best: tuple[int, tuple[int, int, int], int] | None = None
    for a, b, c in _BLOCK:
        voxel = i + a, j + b, k + c
        if not all(2 <= v < n - 2 for v, n in zip(voxel, work.shape, strict=True)):
            continue
        was = int(work[voxel])
        for name in inside.tolist():
            if name == was:
                continue
            work[voxel] = name
            count = len(_bad_blocks(window, names, table))
            if best is None or count < best[0]:
                best = count, voxel, name
        work[voxel] = was
    if best is not None:
        work[best[1]] = best[2]


def make_surfaces(image: LabelImage, *, smoothing: float = 1.0) -> LabelSurfaces:
    """Walls of all labels but 0, smoothed with their volumes preserved.

    Args:
        image: Labels that touch themselves over faces alone; see `separate_touching`.
        smoothing: From 0, the voxels' faces, to 1; no point moves by more than that times half of
            the shortest edge of a voxel.

    Raises:
        InputError: vtk is not installed.
    """
    try:
        from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
        from vtkmodules.vtkCommonDataModel import vtkImageData
        from vtkmodules.vtkFiltersCore import vtkSurfaceNets3D
    except ImportError as error:
        raise InputError('label images need vtk: pip install "palpate[scans]"') from error
    padded = np.pad(image.labels, 1)
    grid = vtkImageData()
    grid.SetDimensions(*padded.shape)
    grid.SetSpacing(*image.spacing)
    grid.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(padded.ravel(order="F"))))
    nets = vtkSurfaceNets3D()
    nets.SetInputData(grid)
    present = [int(x) for x in np.unique(image.labels) if x]
    for k, label in enumerate(present):
        nets.SetValue(k, label)
    nets.SetBackgroundLabel(0)
    nets.SetOutputMeshTypeToTriangles()
    nets.AutomaticSmoothingConstraintsOff()
    nets.SetConstraintStrategyToConstraintDistance()
    nets.SetConstraintDistance(0.5 * float(image.spacing.min()))
    nets.SetNumberOfIterations(_ITERATIONS)
    nets.SmoothingOff()
    nets.Update()
    corners = vtk_to_numpy(nets.GetOutput().GetPoints().GetData()).astype(float)
    nets.SmoothingOn()
    nets.Update()
    output = nets.GetOutput()
    smooth = vtk_to_numpy(output.GetPoints().GetData()).astype(float)
    triangles = vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    sides = vtk_to_numpy(output.GetCellData().GetArray("BoundaryLabels")).astype(np.int32)
    points = corners + smoothing * (smooth - corners)
    found = LabelSurfaces(points, corners, triangles.astype(np.int32), sides)
    if found.volume(present[0], corners) < 0.0:
        found = LabelSurfaces(points, corners, found.facets[:, ::-1].copy(), sides)
    if smoothing > 0.0:
        points = _with_volumes(found, present, smoothing * 0.5 * float(image.spacing.min()))
    place = image.affine[:3, :3] / image.spacing
    origin = image.affine @ [-1.0, -1.0, -1.0, 1.0]
    facets = found.facets if np.linalg.det(place) > 0 else found.facets[:, ::-1].copy()
    moved, unmoved = (at @ place.T + origin[:3] for at in (points, corners))
    return LabelSurfaces(moved, unmoved, facets, sides)


def _with_volumes(found: LabelSurfaces, present: list[int], most: float) -> Points:
    """Points moved as little as restores labels' volumes, at most so far from the corners [mm]."""
    wanted = np.array([found.volume(label, found.corners) for label in present])
    points = found.points.copy()
    for _ in range(4):
        missing = wanted - [found.volume(label, points) for label in present]
        slopes = []
        for label in present:
            facets = found.around(label)
            a, b, c = points[facets].transpose(1, 0, 2)
            area = np.cross(b - a, c - a) / 6.0
            slope = np.zeros_like(points)
            for corner in facets.T:
                for axis in range(3):
                    slope[:, axis] += np.bincount(corner, area[:, axis], len(points))
            slopes.append(slope.ravel())
        matrix = np.array(slopes)
        points += (np.linalg.lstsq(matrix @ matrix.T, missing, rcond=None)[0] @ matrix).reshape(
            -1, 3
        )
        moved = points - found.corners
        lengths = np.linalg.norm(moved, axis=1, keepdims=True)
        points = found.corners + moved * np.minimum(1.0, most / np.maximum(lengths, most * 1e-9))
    return points
