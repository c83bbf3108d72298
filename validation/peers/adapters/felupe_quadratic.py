"""FElupe with quadratic tetrahedra on the case's mesh; else like felupe_svk.py.

    palpate gate CASE --simulator "python felupe_quadratic.py {case} {result}"

It answers on the cells cut in eight, so that its middle nodes are judged too.
"""

from __future__ import annotations

import felupe
import felupe_svk
from quadratic import Quadratic


class Static(felupe_svk.Static):  # type: ignore[misc]
    """Four points of integration in each cell."""

    tool, kind, region = "FElupe tetra10", "tetra10", felupe.RegionQuadraticTetra
    nodes_of = Quadratic.of


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
