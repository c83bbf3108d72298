"""CalculiX (`ccx`) with quadratic tetrahedra C3D10 on the case's mesh; else like calculix.py.

    palpate gate CASE --simulator "python calculix_quadratic.py {case} {result}"

It answers on the cells cut in eight, so that its middle nodes are judged too.
"""

from __future__ import annotations

import calculix
from quadratic import Quadratic


class Static(calculix.Static):  # type: ignore[misc]
    """One run of the program a solve."""

    tool, kind, nodes_of = "CalculiX C3D10", "C3D10", Quadratic.of


if __name__ == "__main__":
    from harness import answer_case

    answer_case(Static)
