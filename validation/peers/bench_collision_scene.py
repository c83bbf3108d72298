"""The scene of `bench collision`: two bodies that overlap or not, and deform in every step."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.bricks import brick_box
from palpate.meshes.tet_mesh import TetMesh

# Steps before the motion comes round again.
NUM_FRAMES = 6
_SWAY = 0.02  # of the bodies' half size: how far points move to and fro
_ROUND = 0.6  # of the way from a cube to a ball


class Place(Enum):
    """How the two bodies lie."""

    OVERLAPPING = "overlapping"
    APART = "apart"


# Between the centres, in half sizes of a body, along the diagonal: the boxes around the bodies
# overlap in both.
_BETWEEN = {Place.OVERLAPPING: 1.7, Place.APART: 2.5}


def make_bodies(divisions: int, place: Place) -> dict[str, NDArray[np.generic]]:
    """Rounded boxes of divisions^3 bricks, six tetrahedra each, the second one turned.

    Returns:
        `cells` and boundary `facets` of either body, 24 divisions^2 in all, and `frames`, points
        of each body by step [m], shape (2, NUM_FRAMES, num_points, 3).
    """
    box = brick_box((divisions,) * 3, (2.0,) * 3, ragged=0.1)
    points = box.points - 1.0
    largest = np.abs(points).max(axis=1)
    length = np.linalg.norm(points, axis=1)
    ball = (
        points * np.divide(largest, length, out=np.ones_like(length), where=length > 0.0)[:, None]
    )
    mesh = TetMesh((1.0 - _ROUND) * points + _ROUND * ball, box.cells)
    between = _BETWEEN[place] / np.sqrt(3.0) * np.ones(3)
    first = _frames(mesh.points, _turned(0.4, 0.3), np.zeros(3), 0.0)
    second = _frames(mesh.points, _turned(1.1, -0.7), between, 2.0)
    return {
        "cells": mesh.cells,
        "facets": mesh.boundary_facets,
        "frames": np.stack([first, second]),
    }


def _turned(about_z: float, about_x: float) -> Points:
    c, s = np.cos(about_z), np.sin(about_z)
    d, t = np.cos(about_x), np.sin(about_x)
    turn: Points = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, d, -t], [0.0, t, d]]
    )
    return turn


def _frames(points: Points, turn: Points, centre: Points, phase: float) -> NDArray[np.float64]:
    """Waves through the body: every point goes its own way, and no step is a rigid motion."""
    frames = []
    for k in range(NUM_FRAMES):
        angle = 2.0 * np.pi * k / NUM_FRAMES + phase
        wave = np.sin(4.0 * points[:, [1, 2, 0]] + angle + [0.0, 1.0, 2.0])
        frames.append((points + _SWAY * wave) @ turn.T + centre)
    return np.array(frames)
