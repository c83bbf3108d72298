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
from collections.abc import Callable, Iterator
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
        place: From the grid to the rest places [m], (..., 2) for (..., 2); bilinear.
    """

    x: Floats
    z: Floats
    is_solid: NDArray[np.bool_]
    place: Callable[[Floats], Floats]


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


def lagrange(nodes: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Polynomials that are one at one node, and their slopes; shape (places, nodes)."""
    legendre, degree = np.polynomial.legendre, len(nodes) - 1
    back = np.linalg.inv(legendre.legvander(nodes, degree))  # type: ignore[no-untyped-call]
    rate = legendre.legder(back)  # type: ignore[no-untyped-call]
    value = legendre.legvander(places, degree) @ back  # type: ignore[no-untyped-call]
    slope = legendre.legvander(places, degree - 1) @ rate  # type: ignore[no-untyped-call]
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

    def __init__(self, factor: float) -> None:
        super().__init__(
            f"no equilibrium in plane strain beyond {factor:.3f} of the load; lower it"
        )


@dataclass(frozen=True)
class PlaneLoads:
    """What holds and pushes; sides are "near" (first x), "far" (last x), "under", "top" (z).

    Attributes:
        held: Sides at which the displacement is given, with it: (n, 2) for rest places (n, 2) and
            the load factor.
        tractions: Dead, by side [Pa].
        pressures: By side [Pa]; they follow the deformed side under Green strain.
        body: Force per rest area of the section over its width [N/m3].
    """

    held: dict[str, Callable[[Floats, float], Floats]]
    tractions: dict[str, tuple[float, float]] = field(default_factory=dict)
    pressures: dict[str, float] = field(default_factory=dict)
    body: tuple[float, float] = (0.0, 0.0)


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
        self.columns, self.rows = len(self.x) - 1, len(self.z) - 1
        column = np.searchsorted(section.x, 0.5 * (self.x[1:] + self.x[:-1])) - 1
        row = np.searchsorted(section.z, 0.5 * (self.z[1:] + self.z[:-1])) - 1
        self.is_solid = section.is_solid[np.ix_(column, row)]
        self.nodes = lobatto(p)
        gauss, weight = np.polynomial.legendre.leggauss(p + 2)  # type: ignore[no-untyped-call]
        self.value, self.slope = lagrange(self.nodes, gauss)
        self.edge_weight = weight
        self.weight = np.outer(weight, weight).ravel()
        self.basis = np.kron(self.value, self.value)
        # Along both reference directions, shape (2, places, nodes).
        self.rise = np.stack([np.kron(self.slope, self.value), np.kron(self.value, self.slope)])
        along = [
            np.append(
                (a[:-1, None] + np.diff(a)[:, None] * 0.5 * (1.0 + self.nodes[:-1])).ravel(), a[-1]
            )
            for a in (self.x, self.z)
        ]
        self.grid = grid = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
        self.places = section.place(grid)
        self.is_held = np.zeros(grid.shape, dtype=bool)
        for name in loads.held:
            self.is_held[self._side(name)] = True

    def solve(self, start: Floats | None = None, step: float = 1.0) -> Floats:
        """Displacement at the nodes [m], shape (nodes along x, nodes along z, 2).

        Args:
            start: Near the answer under the whole load; without it the load is raised from none.
            step: The first step of the load, from none.

        Raises:
            PlaneNotConvergedError: No equilibrium was found.
        """
        if start is not None:
            found = self._newton(start, 1.0)
            if found is None:
                raise PlaneNotConvergedError(1.0)
            return found
        u, factor = np.zeros_like(self.places), 0.0
        while factor < 1.0:
            found = self._newton(u, min(factor + step, 1.0))
            if found is not None:
                u, factor = found, min(factor + step, 1.0)
            elif (step := 0.5 * step) < _SMALLEST_STEP:
                raise PlaneNotConvergedError(factor)
        return u

    def at(self, u: Floats, grid: Floats) -> Floats:
        """Displacement at places of the grid, (n, 2) for (n, 2)."""
        parts, first = [], []
        for k, lines in enumerate((self.x, self.z)):
            e = np.clip(np.searchsorted(lines, grid[:, k], side="right") - 1, 0, len(lines) - 2)
            xi = 2.0 * (grid[:, k] - lines[e]) / (lines[e + 1] - lines[e]) - 1.0
            parts.append(lagrange(self.nodes, xi)[0])
            first.append(e * self.p)
        nodal = np.arange(self.p + 1)
        local = u[(first[0][:, None] + nodal)[:, :, None], (first[1][:, None] + nodal)[:, None, :]]
        found: Floats = np.einsum("ni,nj,nijc->nc", *parts, local)
        return found

    def sizes(self, u: Floats) -> tuple[float, float]:
        """Area inside the deformed outline [m2] and its length [m]."""
        area = 0.0
        for c in range(self.columns):
            moved = self._local(self.places + u, c)
            t = np.einsum("aqn,enc->eqac", self.rise, moved)
            area += float(np.sum(np.linalg.det(t) * self.weight))
        length = 0.0
        for line in self._outline(self.places + u):
            length += float(np.hypot(*(self.slope @ line).T) @ self.edge_weight)
        return area, length

    def _outline(self, nodal: Floats) -> Iterator[Floats]:
        """Values at the nodes of each free or held edge, shape (p + 1, 2)."""
        p, solid = self.p, np.pad(self.is_solid, 1)
        for c, r in np.argwhere(self.is_solid):
            block = nodal[c * p : (c + 1) * p + 1, r * p : (r + 1) * p + 1]
            edges = {(0, 1): block[0], (2, 1): block[-1], (1, 0): block[:, 0], (1, 2): block[:, -1]}
            yield from (edge for (i, j), edge in edges.items() if not solid[c + i, r + j])

    def _side(self, name: str) -> tuple[slice | NDArray[np.intp], ...]:
        """Nodes of a side's solid edges, as an index of what is kept at nodes."""
        p = self.p
        along_z = name in ("near", "far")
        line = {"near": 0, "far": -1, "under": 0, "top": -1}[name]
        solid = self.is_solid[line] if along_z else self.is_solid[:, line]
        on = (np.flatnonzero(solid)[:, None] * p + np.arange(p + 1)).ravel()
        place = np.array([0 if line == 0 else self.places.shape[0 if along_z else 1] - 1])
        return (place, on) if along_z else (on, place)

    def _local(self, nodal: Floats, c: int) -> Floats:
        """Values of the solid elements of a column, shape (elements, nodes, 2)."""
        p = self.p
        block = nodal[c * p : (c + 1) * p + 1]
        rows = np.flatnonzero(self.is_solid[c])[:, None] * p + np.arange(p + 1)
        out: Floats = block[:, rows].transpose(1, 0, 2, 3).reshape(len(rows), -1, block.shape[-1])
        return out

    def _newton(self, start: Floats, factor: float) -> Floats | None:
        u, last = start.copy(), np.inf
        for k in range(_MOST_ITERATIONS):
            jump = np.zeros_like(u)
            for name, given in self.loads.held.items():
                side = self._side(name)
                jump[side] = given(self.places[side], factor) - u[side]
            change = self._step(u, jump, factor)
            size = float(np.abs(change).max()) / max(float(np.abs(u + change).max()), 1e-30)
            if not np.isfinite(size):
                return None
            if self.strain is Strain.LINEAR:
                return u + change
            steepest = self._steepest(change)
            u += change * min(1.0, _STEEPEST / steepest)
            if size < _CONVERGED or (size < 1e-8 and size > last):
                return u
            if k > 8 and steepest > _STEEPEST:
                return None
            last = size
        return None

    def _steepest(self, u: Floats) -> float:
        """Largest component of the displacement's gradient."""
        most = 0.0
        for c in range(self.columns):
            t = np.einsum("aqn,enc->eqca", self.rise, self._local(self.places, c))
            H = np.einsum("aqn,eni->eqia", self.rise, self._local(u, c)) @ np.linalg.inv(t)
            most = max(most, float(np.abs(H).max(initial=0.0)))
        return most

    def _step(self, u: Floats, jump: Floats, factor: float) -> Floats:
        """One step of Newton's method; held nodes move by `jump`."""
        number = np.arange(u.size).reshape(u.shape)
        right, parts = np.zeros(u.size), []
        for c in range(self.columns):
            K, r = self._elements(c, u, factor)
            of = self._local(number, c).reshape(len(K), -1)
            r -= np.einsum("eij,ej->ei", K, jump.ravel()[of])
            np.add.at(right, of, r)
            rows, columns = np.broadcast_arrays(of[:, :, None], of[:, None, :])
            parts.append((K.ravel(), rows.ravel(), columns.ravel()))
        values, rows, columns = (np.concatenate(some) for some in zip(*parts, strict=True))
        free = np.setdiff1d(rows, np.flatnonzero(self.is_held))
        A = coo_matrix((values, (rows, columns)), shape=(u.size, u.size)).tocsc()[free][:, free]
        change = jump.ravel().copy()
        change[free] = spsolve(A, right[free], permc_spec="MMD_AT_PLUS_A")
        return change.reshape(u.shape)

    def _elements(self, c: int, u: Floats, factor: float) -> tuple[Floats, Floats]:
        """Tangents and forces left over of a column's elements; (e, 2n, 2n), (e, 2n)."""
        X, local = self._local(self.places, c), self._local(u, c)
        t = np.einsum("aqn,enc->eqca", self.rise, X)
        back = np.linalg.inv(t)
        weight = np.linalg.det(t) * self.weight
        H = np.einsum("aqn,eni->eqia", self.rise, local) @ back
        P, A = stress_of(self.material, self.strain, H)
        # Pulled to the reference square: one matrix of slopes for all elements.
        A = np.einsum("eqaj,eqijkl,eqbl->eqiakb", back, A, back, optimize=True)
        A *= weight[:, :, None, None, None, None]
        P = np.einsum("eqij,eqaj,eq->eqia", P, back, weight)
        n = self.basis.shape[1]
        flat = self.rise.reshape(-1, n)
        K = np.zeros((len(X), n, 2, n, 2))
        for i in range(2):
            for k in range(2):
                mixed = np.einsum("eqab,bqn->eaqn", A[:, :, i, :, k], self.rise)
                K[:, :, i, :, k] = flat.T @ mixed.reshape(len(X), -1, n)
        r = -np.einsum("eqia,aqn->eni", P, self.rise)
        r += factor * np.einsum("eq,qn,i->eni", weight, self.basis, np.array(self.loads.body))
        self._push(c, X, local, factor, K, r)
        return K.reshape(len(X), 2 * n, 2 * n), r.reshape(len(X), 2 * n)

    def _push(self, c: int, X: Floats, local: Floats, factor: float, K: Floats, r: Floats) -> None:
        """Add what acts on the sides of a column."""
        p = self.p
        grid = np.arange((p + 1) ** 2).reshape(p + 1, p + 1)
        # Nodes run counter-clockwise round the body.
        sides = {"far": grid[-1], "near": grid[0, ::-1], "top": grid[::-1, -1], "under": grid[:, 0]}
        rows = np.flatnonzero(self.is_solid[c])
        for name in {*self.loads.tractions, *self.loads.pressures}:
            nodes = sides[name]
            if name in ("far", "near"):
                is_there = c == (self.columns - 1 if name == "far" else 0)
                of = np.arange(len(rows) if is_there else 0)
            else:
                of = np.flatnonzero(rows == (self.rows - 1 if name == "top" else 0))
            for e in of:
                rest = self.slope @ X[e, nodes]
                if name in self.loads.tractions:
                    on = self.value.T @ (self.edge_weight * np.hypot(*rest.T))
                    r[e, nodes] += factor * np.outer(on, self.loads.tractions[name])
                if name in self.loads.pressures:
                    size = factor * self.loads.pressures[name]
                    t = (
                        rest
                        if self.strain is Strain.LINEAR
                        else rest + self.slope @ local[e, nodes]
                    )
                    # Outwards is (t_z, -t_x).
                    weighted = self.value * self.edge_weight[:, None]
                    r[e, nodes] -= size * weighted.T @ np.column_stack([t[:, 1], -t[:, 0]])
                    if self.strain is Strain.GREEN:
                        turn = size * weighted.T @ self.slope
                        K[e, nodes[:, None], 0, nodes, 1] += turn
                        K[e, nodes[:, None], 1, nodes, 0] -= turn
