"""The rigid-body motions that the supports leave free, and the connected parts of a mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Integers
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.triangles import connected_parts


class UnsupportedBodyError(InputError):
    """A body that can move as a whole: `.num_free_modes` of 6 are free in the part `.part`."""

    def __init__(self, num_free_modes: int, part: int, num_parts: int, num_supports: int) -> None:
        self.num_free_modes = num_free_modes
        self.part = part
        where = f"part {part} of {num_parts}" if num_parts > 1 else "the body"
        support_words = "has no support" if num_supports == 0 else "is not held enough"
        super().__init__(
            f"{where} {support_words}: {num_free_modes} of 6 rigid motions are free, so it floats; "
            "add a [[support]] that holds at least three points not on a line"
        )


def parts_of_mesh(mesh: TetMesh) -> Integers:
    """Number of the connected part of each point, shape (num_points,), from 0."""
    pairs = mesh.cells[:, [0, 1, 1, 2, 2, 3]].reshape(-1, 2).astype(np.int64)
    return connected_parts(mesh.num_points, pairs)


def free_rigid_modes(mesh: TetMesh, supports: Sequence[Support]) -> list[int]:
    """Count the rigid motions (of 6) that the supports leave free, for each connected part.

    Found from the rank of the fixed components of the six rigid modes, with lengths scaled by the
    part's size; singular values below 1e-8 of the largest count as zero.
    """
    labels = parts_of_mesh(mesh)
    free = []
    for part in range(int(labels.max()) + 1):
        inside = labels == part
        points = mesh.points[inside]
        centre = points.mean(axis=0)
        size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
        rows = []
        for support in supports:
            fixed = support.points[inside[support.points]]
            x, y, z = ((mesh.points[fixed] - centre) / size).T
            one, zero = np.ones_like(x), np.zeros_like(x)
            modes = np.array(
                [
                    [one, zero, zero, zero, z, -y],
                    [zero, one, zero, -z, zero, x],
                    [zero, zero, one, y, -x, zero],
                ]
            )
            rows += [np.tensordot(d, modes, axes=1).T for d in support.directions]
        held_modes = np.vstack(rows) if rows else np.zeros((0, 6))
        if len(held_modes) == 0:
            free.append(6)
            continue
        singular = np.linalg.svd(held_modes, compute_uv=False)
        free.append(6 - int(np.sum(singular > 1e-8 * singular[0])))
    return free


def require_supported(problem: Problem) -> None:
    """Refuse a static problem in which a part of the body can move as a whole.

    Raises:
        UnsupportedBodyError: With the part and the number of its free rigid motions.
    """
    free = free_rigid_modes(problem.mesh, problem.supports)
    for part, count in enumerate(free):
        if count:
            raise UnsupportedBodyError(count, part, len(free), len(problem.supports))
