"""Coulomb friction of vertices on a tool at rest: what holds them, and what they slip under.

A vertex carries, along the tool's surface and beside its push p,

    f = f1 where |f1| <= mu p, else mu p f1 / |f1|,      f1 = multiplier - k A slip,

with its slip over the tool since the last equilibrium. Multiplier and p are those of the last
update (Alart and Curnier 1991, with the bound held as in a quasi-potential): each Newton solve is
then of a potential, and its tangent is symmetric.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points


class Drag:
    """Friction between one tool and its vertices.

    Args:
        coefficient: Coulomb's [-], >= 0.
        weights: k A of each vertex [N/m], shape (n,).
    """

    def __init__(self, coefficient: float, weights: Floats) -> None:
        self.coefficient = coefficient
        self._weights = weights
        # Both seen from the tool.
        self._multipliers: Points = np.zeros((len(weights), 3))
        self._kept = self._multipliers, self._multipliers

    def keep(self, places: Points, pose: NDArray[np.void]) -> None:
        """Go on from an equilibrium with the vertices at these places [m]."""
        self._kept = self._multipliers, _seen_from(places, pose)

    def go_back(self) -> None:
        """To the last equilibrium that was kept."""
        self._multipliers = self._kept[0]

    def forces(
        self, places: Points, pose: NDArray[np.void], normals: Points, pushes: Floats
    ) -> tuple[Points, Floats]:
        """What drags the vertices [N], shape (n, 3), and minus its derivative, (n, 3, 3) [N/m].

        Args:
            places: Of the vertices [m], shape (n, 3).
            pose: Of the tool.
            normals: Out of the tool, shape (n, 3).
            pushes: Multipliers of contact, which bound it [N], shape (n,).
        """
        count = len(places)
        if self.coefficient == 0.0 or not count:
            return np.zeros((count, 3)), np.zeros((count, 3, 3))
        slip = _seen_from(places, pose) - self._kept[1]
        wanted = (self._multipliers - self._weights[:, None] * slip) @ pose["rotation"].T
        across = np.eye(3) - np.einsum("ni,nj->nij", normals, normals)
        wanted = np.einsum("nij,nj->ni", across, wanted)
        sizes, most = np.linalg.norm(wanted, axis=1), self.coefficient * pushes
        is_held = sizes <= most
        share = np.where(is_held, 1.0, most / np.where(is_held, 1.0, sizes))
        along = np.where(is_held, 0.0, 1.0 / np.where(is_held, 1.0, sizes))[:, None] * wanted
        stiff = across - np.einsum("ni,nj->nij", along, along)
        return share[:, None] * wanted, (share * self._weights)[:, None, None] * stiff

    def update(self, forces: Points, pose: NDArray[np.void]) -> tuple[float, float]:
        """Multipliers := forces [N]; squares of the norms of their change and of them."""
        new = forces @ pose["rotation"]
        change = float(np.sum((new - self._multipliers) ** 2))
        self._multipliers = new
        return change, float(np.sum(new**2))


def _seen_from(places: Points, pose: NDArray[np.void]) -> Points:
    seen: Points = (places - pose["position"]) @ pose["rotation"]
    return seen
