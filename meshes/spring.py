"""A spring that pulls at a patch of the surface, as plain data in SI units; no mechanics here.

It models a hand or forceps that grips a patch of an organ and moves: a foundation of springs
(Winkler's) over the patch S, of stiffness density kappa per rest area, with the anchor moved by d:

    virtual work = int_S kappa (d - u) . v dA,    kappa = k w / int_S w dA,
    w(X) = (1 - |X - c|^2 / r^2)^2 within r of the centre c, and 0 beyond.

So the force on the body is k (d - mean of u weighted by w), and k is the stiffness of the whole
patch on every mesh. The weight falls smoothly to 0 at the edge of the patch: no stress is singular
there, and a facet more or less changes little. On each facet the weight is linear between its
values at the vertices, in every simulator and for every degree. Directions stay those at rest.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.triangles import connected_parts, facet_areas, facet_normals


@dataclass(frozen=True, eq=False)
class AnchorPath:
    """Motion of a spring's anchor from its position at rest.

    Args:
        times: Knots [s], shape (k,), increasing.
        displacements: Displacement of the anchor at each knot [m], shape (k, 3); linear in
            between, constant before the first and after the last.
        is_smooth: From knot to knot by the step 10 s^3 - 15 s^4 + 6 s^5 instead, s the fraction
            of the time.

    Raises:
        InputError: Other shapes, times that do not increase, NaN or infinity.

    >>> import palpate
    >>> palpate.AnchorPath([0.0, 0.2], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.01]]).at(0.1).tolist()
    [0.0, 0.0, 0.005]
    """

    times: Floats
    displacements: Points
    is_smooth: bool = False

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=np.float64))
        moved = np.atleast_2d(np.array(self.displacements, dtype=np.float64))
        if times.ndim != 1 or moved.shape != (len(times), 3):
            raise InputError(
                f"path of an anchor: displacements need shape ({len(times)}, 3), one for each "
                f"time, got {moved.shape}"
            )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "displacements", moved)
        self.components()  # raises what is wrong with times and values

    @property
    def end(self) -> Floats:
        """Displacement at the last knot [m], shape (3,); statics are solved for it."""
        last: Floats = self.displacements[-1]
        return last

    def components(self) -> tuple[TabularAmplitude, TabularAmplitude, TabularAmplitude]:
        """The x, y and z components over time [m]."""
        times = tuple(self.times.tolist())
        x, y, z = (
            TabularAmplitude(times, tuple(values), self.is_smooth)
            for values in self.displacements.T.tolist()
        )
        return x, y, z

    def at(self, time: float) -> Floats:
        """Displacement at a time [m], shape (3,)."""
        return np.array([component(time) for component in self.components()])


@dataclass(frozen=True, eq=False)
class Spring:
    """A patch of the surface pulled by springs with one common, moving anchor; see the module.

    Args:
        facets: Boundary facets in which the patch lies, shape (m, 3); `spring_patch` finds them.
            Points beyond the radius have no weight.
        center: Centre of the patch at rest [m], shape (3,).
        radius: Radius of the patch [m], > 0.
        stiffness: Stiffness of the whole patch [N/m], > 0.
        path: Motion of the anchor; with one knot the anchor does not move.
        amplitude: Factor over time on the stiffness [-], 0 (released) to 1; None is 1 at all
            times; statics take it as 1.

    Raises:
        InputError: A radius or a stiffness that is not above 0, a factor outside of 0 to 1, or a
            number that is not finite.

    >>> import numpy as np
    >>> import palpate
    >>> path = palpate.AnchorPath([0.0], [[0.0, 0.0, 0.005]])
    >>> spring = palpate.Spring([[0, 1, 2]], (0.0, 0.0, 0.0), 0.01, 200.0, path)
    >>> spring.weights(np.array([[0.0, 0.0, 0.0], [0.005, 0.0, 0.0]])).tolist()
    [1.0, 0.5625]
    """

    facets: Indices
    center: tuple[float, float, float]
    radius: float
    stiffness: float
    path: AnchorPath
    amplitude: TabularAmplitude | None = None

    def __post_init__(self) -> None:
        x, y, z = (float(c) for c in self.center)
        object.__setattr__(self, "center", (x, y, z))
        if not all(map(math.isfinite, self.center)):
            raise InputError(f"center = {self.center} of a spring needs finite numbers")
        for name in ("radius", "stiffness"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value:g} of a spring: needs a finite value above 0")
        factors = (1.0,) if self.amplitude is None else self.amplitude.factors
        if not 0.0 <= min(factors) <= max(factors) <= 1.0:
            raise InputError(
                f"amplitude of a spring: factors of its stiffness lie between 0 and 1, got "
                f"{min(factors):g} to {max(factors):g}"
            )

    @classmethod
    def on(
        cls,
        mesh: TetMesh,
        center: tuple[float, float, float],
        radius: float,
        stiffness: float,
        path: AnchorPath,
        amplitude: TabularAmplitude | None = None,
    ) -> Spring:
        """The spring over the patch of a mesh that `spring_patch` finds.

        Raises:
            InputError: See `spring_patch` and the class.
        """
        spring = cls(np.zeros((0, 3), dtype=np.int32), center, radius, stiffness, path, amplitude)
        return dataclasses.replace(spring, facets=spring_patch(mesh, spring.center, spring.radius))

    def weights(self, points: Points) -> Floats:
        """Weight at rest positions [-], (n,) for (n, 3): 1 at the centre, 0 from the radius on."""
        squared = np.sum(((points - np.array(self.center)) / self.radius) ** 2, axis=-1)
        inside: Floats = np.clip(1.0 - squared, 0.0, None) ** 2
        return inside

    def densities(self, points: Points) -> Floats:
        """Stiffness per rest area at the corners of its facets [N/m3], (m, 3): k w / int w dA.

        Args:
            points: Points of the mesh at rest [m], shape (num_points, 3).

        Raises:
            InputError: No corner lies within the radius.
        """
        corners = points[self.facets]
        weights = self.weights(corners)
        whole = float(facet_areas(corners) @ weights.mean(axis=1))
        if not whole > 0.0:
            raise InputError(
                f"radius = {self.radius:g} m of a spring about {_text(self.center)} m: no point of "
                "the surface lies so near; take a larger radius or smaller cells"
            )
        return self.stiffness / whole * weights


def spring_patch(mesh: TetMesh, center: tuple[float, float, float], radius: float) -> Indices:
    """The connected boundary facets within a radius [m] of a point [m], shape (m, 3), m >= 1.

    Connected to the nearest facet over common points: the other side of a thin wall is not among
    them.

    Raises:
        InputError: No facet lies within the radius, or no point of those that do.
    """
    facets = mesh.boundary_facets
    distances = _distances(mesh.points[facets], np.asarray(center, dtype=np.float64))
    nearest = int(distances.argmin())
    near = facets[distances < radius]
    if not distances[nearest] < radius:
        raise InputError(
            f"radius = {radius:g} m about {_text(center)} m: the surface is {distances[nearest]:g} "
            "m away; move the centre to the surface, or take a larger radius"
        )
    part = connected_parts(mesh.num_points, near[:, [0, 1, 1, 2]].reshape(-1, 2).astype(np.int64))
    patch: Indices = near[part[near[:, 0]] == part[facets[nearest, 0]]]
    if not (np.linalg.norm(mesh.points[patch] - np.asarray(center), axis=-1) < radius).any():
        raise InputError(
            f"radius = {radius:g} m about {_text(center)} m: no point of the surface lies so near; "
            "take a larger radius or smaller cells"
        )
    return patch


def _text(position: tuple[float, float, float]) -> str:
    return f"({', '.join(f'{x:g}' for x in position)})"


def _distances(corners: Points, position: Floats) -> Floats:
    """Distance of a point from triangles [m], (m,) for (m, 3, 3): to the plane, or to an edge."""
    nearest = np.full(len(corners), np.inf)
    for k in range(3):
        start, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        part = np.einsum("ij,ij->i", position - start, along) / np.einsum("ij,ij->i", along, along)
        foot = start + np.clip(part, 0.0, 1.0)[:, None] * along
        nearest = np.minimum(nearest, np.linalg.norm(position - foot, axis=1))
    normal = facet_normals(corners)
    size = np.linalg.norm(normal, axis=1)
    height = np.einsum("ij,ij->i", position - corners[:, 0], normal) / size
    foot = position - (height / size)[:, None] * normal
    is_above = np.ones(len(corners), dtype=bool)
    for k in range(3):
        along = corners[:, (k + 1) % 3] - corners[:, k]
        turned = np.einsum("ij,ij->i", np.cross(along, foot - corners[:, k]), normal)
        is_above &= turned >= 0.0
    return np.where(is_above, np.abs(height), nearest)
