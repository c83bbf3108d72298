"""Hexahedra, wedges and pyramids cut into tetrahedra that fit to their neighbours'.

Each is cut from its node of the smallest number: to the triangles of the faces that do not have
it, where a face of four corners is cut from its own smallest node. So two cells cut the face that
they share alike (J. Dompierre, P. Labbé, M.-G. Vallet, R. Camarero, How to subdivide pyramids,
prisms and hexahedra into tetrahedra, 8th Int. Meshing Roundtable, 1999).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Faces by corners, seen from outside counter-clockwise; FEBio's, Abaqus' and VTK's numbering of
# nodes. Their order is that of Abaqus' and CalculiX' faces S1, S2, ...
FACES: dict[int, tuple[tuple[int, ...], ...]] = {
    8: (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
    6: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    5: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def cut_cell(nodes: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """Tetrahedra of a cell of 8, 6 or 5 nodes: six, three or two.

    >>> cut_cell([0, 1, 2, 3, 4, 5])
    [(0, 3, 4, 5), (0, 1, 2, 5), (0, 1, 5, 4)]
    """
    first = min(nodes)
    found = []
    for face in FACES[len(nodes)]:
        corners = [nodes[k] for k in face]
        if first not in corners:
            found += [(first, *triangle) for triangle in cut_face(corners)]
    return found


def cut_face(nodes: Sequence[int]) -> list[tuple[int, int, int]]:
    """Triangles of a face of three or four corners, as its cell is cut there.

    >>> cut_face([3, 1, 2, 4])
    [(1, 2, 4), (1, 4, 3)]
    """
    start = int(np.argmin(nodes))
    a, *others = [*nodes[start:], *nodes[:start]]
    return [(a, b, c) for b, c in itertools.pairwise(others)]


def cut_cells(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Tetrahedra of cells of one kind, (num_cells, 8, 6 or 5): those of a cell stand together."""
    cut = [tetrahedron for row in rows.tolist() for tetrahedron in cut_cell(row)]
    return np.array(cut, dtype=np.int64).reshape(-1, 4)
