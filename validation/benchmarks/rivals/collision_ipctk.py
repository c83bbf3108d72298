"""Candidates by a broad phase of the IPC toolkit, built anew in every step."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import ipctk
import numpy as np


class Rival:
    """Both bodies in one mesh; pairs within a body are filtered out by the toolkit itself."""

    precision = "float64"

    def __init__(self, body: dict[str, Any]) -> None:
        ipctk.set_num_threads(1)
        method, query = str(body["method"]), str(body["query"])
        self.tool, self.version = f"ipctk {method}", version("ipctk")
        frames = np.concatenate([body["frames_0"], body["frames_1"]], axis=1)
        count = body["frames_0"].shape[1]
        self._frames = [np.asfortranarray(frame) for frame in frames]
        facets = np.concatenate([body["facets"], body["facets"] + count])
        edges = np.concatenate([body["edges"], body["edges"] + count])
        self._looks_for_edges = query == "edges near edges"
        # What a query does not need is left out, where that does not slow the method down (two
        # of them take the size of their voxels from the edges).
        if self._looks_for_edges:
            facets = facets[:0]
        elif method in ("LBVH", "SweepAndPrune"):
            edges = edges[:0]
        self._edges = np.asfortranarray(edges, dtype=np.int32)
        self._facets = np.asfortranarray(facets, dtype=np.int32)
        self._broad = getattr(ipctk, method)()
        if not bool(body["with_self"]):
            patches = np.repeat([0, 1], count).astype(np.int32)
            self._broad.can_vertices_collide = ipctk.make_vertex_patches_filter(patches)
        # It grows both boxes of a pair.
        self._radius = 0.5 * float(body["distance"])
        self._step = 0
        found = self._look(0)
        names = ("edge0_id", "edge1_id") if self._looks_for_edges else ("vertex_id", "face_id")
        rows = [[getattr(pair, name) for name in names] for pair in found]
        self.force = np.array(rows, dtype=np.float64).reshape(-1, 2)

    def _look(self, k: int) -> Any:
        self._broad.build(self._frames[k], self._edges, self._facets, self._radius)
        if self._looks_for_edges:
            return self._broad.detect_edge_edge_candidates()
        return self._broad.detect_face_vertex_candidates()

    def advance(self, num_steps: int) -> None:
        """Build and query."""
        for _ in range(num_steps):
            self._step += 1
            self._look(self._step % len(self._frames))


def prepare(body: dict[str, Any]) -> Rival:
    """Nothing is kept from step to step but the arrays."""
    return Rival(body)
