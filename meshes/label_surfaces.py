"""Surfaces of labels with one shared wall between neighbours, by surface nets.

Gibson, S. F. F., *Constrained elastic surface nets*, MICCAI 1998; here `vtkSurfaceNets3D`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.label_images import LabelImage
from palpate.meshes.shapes import flip_to_delaunay

_BLOCK = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
_ITERATIONS = 16
# Rounds of steps towards the walls of a finer image, and steps between flips of edges.
_ROUNDS = 3
_STEPS = 4
# Passes over blocks of voxels that touch at edges or corners alone; 1 to 6 are needed.
_MOST_PASSES = 60


@dataclass(frozen=True, eq=False)
class LabelSurfaces:
    """Walls around and between labels.

    Attributes:
        corners: Points on the voxels' corners [mm], shape (num_points, 3).
        smooth: Where smoothing moves them [mm], same shape.
        facets: Shape (num_facets, 3); normals point out of the first label into the second.
        sides: The two labels of each facet, shape (num_facets, 2); 0 is outside.
        volumes: Of the labels, by label [mm3].
        most: Largest distance of a point from its corner [mm].
    """

    corners: Points
    smooth: Points
    facets: Indices
    sides: NDArray[np.int32]
    volumes: Mapping[int, float]
    most: float

    def around(self, label: int) -> Indices:
        """Facets around one label, outward."""
        first, second = (self.facets[self.sides[:, k] == label] for k in (0, 1))
        return np.vstack([first, second[:, ::-1]])

    def volume(self, label: int, points: Points) -> float:
        """Volume within a label's facets [mm3], with these points."""
        a, b, c = (points[self.around(label)] - points[0]).transpose(1, 0, 2)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def smoothed(self, part: NDArray[np.float64]) -> Points:
        """Points with a part of the smoothing, and their labels' volumes restored.

        Args:
            part: Of each point from 0, its corner, to 1, shape (num_points,); no point moves
                farther from its corner than its part of `most`.

        Returns:
            Moved as little as gives labels their volumes, shape (num_points, 3) [mm].
        """
        labels, most = list(self.volumes), self.most * part[:, None]
        points = self.corners + part[:, None] * (self.smooth - self.corners)
        for _ in range(4):
            missing = [self.volumes[label] - self.volume(label, points) for label in labels]
            slopes = []
            for label in labels:
                facets = self.around(label)
                a, b, c = points[facets].transpose(1, 0, 2)
                area = np.cross(b - a, c - a) / 6.0
                slope = np.zeros_like(points)
                for corner in facets.T:
                    for axis in range(3):
                        slope[:, axis] += np.bincount(corner, area[:, axis], len(points))
                slopes.append((slope * part[:, None]).ravel())
            matrix = np.array(slopes)
            steps = np.linalg.lstsq(matrix @ matrix.T, missing, rcond=None)[0] @ matrix
            moved = points + steps.reshape(-1, 3) - self.corners
            lengths = np.linalg.norm(moved, axis=1, keepdims=True)
            points = self.corners + moved * np.minimum(1.0, most / np.maximum(lengths, 1e-300))
        return points


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


