"""Bodies in plane strain by polynomials of high degree, on quadrilaterals graded to every corner.

Galerkin's method in two dimensions: tensor products of degree p on a grid of quadrilaterals whose
sizes fall geometrically towards the lines on which corners lie. With p and the layers raised
together the error falls exponentially, singular corners or not (I. Babuska, B. Q. Guo, SIAM J.
Numer. Anal. 25, 1988), so that what one more rise changes says how well an answer is known.

Hooke's law, or with finite strain by Newton's method Saint-Venant-Kirchhoff's (eq. 6-7) or the
stable neo-Hookean one. Strains grow without bound towards a clamped corner; where it is pressed the
first gives way there, and free surfaces of the second crease (M. A. Biot, Appl. Sci. Res. A 12,
1963): grids fine enough to see it find no equilibrium, or another one. Smaller loads put it farther
in. Nothing is shared with the reference: the linear systems are solved element by element, then
from one column of elements to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration_recipe.plane_grid import (
    Section,
    graded,
    lagrange,
    lobatto,
)
from calibration_recipe.plane_laws import stress_of
from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Material, Strain

_MOST_ITERATIONS, _SMALLEST_STEP = 20, 0.1
_CONVERGED = 1e-11
# No component of the displacement's gradient changes by more in a step of Newton's method.
_STEEPEST = 0.3


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
        inner = np.zeros((p + 1, p + 1), dtype=bool)
        inner[1:-1, 1:-1] = True
        self._inner = np.flatnonzero(np.repeat(inner.ravel(), 2))
        self._outer = np.flatnonzero(np.repeat(~inner.ravel(), 2))

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
        p, M = self.p, self.rows * self.p + 1
        first = 2 * (M + (self.rows + 1) * (p - 1))
        carried, right = np.zeros((2 * M, 2 * M)), np.zeros(2 * M)
        kept = []
        for c in range(self.columns):
            K, r = self._elements(c, u, factor)
            held = self._local(self.is_held.astype(np.float64), c).reshape(len(K), -1) > 0.0
            r -= np.einsum("eij,ej->ei", K, self._local(jump, c).reshape(len(K), -1))
            r[held] = 0.0
            K *= ~held[:, :, None] & ~held[:, None, :]
            i, o = self._inner, self._outer
            both = np.concatenate([K[:, i][:, :, o], r[:, i, None]], axis=2)
            inner = np.linalg.solve(K[:, i][:, :, i], both)
            schur = np.concatenate([K[:, o][:, :, o], r[:, o, None]], axis=2)
            schur -= K[:, o][:, :, i] @ inner
            A, b = np.zeros((first + 2 * M, first + 2 * M)), np.zeros(first + 2 * M)
            numbers = self._numbers(c)
            for at, part in zip(numbers, schur, strict=True):
                A[np.ix_(at, at)] += part[:, :-1]
                b[at] += part[:, -1]
            A[: 2 * M, : 2 * M] += carried
            b[: 2 * M] += right
            _fill(A[:first, :first])
            both = np.column_stack([A[:first, first:], b[:first]])
            solved = np.linalg.solve(A[:first, :first], both)
            below = A[first:, :first]
            carried = A[first:, first:] - below @ solved[:, :-1]
            right = b[first:] - below @ solved[:, -1]
            kept.append((inner, numbers, solved))
        _fill(carried)
        line = np.linalg.solve(carried, right)
        change = jump.copy()
        for c in reversed(range(self.columns)):
            inner, numbers, solved = kept[c]
            x = np.append(solved[:, -1] - solved[:, :-1] @ line, line)
            for e, row in enumerate(np.flatnonzero(self.is_solid[c])):
                local = np.zeros(2 * (p + 1) ** 2)
                local[self._outer] = outer = x[numbers[e]]
                local[self._inner] = inner[e, :, -1] - inner[e, :, :-1] @ outer
                block = (slice(c * p, (c + 1) * p + 1), slice(row * p, (row + 1) * p + 1))
                moved = local.reshape(p + 1, p + 1, 2)
                change[block] = np.where(self.is_held[block], jump[block], moved)
            line = x[: 2 * M]
        return change

    def _numbers(self, c: int) -> NDArray[np.intp]:
        """Of the outer unknowns of a column's elements: left line, rungs, right line."""
        p, M = self.p, self.rows * self.p + 1
        i, j = np.divmod(np.arange((p + 1) ** 2), p + 1)
        numbers = []
        for row in np.flatnonzero(self.is_solid[c]):
            rung = M + (row + j // p) * (p - 1) + i - 1
            z = row * p + j
            node = np.where(i == 0, z, np.where(i == p, M + (self.rows + 1) * (p - 1) + z, rung))
            numbers.append(np.stack([2 * node, 2 * node + 1], axis=1).ravel()[self._outer])
        return np.array(numbers).reshape(-1, len(self._outer))

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


def _fill(A: Floats) -> None:
    """One on the diagonal of unknowns that no element has, or that are held."""
    empty = np.flatnonzero(~A.any(axis=1))
    A[empty, empty] = 1.0
