"""Bodies in plane strain by polynomials of high degree, on quadrilaterals graded to every corner.

Galerkin's method in two dimensions: tensor products of degree p on a grid of quadrilaterals whose
sizes fall geometrically towards the lines on which corners lie. With p and the layers raised
together the error falls exponentially, singular corners or not (I. Babuska, B. Q. Guo, SIAM J.
Numer. Anal. 25, 1988), so that what one more rise changes says how well an answer is known.

Hooke's law, or with finite strain by Newton's method Saint-Venant-Kirchhoff's (eq. 6-7) or the
stable neo-Hookean one. Strains grow without bound towards a clamped corner; where it is pressed the
first gives way there, and free surfaces of the second crease (M. A. Biot, Appl. Sci. Res. A 12,
1963): grids fine enough to see it find no equilibrium, or another one. Smaller loads put it farther
in. Nothing is shared with the reference.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from calibration_recipe.shapes import confined_modulus
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain

_MOST_ITERATIONS, _SMALLEST_STEP = 20, 0.1
_CONVERGED = 1e-11
# No component of the displacement's gradient changes by more in a step of Newton's method.
_STEEPEST = 0.3


# Of the sizes of neighbouring quadrilaterals.
_FALL = 0.2


@dataclass(frozen=True)
class Section:
    """What is extruded: bricks of a grid, some of them left out, and where they really lie.

    Attributes:
        x: Lines of the grid, rising; every corner of the outline lies on one.
        z: Likewise.
        is_solid: Which bricks are there, shape (len(x) - 1, len(z) - 1).
        position: From the grid to the rest places [m], (..., 2) for (..., 2); bilinear.
    """

    x: Floats
    z: Floats
    is_solid: NDArray[np.bool_]
    position: Callable[[Floats], Floats]


def graded(lines: Floats, layers: int) -> Floats:
    """Lines of elements: falling sizes towards each line, even ones between."""
    least = float(np.diff(lines).min())
    found = [lines[:1]]
    for a, b in itertools.pairwise(lines):
        reach = 0.4 * min(b - a, 2.0 * least)
        near = reach * _FALL ** np.arange(layers)[::-1]
        middle = b - a - 2.0 * reach
        pieces = max(1, round(middle / reach))
        even = a + reach + middle * np.arange(1, pieces) / pieces
        found.append(np.concatenate([a + near, even, (b - near)[::-1], [b]]))
    out: Floats = np.concatenate(found)
    return out


def lobatto(degree: int) -> Floats:
    """Gauss, Lobatto's places in [-1, 1]."""
    legendre = np.polynomial.legendre
    series = np.append(np.zeros(degree), 1.0)
    inside = legendre.legroots(legendre.legder(series))  # type: ignore[no-untyped-call]
    return np.concatenate([[-1.0], np.sort(inside.real), [1.0]])