def make_surfaces(
    image: LabelImage,
    fine: LabelImage | None = None,
    *,
    volumes: Mapping[int, float] | None = None,
) -> LabelSurfaces:
    """Walls of all labels but 0.

    Args:
        image: Labels that touch themselves over faces alone; see `separate_touching`.
        fine: The image with finer voxels that this one was made of. Points then go to its walls,
            by at most the shortest edge of a coarse voxel, and facets are those of good angles
            there, which may cut each other with less smoothing. Otherwise points move by at most
            half of the shortest edge.
        volumes: Of the labels [mm3]; those of the voxels of `image` where not given.

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
    axes = image.affine[:3, :3] / image.spacing
    origin = (image.affine @ [-1.0, -1.0, -1.0, 1.0])[:3]
    corners, smooth = (at @ axes.T + origin for at in (corners, smooth))
    most = 0.5 * float(image.spacing.min())
    found = LabelSurfaces(corners, smooth, triangles.astype(np.int32), sides, {}, most)
    if found.volume(present[0], corners) < 0.0:
        found = replace(found, facets=found.facets[:, ::-1].copy())
    inside = {label: found.volume(label, corners) for label in present}
    found = replace(found, volumes=inside if volumes is None else volumes)
    if fine is None:
        return found
    smooth, facets = _onto_walls(found, fine, most)
    return replace(found, smooth=smooth, facets=facets, most=2.0 * most)


def _onto_walls(found: LabelSurfaces, fine: LabelImage, width: float) -> tuple[Points, Indices]:
    """Points on the walls of a finer image, evenly spread along them, and Delaunay facets.

    A wall is where the signed distances from its labels, smoothed by a Gaussian against the
    voxels' steps, are equal; where three labels meet, three are. Newton's steps of least length
    lead there, and steps towards the neighbours' middle along the wall go between them.

    Args:
        found: Walls of the coarser voxels.
        fine: The finer image.
        width: Longest step, and twice the Gaussian's standard deviation [mm].
    """
    from scipy import ndimage

    reach = int(np.ceil(4.0 * width / fine.spacing.min()))
    names = np.unique(found.sides)
    labels = np.pad(fine.labels, reach)
    points, facets = found.smooth.copy(), found.facets
    touches = np.zeros((len(points), len(names)), dtype=bool)
    for column in np.searchsorted(names, found.sides).T:
        touches[facets, column[:, None]] = True
    patches = np.unique(found.sides, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)
    deviation = max(0.5 * width, 0.8 * float(fine.spacing.max())) / fine.spacing
    fields = [
        ndimage.gaussian_filter(_signed_distance(labels == name, fine.spacing), deviation)
        for name in names
    ]
    for _ in range(_ROUNDS):
        middle = _middles(facets, touches.sum(axis=1))
        for _ in range(_STEPS):
            step, across = _to_walls(points, fields, touches, fine, reach, width)
            towards = middle @ points - points
            points += step + 0.5 * (towards - np.einsum("nij,nj->ni", across, towards))
        facets = flip_to_delaunay(points, facets, patches=patches)
    for _ in range(_STEPS):
        points += _to_walls(points, fields, touches, fine, reach, width)[0]
    return points, facets


def _signed_distance(mask: NDArray[np.bool_], spacing: NDArray[np.float64]) -> NDArray[np.float32]:
    """Distance to the mask's boundary [mm], above 0 within it, from voxels' middles."""
    from scipy import ndimage

    within, beyond = (
        ndimage.distance_transform_edt(side, sampling=spacing) for side in (mask, ~mask)
    )
    signed: NDArray[np.float32] = (within - beyond).astype(np.float32)
    return signed


def _middles(facets: Indices, count: Indices) -> Any:
    """Sparse matrix that gives the mean of the neighbours of each point, shape (n, n).

    Along a line where three labels meet, the neighbours are those on the line.
    """
    from scipy import sparse

    number = len(count)
    rows, cols = facets.ravel(), facets[:, [1, 2, 0]].ravel()
    rows, cols = np.concatenate([rows, cols]), np.concatenate([cols, rows])
    used = count[cols] >= count[rows]
    matrix = sparse.csr_matrix((np.ones(used.sum()), (rows[used], cols[used])), (number, number))
    matrix.data[:] = 1.0
    degree = np.asarray(matrix.sum(axis=1)).ravel()
    alone = sparse.diags((degree == 0.0).astype(float))
    return sparse.diags(1.0 / np.maximum(degree, 1.0)) @ matrix + alone


def _to_walls(
    points: Points,
    fields: list[NDArray[np.float32]],
    touches: NDArray[np.bool_],
    fine: LabelImage,
    padding: int,
    longest: float,
) -> tuple[Points, NDArray[np.float64]]:
    """Newton's steps to where the fields of the labels that meet at each point are equal.

    Args:
        points: Shape (n, 3) [mm].
        fields: Signed distances of the labels, by voxel.
        touches: Labels that meet at each point, shape (n, num_labels).
        fine: Where voxels are.
        padding: Voxels before the first of the image.
        longest: Longest step [mm].

    Returns:
        The steps, shape (n, 3), and the projection onto the directions across the walls, (n, 3, 3).
    """
    from scipy import ndimage

    to_voxels = np.linalg.inv(fine.affine)
    at = (points @ to_voxels[:3, :3].T + to_voxels[:3, 3] + padding).T
    values = np.array([ndimage.map_coordinates(field, at, order=1) for field in fields])
    slopes = np.empty((len(fields), len(points), 3))
    for axis in range(3):
        half = np.zeros((3, 1))
        half[axis] = 0.5
        for k, field in enumerate(fields):
            high, low = (
                ndimage.map_coordinates(field, at + s * half, order=1) for s in (1.0, -1.0)
            )
            slopes[k, :, axis] = high - low
    slopes = slopes @ to_voxels[:3, :3]
    # Each label against the mean of those that meet at a point.
    share = touches / touches.sum(axis=1, keepdims=True)
    weights = touches.T.astype(float)
    residual = weights * (values - np.einsum("kn,nk->n", values, share))
    rise = weights[:, :, None] * (slopes - np.einsum("kni,nk->ni", slopes, share))
    jacobian = rise.transpose(1, 0, 2)
    inverse = np.linalg.pinv(jacobian, rcond=0.1)
    step = -np.einsum("nik,kn->ni", inverse, residual)
    lengths = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, longest / np.maximum(lengths, 1e-9 * longest))
    return step, inverse @ jacobian
