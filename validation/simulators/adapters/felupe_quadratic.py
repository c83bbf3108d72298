"""FElupe with quadratic tetrahedra on the case's mesh; else like felupe_svk.py.

    palpate gate CASE --simulator "python felupe_quadratic.py {case} {result}"

It answers on the cells cut in eight, so that its middle nodes are judged too.
"""

from __future__ import annotations

from typing import Any

import felupe
import felupe_svk
from quadratic import Quadratic


class Static(felupe_svk.Static):  # type: ignore[misc]
    """Four points of integration in each cell."""

    tool, kind, region = "FElupe tetra10", "tetra10", felupe.RegionQuadraticTetra

    def body_of(self, job: dict[str, Any]) -> dict[str, Any]:
        """With the middles of edges.

        Raises:
            ValueError: Loads that cannot be told apart.
        """
        self._nodes = Quadratic.of(job)
        arrays: dict[str, Any] = self._nodes.arrays
        return arrays

    def answer_of(self, displacement: Any) -> dict[str, Any]:
        """On the cells cut in eight."""
        answer: dict[str, Any] = self._nodes.answer(displacement)
        return answer


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
