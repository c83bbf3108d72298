# Annotations of kernels are Warp's own, not types.
# mypy: disable-error-code="untyped-decorator, no-untyped-def, valid-type"
"""Vertices in cells by Warp's tree of boxes, refitted in every step."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_WARNING
DEVICE = "cpu"


@wp.kernel
def _fit_boxes(
    points: wp.array(dtype=wp.vec3),
    cells: wp.array(dtype=wp.vec4i),
    low: wp.array(dtype=wp.vec3),
    high: wp.array(dtype=wp.vec3),
):
    c = wp.tid()
    cell = cells[c]
    p, q, r, s = points[cell[0]], points[cell[1]], points[cell[2]], points[cell[3]]
    low[c] = wp.min(wp.min(p, q), wp.min(r, s))
    high[c] = wp.max(wp.max(p, q), wp.max(r, s))


@wp.kernel
def _find_in_cells(
    tree: wp.uint64,
    vertices: wp.array(dtype=wp.int32),
    vertex_points: wp.array(dtype=wp.vec3),
    points: wp.array(dtype=wp.vec3),
    cells: wp.array(dtype=wp.vec4i),
    is_same: wp.bool,
    pairs: wp.array(dtype=wp.vec2i),
    count: wp.array(dtype=wp.int32),
):
    v = vertices[wp.tid()]
    p = vertex_points[v]
    query = wp.bvh_query_aabb(tree, p, p)
    c = wp.int32(0)
    while wp.bvh_query_next(query, c):
        cell = cells[c]
        if is_same and (v == cell[0] or v == cell[1] or v == cell[2] or v == cell[3]):
            continue
        o = points[cell[0]]
        a, b, d, q = points[cell[1]] - o, points[cell[2]] - o, points[cell[3]] - o, p - o
        volume = wp.dot(a, wp.cross(b, d))
        if volume > 0.0:
            of_a = wp.dot(q, wp.cross(b, d)) / volume
            of_b = wp.dot(q, wp.cross(d, a)) / volume
            of_d = wp.dot(q, wp.cross(a, b)) / volume
            if of_a >= 0.0 and of_b >= 0.0 and of_d >= 0.0 and of_a + of_b + of_d <= 1.0:
                k = wp.atomic_add(count, 0, 1)
                if k < pairs.shape[0]:
                    pairs[k] = wp.vec2i(v, c)


class Collision:
    """A tree for each body, whose boxes are computed and refitted in every step."""

    version, precision = str(wp.__version__), "float32"

    def __init__(self, job: dict[str, Any]) -> None:
        self._frames = [
            [wp.array(f.astype(np.float32), dtype=wp.vec3, device=DEVICE) for f in frames]
            for frames in job["frames"]
        ]
        self._cells = wp.array(job["cells"], dtype=wp.vec4i, device=DEVICE)
        self._vertices = wp.array(np.unique(job["facets"]), dtype=wp.int32, device=DEVICE)
        self._boxes = [
            [wp.zeros(len(self._cells), dtype=wp.vec3, device=DEVICE) for _ in range(2)]
            for _ in range(2)
        ]
        # The quickest of leaves with 1, 2, 4 and 8 cells, for refit and query together.
        self._trees: list[Any] = []
        for k in range(2):
            self._fit(k, 0)
            self._trees.append(wp.Bvh(*self._boxes[k], leaf_size=8))
        self._turns = [(1, 0), (0, 1)] + ([(0, 0), (1, 1)] if bool(job["with_self"]) else [])
        self._count = wp.zeros(1, dtype=wp.int32, device=DEVICE)
        # Memory for the most pairs of any frame.
        self._pairs = {turn: wp.zeros(1, dtype=wp.vec2i, device=DEVICE) for turn in self._turns}
        for k in range(len(self._frames[0])):
            for turn, count in self._look(k).items():
                if count > len(self._pairs[turn]):
                    self._pairs[turn] = wp.zeros(count, dtype=wp.vec2i, device=DEVICE)
        # Numbers of the second body follow those of the first.
        offsets = np.array([job["frames"].shape[2], len(self._cells)])
        found = [
            self._pairs[turn].numpy()[:count].astype(np.int64) + offsets * turn
            for turn, count in self._look(0).items()
        ]
        self.result = {"pairs": np.concatenate(found)}

    def _fit(self, k: int, frame: int) -> None:
        wp.launch(
            _fit_boxes,
            dim=len(self._cells),
            inputs=[self._frames[k][frame], self._cells, *self._boxes[k]],
            device=DEVICE,
        )

    def _look(self, frame: int) -> dict[tuple[int, int], int]:
        counts = {}
        for k in range(2):
            self._fit(k, frame)
            self._trees[k].refit()
        for intruder, other in self._turns:
            self._count.zero_()
            wp.launch(
                _find_in_cells,
                dim=len(self._vertices),
                inputs=[
                    self._trees[other].id, self._vertices, self._frames[intruder][frame],
                    self._frames[other][frame], self._cells, intruder == other,
                    self._pairs[intruder, other], self._count,
                ],
                device=DEVICE,
            )  # fmt: skip
            counts[intruder, other] = int(self._count.numpy()[0])
        return counts

    def advance(self, num_steps: int) -> None:
        """Compute boxes, refit and query."""
        for step in range(num_steps):
            self._look(step % len(self._frames[0]))
