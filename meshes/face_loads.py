"""Surface loads that vary over a face, given by values at points, by a profile or by a moment.

Each function gives a `Traction` of degree 0 to 2 in the rest position, which every simulator
turns into nodal forces of its own.
"""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.triangles import facet_areas, facet_normals

# Values within this fraction of the largest from an affine field count as affine.
_AFFINE = 1e-9
# Normals of one plane differ by at most this angle [degrees]: rounding of single precision.
_FLAT_DEG = 0.01
# Directions in which the points extend over less than this fraction of their size are ignored.
_FLAT = 1e-9


class Profile(StrEnum):
    """How a traction varies along a line between two points; across the line it is constant.

    With s from 0 to 1 along the line: 1, s, and 4 s (1 - s), which is 1 half-way. Hydrostatic: with
    the depth below a free surface (`hydrostatic_traction`).
    """

    UNIFORM = "uniform"
    LINEAR = "linear"
    PARABOLIC = "parabolic"
    HYDROSTATIC = "hydrostatic"


def affine_traction(
    facets: Indices,
    positions: ArrayLike,
    values: ArrayLike,
    amplitude: TabularAmplitude | None = None,
) -> Traction:
    """The traction that is affine in the rest position and has given values at some points.

    One point gives a uniform traction, two one that varies along their line, three one that
    varies in their plane; it is constant in the directions that the points do not span.

    Args:
        facets: Loaded boundary facets, shape (m, 3).
        positions: [m], shape (n, 3), 1 <= n <= 4; they need not lie on the face.
        values: Traction there [Pa], shape (n, 3).
        amplitude: Factor over time [-].

    Raises:
        InputError: Not 1 to 4 points, or values that no affine field has.

    >>> import palpate
    >>> from palpate.meshes.face_loads import affine_traction
    >>> grows = affine_traction([[0, 1, 2]], [[0, 0, 0], [0, 0, 2]], [[0, 0, 0], [0, 6, 0]])
    >>> grows.gradient[1].tolist()
    [0.0, 0.0, 3.0]
    """
    x = np.asarray(positions, dtype=np.float64)
    t = np.asarray(values, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or t.shape != x.shape or not 1 <= len(x) <= 4:
        raise InputError("a traction by values needs 1 to 4 places with three numbers each")
    if not (np.isfinite(x).all() and np.isfinite(t).all()):
        raise InputError("a traction by values: a number is NaN or infinite")
    centre, mean = x.mean(axis=0), t.mean(axis=0)
    # Of all affine fields that fit, the one with the smallest gradient.
    slope = np.linalg.pinv(x - centre, rcond=_FLAT) @ (t - mean)
    missed = (x - centre) @ slope + mean - t
    worst = int(np.abs(missed).max(axis=1).argmax())
    if np.abs(missed).max() > _AFFINE * np.abs(t).max(initial=0.0):
        shown = ", ".join(f"{v:g}" for v in t[worst] + missed[worst])
        raise InputError(
            f"a traction by values: the {len(x)} values are not those of one affine field; near "
            f"({', '.join(f'{c:g}' for c in x[worst])}) m the others ask for [{shown}] Pa. "
            "Correct a value, or leave out a place"
        )
    if not slope.any():
        return Traction(facets, _triple(mean), amplitude)
    return Traction(facets, _triple(mean - centre @ slope), amplitude, gradient=slope.T)


def profile_traction(
    facets: Indices,
    peak: ArrayLike,
    profile: Profile,
    start: ArrayLike,
    end: ArrayLike,
    amplitude: TabularAmplitude | None = None,
) -> Traction:
    """A traction that follows a named profile along a line and is constant across it.

    Args:
        facets: Loaded boundary facets, shape (m, 3).
        peak: Traction where the profile is 1 [Pa], shape (3,).
        profile: See `Profile`.
        start: Point with s = 0 [m], shape (3,).
        end: Point with s = 1 [m], shape (3,).
        amplitude: Factor over time [-].

    Raises:
        InputError: Start and end are the same point, or the hydrostatic profile, which has none.

    Note:
        Beyond start and end the same polynomial continues: a parabola changes its sign there.
    """
    if profile is Profile.HYDROSTATIC:
        raise InputError("the hydrostatic profile follows a depth; see hydrostatic_traction")
    p = np.asarray(peak, dtype=np.float64)
    a = np.asarray(start, dtype=np.float64)
    line = np.asarray(end, dtype=np.float64) - a
    squared = float(line @ line)
    if not squared > 0.0:
        raise InputError("a profile needs a start and an end that are two places")
    if profile is Profile.UNIFORM:
        return Traction(facets, _triple(p), amplitude)
    # s = d . X - s0
    d, s0 = line / squared, float(line @ a) / squared
    if profile is Profile.LINEAR:
        return Traction(facets, _triple(-s0 * p), amplitude, gradient=np.outer(p, d))
    return Traction(
        facets,
        _triple(-4.0 * s0 * (1.0 + s0) * p),
        amplitude,
        gradient=4.0 * (1.0 + 2.0 * s0) * np.outer(p, d),
        curvature=-8.0 * p[:, None, None] * np.outer(d, d),
    )


def hydrostatic_traction(
    mesh: TetMesh,
    facets: Indices,
    density: float,
    gravity: ArrayLike,
    free_surface: ArrayLike,
    amplitude: TabularAmplitude | None = None,
) -> Traction:
    """The pressure of a liquid at rest on a flat face, t = -rho (g . (X - X0)) N at rest.

    N is the face's outward normal at rest, X0 a point on the free surface, where the pressure is 0.

    Args:
        mesh: Rest mesh [m].
        facets: Loaded boundary facets in one plane, shape (m, 3).
        density: rho of the liquid [kg/m3], > 0.
        gravity: g [m/s2], shape (3,).
        free_surface: X0 [m], shape (3,).
        amplitude: Factor over time [-].

    Raises:
        InputError: A face that is not flat, a part of it above the free surface, a density that is
            not above 0, or no gravity.

    Note:
        Dead, as every traction: direction and depth are those of the face at rest.
    """
    g = np.asarray(gravity, dtype=np.float64)
    level = np.asarray(free_surface, dtype=np.float64)
    if not (math.isfinite(density) and density > 0.0):
        raise InputError(f"density = {density:g} kg/m3 of a liquid: needs a finite value above 0")
    if not (np.isfinite(g).all() and np.isfinite(level).all() and g.any()):
        raise InputError("a hydrostatic traction needs gravity and a place on the free surface")
    corners = mesh.points[np.asarray(facets)]
    doubled = facet_normals(corners)
    normals = doubled / np.linalg.norm(doubled, axis=1, keepdims=True)
    mean = doubled.sum(axis=0)
    mean /= np.linalg.norm(mean) or 1.0
    angle = float(np.rad2deg(np.arccos(np.clip(normals @ mean, -1.0, 1.0)).max()))
    if angle > _FLAT_DEG:
        raise InputError(
            f"a hydrostatic traction needs a flat face, this one's normals differ by {angle:.3g} "
            "degrees; give one load for each plane"
        )
    mean[np.abs(mean) < _FLAT] = 0.0
    depths = (corners - level) @ (g / np.linalg.norm(g))
    highest = float(depths.min())
    if highest < -_FLAT * float(np.ptp(depths) + np.abs(depths).max()):
        raise InputError(
            f"a hydrostatic traction: the face reaches {-highest:g} m above the free surface; "
            "choose the facets below it, no liquid pulls"
        )
    return Traction(
        facets,
        _triple(density * float(g @ level) * mean),
        amplitude,
        gradient=-density * np.outer(mean, g),
    )


def moment_traction(
    mesh: TetMesh,
    facets: Indices,
    moment: ArrayLike,
    amplitude: TabularAmplitude | None = None,
) -> Traction:
    """The traction a x (X - c) that has a given moment and no resultant force.

    With c the centroid of the face and J = integral of |r|^2 I - r r^T over its area, r = X - c,
    its second moments, a = J^-1 M. For a moment along a face's normal that is the stress of
    Saint-Venant's torsion of a circular section; for one in a flat face's plane, along a principal
    axis, that of pure bending. Having no resultant force, it has this moment about every point.

    Args:
        mesh: Rest mesh [m].
        facets: Loaded boundary facets, shape (m, 3).
        moment: M [N m], shape (3,).
        amplitude: Factor over time [-].

    Raises:
        InputError: No facets, or a moment that is not finite.

    Note:
        Dead: every point of the face keeps its force in size and direction and does not turn with
        the body. Where the face turns by theta about the moment's axis, the integral of (R r) x t
        is cos(theta) M: 1.5 % are lost at 10 degrees, all of it at 90. For a moment that stays,
        prescribe the rotation of the face.
    """
    M = np.asarray(moment, dtype=np.float64)
    corners = mesh.points[np.asarray(facets)]
    if M.shape != (3,) or not np.isfinite(M).all() or not len(corners):
        raise InputError("a moment load needs three finite numbers [N m] and a face to act on")
    areas = facet_areas(corners)
    centre = np.average(corners.mean(axis=1), axis=0, weights=areas)
    # Middles of edges integrate quadratics exactly.
    r = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centre
    second = np.einsum("m,mki,mkj->ij", areas / 3.0, r, r)
    a = np.linalg.solve(np.trace(second) * np.eye(3) - second, M)
    spin = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    return Traction(facets, _triple(-spin @ centre), amplitude, gradient=spin)


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) + 0.0 for v in values)
    return x, y, z
