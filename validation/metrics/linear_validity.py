"""Whether a displacement by linear strain turns the body more than the validity map allows.

Rotation is what breaks linear strain. Bent bars from four times as long as thick on are off by one
curve over the rotation of their tip, whatever their length and Poisson's ratio: in displacement by
1 % at 1.5 degrees, 5 % at 7.4 and 10 % at 14.4 (`palpate study validity`). Of another body's
largest rotation that is a guide, no bound: only the audit by Green strain measures its error.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.tet_mesh import TetMesh

# Error of displacement [-], and the rotation at which a bent bar has it [degrees].
BORDERS = {0.01: 1.5, 0.05: 7.4, 0.10: 14.4}
# Cells turned more than all the others: so much of the volume is let go, for corners and edges.
_LEFT_OUT = 0.01


def cell_rotations(mesh: TetMesh, displacement: Points) -> Floats:
    """Angle by which each cell is turned [rad], 0 to pi, shape (num_cells,).

    Of the rotation nearest to its deformation gradient (Higham 1989).

    Args:
        mesh: At rest.
        displacement: [m], shape (num_points, 3).
    """
    rest, now = (_edges(points, mesh) for points in (mesh.points, mesh.points + displacement))
    gradient = now @ np.linalg.inv(rest)
    left, _, right = np.linalg.svd(gradient)
    turned = left @ right
    # An inverted cell's nearest orthogonal matrix is a reflection: its last axis is turned back.
    left[:, :, 2] *= np.sign(np.linalg.det(turned))[:, None]
    cosines = 0.5 * (np.trace(left @ right, axis1=1, axis2=2) - 1.0)
    angles: Floats = np.arccos(np.clip(cosines, -1.0, 1.0))
    return angles


def largest_rotation(mesh: TetMesh, displacement: Points) -> float:
    """Angle that all but 1 % of the volume are turned by at most [rad]."""
    angles = cell_rotations(mesh, displacement)
    order = np.argsort(angles)
    volume = np.cumsum(mesh.cell_volumes[order])
    k = int(np.searchsorted(volume, (1.0 - _LEFT_OUT) * volume[-1]))
    return float(angles[order][min(k, len(order) - 1)])


def describe_rotation(mesh: TetMesh, displacement: Points) -> str:
    """One line: how far the body is turned, and which border of the validity map it leaves."""
    degrees = math.degrees(largest_rotation(mesh, displacement))
    left = [error for error, border in BORDERS.items() if degrees > border]
    share = f"{1.0 - _LEFT_OUT:.0%} of the volume turned by at most {degrees:.2f} degrees"
    if not left:
        return f"{share}: within the {min(BORDERS):.0%} border of bent bars"
    border = f"{max(left):.0%} border of bent bars ({BORDERS[max(left)]:g} degrees)"
    return f"{share}: beyond the {border}; see palpate study validity"


def _edges(points: Points, mesh: TetMesh) -> Floats:
    corners = points[mesh.cells]
    edges: Floats = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    return edges
