"""CalculiX (`ccx`) with quadratic tetrahedra C3D10 on the case's mesh; else like calculix.py.

    palpate gate CASE --simulator "python calculix_quadratic.py {case} {result}"

It answers on the cells cut in eight, so that its middle nodes are judged too.
"""

from __future__ import annotations

from typing import Any

import calculix
from quadratic import Quadratic


class Static(calculix.Static):  # type: ignore[misc]
    """One run of the program a solve."""

    tool, kind = "CalculiX C3D10", "C3D10"

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