def lagrange(nodes: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Polynomials that are one at one node, and their slopes; shape (places, nodes)."""
    legendre, degree = np.polynomial.legendre, len(nodes) - 1
    back = np.linalg.inv(legendre.legvander(nodes, degree))  # type: ignore[no-untyped-call]
    rate = legendre.legder(back)  # type: ignore[no-untyped-call]
    value = legendre.legvander(positions, degree) @ back  # type: ignore[no-untyped-call]
    slope = legendre.legvander(positions, degree - 1) @ rate  # type: ignore[no-untyped-call]
    return value, slope


def stress_of(material: Material, strain: Strain, H: Floats) -> tuple[Floats, Floats]:
    """First Piola-Kirchhoff stress in plane strain, and its slope.

    Args:
        material: Young's modulus, Poisson's ratio, and with Green strain the law.
        strain: Which strain measure.
        H: Displacement gradients, shape (elements, places, 2, 2).

    Returns:
        P [Pa], of the same shape, and dP/dH [Pa], two more axes of 2 behind.

    Raises:
        InputError: A law that is not written here.
    """
    if material.law not in (Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE):
        raise InputError(f"no plane strain here with law = {material.law}")
    eye, mu = np.eye(2), 0.5 * material.youngs_modulus / (1.0 + material.poissons_ratio)
    lmbda = confined_modulus(material) - 2.0 * mu
    F = H + eye
    if strain is Strain.GREEN and material.law is Law.NEO_HOOKEAN_STABLE:
        bulk = lmbda + mu
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        cofactor = turn @ F @ turn.T
        excess = np.linalg.det(F) - 1.0 - mu / bulk
        P = mu * F + bulk * excess[..., None, None] * cofactor
        A = bulk * np.einsum("eqij,eqkl->eqijkl", cofactor, cofactor)
        A += bulk * np.einsum("eq,ik,jl->eqijkl", excess, turn, turn)
        return P, A + mu * np.einsum("ik,jl->ijkl", eye, eye)
    C = lmbda * np.einsum("ij,kl->ijkl", eye, eye) + mu * (
        np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    )
    if strain is Strain.LINEAR:
        P = np.einsum("ijkl,eqkl->eqij", C, H)
        return P, np.broadcast_to(C, (*H.shape[:2], 2, 2, 2, 2))
    S = np.einsum("ijkl,eqkl->eqij", C, 0.5 * (np.swapaxes(F, 2, 3) @ F - eye))
    A = np.einsum("eqia,ajbl,eqkb->eqijkl", F, C, F, optimize=True)
    return F @ S, A + np.einsum("ik,eqlj->eqijkl", eye, S)


class PlaneNotConvergedError(RuntimeError):
    """Newton's method found no equilibrium at the smallest step of the load."""


@dataclass(frozen=True)
class PlaneLoads:
    """What holds and pushes; sides are "near" (first x), "far" (last x), "under", "top" (z).

    Attributes:
        held: Sides at which the displacement is given, with it: (n, 2) for rest places (n, 2) and
            the load factor.
        tractions: Dead, by side [Pa].
        pressures: By side [Pa]; they follow the deformed side under Green strain.
        body: Force per rest area of the section over its width [N/m3].
        slides: Of fixed sides that may slide: which of x (0) and z (1) is given there alone.
        cylinder: What is pressed against the top.
    """

    fixed: dict[str, Callable[[Floats, float], Floats]]
    tractions: dict[str, tuple[float, float]] = field(default_factory=dict)
    pressures: dict[str, float] = field(default_factory=dict)
    body: tuple[float, float] = (0.0, 0.0)
    slides: dict[str, int] = field(default_factory=dict)
    cylinder: Cylinder | None = None


@dataclass
class Cylinder:
    """A rigid cylinder without friction across the section, that top is pressed against.

    The gap g is the distance of moved places from it, at Gauss's points of the top's edges, and the
    pressure over rest area max(0, p - stiffness g), p being that of the last round (M. R. Hestenes,
    J. Optim. Theory Appl. 4, 1969), until no place is inside.

    Attributes:
        centre: Of it (x, z) [m].
        radius: [m].
        stiffness: [Pa/m].
        pressure: p at the points, (edges, points) [Pa].
    """

    centre: Floats
    radius: float
    stiffness: float
    pressure: Floats | None = None


class Plane:
    """A section with its grid of polynomials.

    Args:
        section: What is extruded.
        material: Of all of it.
        strain: Which strain measure.
        loads: What holds and pushes.
        degree: Of the polynomials, >= 2.
        layers: Of quadrilaterals, each a fifth of the next, towards each line of the grid.
    """

    def __init__(
        self,
        section: Section,
        material: Material,
        strain: Strain,
        loads: PlaneLoads,
        *,
        degree: int,
        layers: int,
    ) -> None:
        self.material, self.strain, self.loads = material, strain, loads
        self.p = p = degree
        self.x, self.z = (graded(lines, layers) for lines in (section.x, section.z))
        column = np.searchsorted(section.x, 0.5 * (self.x[1:] + self.x[:-1])) - 1
        row = np.searchsorted(section.z, 0.5 * (self.z[1:] + self.z[:-1])) - 1
        solid = section.is_solid[np.ix_(column, row)]
        self.nodes = lobatto(p)
        gauss, weight = np.polynomial.legendre.leggauss(p + 2)  # type: ignore[no-untyped-call]
        self.value, self.slope = lagrange(self.nodes, gauss)
        self.edge_weight = weight
        # Contact has as many points on an edge as that adds nodes: with more it would lock.
        touching, self.touch_weight = np.polynomial.legendre.leggauss(p)  # type: ignore[no-untyped-call]
        self.touch_value, self.touch_slope = lagrange(self.nodes, touching)
        self.weight = np.outer(weight, weight).ravel()
        self.basis = np.kron(self.value, self.value)
        # Along both reference directions, shape (2, points, nodes).
        self.rise = np.stack([np.kron(self.slope, self.value), np.kron(self.value, self.slope)])
        along = [
            np.append(
                (a[:-1, None] + np.diff(a)[:, None] * 0.5 * (1.0 + self.nodes[:-1])).ravel(), a[-1]
            )
            for a in (self.x, self.z)
        ]
        self.grid = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 2)
        self.positions = section.position(self.grid)
        # Column and row of each element, and its nodes.
        at = np.argwhere(solid)
        number = np.arange(len(self.grid)).reshape(len(along[0]), len(along[1]))
        self.elements = np.array(
            [number[c * p : (c + 1) * p + 1, r * p : (r + 1) * p + 1].ravel() for c, r in at]
        )
        # Nodes of an element's edges; which elements lie on each side, and which edges are free.
        local = np.arange((p + 1) ** 2).reshape(p + 1, p + 1)
        self.edges = {"near": local[0, ::-1], "far": local[-1],
                      "under": local[:, 0], "top": local[::-1, -1]}  # fmt: skip
        last = np.array(solid.shape) - 1
        self.on = {"near": at[:, 0] == 0, "far": at[:, 0] == last[0],
                   "under": at[:, 1] == 0, "top": at[:, 1] == last[1]}  # fmt: skip
        around, (c, r) = np.pad(solid, 1), at.T + 1
        self.free = {"near": ~around[c - 1, r], "far": ~around[c + 1, r],
                     "under": ~around[c, r - 1], "top": ~around[c, r + 1]}  # fmt: skip
        self.is_fixed = np.zeros(self.grid.shape, dtype=bool)
        for name in loads.fixed:
            self.is_fixed[np.ix_(self._side(name), self._given(name))] = True

    def solve(self, start: Floats | None = None) -> Floats:
        """Displacement at the nodes [m], shape (nodes, 2).

        Args:
            start: Near the answer under the whole load; without it the load is raised from none.

        Raises:
            PlaneNotConvergedError: No equilibrium was found.
        """
        u, factor, step = np.zeros_like(self.positions), 0.0, 1.0
        smallest = _SMALLEST_STEP
        if start is not None:
            u, smallest = start, 1.0
        while factor < 1.0:
            found = self._newton(u, min(factor + step, 1.0))
            if found is not None:
                u, factor = found, min(factor + step, 1.0)
            elif (step := 0.5 * step) < smallest:
                raise PlaneNotConvergedError(f"no equilibrium beyond {factor:.3f} of the load")
        return u

    def at(self, u: Floats, grid: Floats) -> Floats:
        """Displacement at points of the grid, (n, 2) for (n, 2)."""
        parts, nodes = [], []
        for k, lines in enumerate((self.x, self.z)):
            e = np.clip(np.searchsorted(lines, grid[:, k], side="right") - 1, 0, len(lines) - 2)
            xi = 2.0 * (grid[:, k] - lines[e]) / (lines[e + 1] - lines[e]) - 1.0
            parts.append(lagrange(self.nodes, xi)[0])
            nodes.append(e[:, None] * self.p + np.arange(self.p + 1))
        of = u.reshape((len(self.x) - 1) * self.p + 1, -1, 2)
        local = of[nodes[0][:, :, None], nodes[1][:, None, :]]
        found: Floats = np.einsum("ni,nj,nijc->nc", *parts, local)
        return found

    def sizes(self, u: Floats) -> tuple[float, float]:
        """Area inside the deformed outline [m2] and its length [m]."""
        moved = (self.positions + u)[self.elements]
        t = np.einsum("aqn,enc->eqac", self.rise, moved)
        area = float(np.sum(np.linalg.det(t) * self.weight))
        length = 0.0
        for name, nodes in self.edges.items():
            along = self.slope @ moved[self.free[name]][:, nodes]
            length += float(np.sum(np.linalg.norm(along, axis=2) @ self.edge_weight))
        return area, length

    def _given(self, name: str) -> list[int]:
        """Components that are given on a fixed side."""
        return [self.loads.slides[name]] if name in self.loads.slides else [0, 1]

    def _side(self, name: str) -> NDArray[np.intp]:
        """Nodes of a side."""
        return np.unique(self.elements[self.on[name]][:, self.edges[name]])

    def _newton(self, start: Floats, factor: float) -> Floats | None:
        u, last = start.copy(), np.inf
        for k in range(_MOST_ITERATIONS):
            jump = np.zeros_like(u)
            for name, given in self.loads.fixed.items():
                at = np.ix_(side := self._side(name), self._given(name))
                jump[at] = (given(self.positions[side], factor) - u[side])[:, self._given(name)]
            change = self._step(u, jump, factor)
            size = float(np.abs(change).max()) / max(float(np.abs(u + change).max()), 1e-30)
            if not np.isfinite(size):
                return None
            if self.strain is Strain.LINEAR and self.loads.cylinder is None:
                return u + change
            steepest = float(np.abs(self._gradient(change)[0]).max())
            u += change * min(1.0, _STEEPEST / steepest)
            if size < _CONVERGED or (size < 1e-8 and size > last):
                return u
            if k > 8 and steepest > _STEEPEST:
                return None
            last = size
        return None

    def stress(self, H: Floats) -> tuple[Floats, Floats]:
        """P and dP/dH of displacement gradients of all elements; see `stress_of`."""
        return stress_of(self.material, self.strain, H)

    def energy(self, u: Floats) -> float:
        """Energy of a linear solution, over the width [J/m]: half of the work of its stress."""
        H, _, weight = self._gradient(u)
        return 0.5 * float(np.einsum("eqij,eqij,eq->", self.stress(H)[0], H, weight))

    def _gradient(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """H = du/dX, the inverse of the map from the reference square, and volumes of points."""
        t = np.einsum("aqn,enc->eqca", self.rise, self.positions[self.elements])
        back = np.linalg.inv(t)
        H = np.einsum("aqn,eni->eqia", self.rise, u[self.elements]) @ back
        return H, back, np.linalg.det(t) * self.weight

    def _step(self, u: Floats, jump: Floats, factor: float) -> Floats:
        """One step of Newton's method; held nodes move by `jump`."""
        K, r = self.tangents(u, factor)
        of = (2 * self.elements[:, :, None] + np.arange(2)).reshape(len(K), -1)
        right = np.zeros(u.size)
        np.add.at(right, of, r - np.einsum("eij,ej->ei", K, jump.ravel()[of]))
        rows, columns = np.broadcast_arrays(of[:, :, None], of[:, None, :])
        whole = coo_matrix((K.ravel(), (rows.ravel(), columns.ravel())), shape=(u.size, u.size))
        free = np.setdiff1d(of, np.flatnonzero(self.is_fixed))
        A = whole.tocsc()[free][:, free]
        change = jump.ravel().copy()
        change[free] = spsolve(A, right[free], permc_spec="MMD_AT_PLUS_A")
        return change.reshape(u.shape)

    def tangents(self, u: Floats, factor: float) -> tuple[Floats, Floats]:
        """Tangents of the elements and the forces left over there; (e, 2n, 2n), (e, 2n)."""
        H, back, weight = self._gradient(u)
        P, A = self.stress(H)
        # Pulled to the reference square: one matrix of slopes for all elements.
        A = np.einsum("eqaj,eqijkl,eqbl->eqiakb", back, A, back, optimize=True)
        A *= weight[:, :, None, None, None, None]
        P = np.einsum("eqij,eqaj,eq->eqia", P, back, weight)
        n, count = self.basis.shape[1], len(self.elements)
        flat = self.rise.reshape(-1, n)
        K = np.zeros((count, n, 2, n, 2))
        for i in range(2):
            for k in range(2):
                mixed = np.einsum("eqab,bqn->eaqn", A[:, :, i, :, k], self.rise)
                K[:, :, i, :, k] = flat.T @ mixed.reshape(count, -1, n)
        r = -np.einsum("eqia,aqn->eni", P, self.rise)
        r += factor * np.einsum("eq,qn,i->eni", weight, self.basis, np.array(self.loads.body))
        self._push(u, factor, K, r)
        return K.reshape(count, 2 * n, 2 * n), r.reshape(count, 2 * n)

    def _push(self, u: Floats, factor: float, K: Floats, r: Floats) -> None:
        """Add what acts on the sides; nodes of edges run counter-clockwise round the body."""
        weighted = self.value * self.edge_weight[:, None]
        for name in {*self.loads.tractions, *self.loads.pressures}:
            nodes = self.edges[name]
            for e in np.flatnonzero(self.on[name]):
                of = self.elements[e, nodes]
                t = self.slope @ self.positions[of]
                if name in self.loads.tractions:
                    on = self.value.T @ (self.edge_weight * np.hypot(*t.T))
                    r[e, nodes] += factor * np.outer(on, self.loads.tractions[name])
                if name in self.loads.pressures:
                    size = factor * self.loads.pressures[name]
                    if self.strain is Strain.GREEN:
                        t = t + self.slope @ u[of]
                        turn = size * weighted.T @ self.slope
                        K[e, nodes[:, None], 0, nodes, 1] += turn
                        K[e, nodes[:, None], 1, nodes, 0] -= turn
                    # Outwards is (t_z, -t_x).
                    r[e, nodes] -= size * weighted.T @ np.column_stack([t[:, 1], -t[:, 0]])
        if self.loads.cylinder is not None:
            self._touch(self.loads.cylinder, u, K, r)

    def gaps(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Of the top's points from the cylinder: gap, unit normal, and the arm to its centre."""
        assert self.loads.cylinder is not None
        of = self.elements[self.on["top"]][:, self.edges["top"]]
        arm = self.touch_value @ (self.positions + u)[of] - self.loads.cylinder.centre
        away = np.linalg.norm(arm, axis=2)
        return away - self.loads.cylinder.radius, arm / away[:, :, None], away

    def augment(self, u: Floats) -> float:
        """Take the pressures at u as p; the largest depth of a point inside [m]."""
        cylinder = self.loads.cylinder
        assert cylinder is not None
        gap = self.gaps(u)[0]
        before = 0.0 if cylinder.pressure is None else cylinder.pressure
        cylinder.pressure = np.maximum(before - cylinder.stiffness * gap, 0.0)
        # A point that bears nothing may be apart.
        return float(np.abs(np.where(cylinder.pressure > 0.0, gap, np.minimum(gap, 0.0))).max())

    def _touch(self, cylinder: Cylinder, u: Floats, K: Floats, r: Floats) -> None:
        nodes, gap = self.edges["top"], self.gaps(u)
        before = np.zeros_like(gap[0]) if cylinder.pressure is None else cylinder.pressure
        for k, e in enumerate(np.flatnonzero(self.on["top"])):
            g, n, away = (part[k] for part in gap)
            p = before[k] - cylinder.stiffness * g
            t = self.touch_slope @ self.positions[self.elements[e, nodes]]
            weight = self.touch_weight * np.hypot(*t.T) * (p > 0.0)
            r[e, nodes] += self.touch_value.T @ ((weight * p)[:, None] * n)
            across = np.eye(2) - (both := n[:, :, None] * n[:, None, :])
            stiff = cylinder.stiffness * both - (p / away)[:, None, None] * across
            block = np.einsum(
                "q,qa,qij,qb->aibj", weight, self.touch_value, stiff, self.touch_value
            )
            for i in range(2):
                for j in range(2):
                    K[e, nodes[:, None], i, nodes, j] += block[:, i, :, j]
