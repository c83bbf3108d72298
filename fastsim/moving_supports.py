"""Supports of an explicit run: what moves and how, in the terms of the core."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.amplitudes import Histories
from palpate.fastsim.supports import HeldPoints, SlantedPoints, turning
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem


class MovingSupports:
    """What supports do over time, as the core takes it: sums of factors times values.

    Args:
        problem: Its supports.
        supports: What they hold.
        histories: Their factors over time.

    Attributes:
        is_free: 1 where free along x, y or z, shape (num_points, 3); points that slide are free.
        slides: Points that slide along one or two slanted walls, with their directions (n, 6),
            where they are held along these (n, 2) and the histories (n, 2), -1 for none; None
            where nothing slides.

    Raises:
        InputError: A component that two supports move in different ways.
    """

    def __init__(self, problem: Problem, supports: HeldPoints, histories: Histories) -> None:
        self._problem, self._supports, self._histories = problem, supports, histories
        full = supports.at(1.0)
        self._require_one_way(full)
        self.is_free = supports.is_free.copy()
        self._values = [np.zeros_like(full) for _ in range(3)]
        self._numbers = [np.full(full.shape, -1, dtype=np.int32) for _ in range(3)]
        for number, support in enumerate(problem.supports):
            mine = supports.held_by(number)
            points = np.flatnonzero(mine.any(axis=1))
            fields = [(np.broadcast_to(support.displacement, (len(points), 3)), 0)]
            if support.rotation is not None:
                across, inward = turning(support.rotation, problem.mesh.points[points])
                fields += [(across, 1), (inward, 2)]
            for field, term in fields:
                self._add(term, points, mine[points], field, self._history(number, term))
        self.slides: tuple[NDArray[np.int32], Floats, Floats, NDArray[np.int32]] | None = None
        if supports.slanted is not None:
            self._add_slanted(supports.slanted, full)

    def terms(self) -> tuple[Points, NDArray[np.int32]]:
        """Values and histories of each term, one below the other; one where one will do."""
        count = 1 + max((k for k in (1, 2) if (self._numbers[k] >= 0).any()), default=0)
        return np.vstack(self._values[:count]), np.vstack(self._numbers[:count])

    def _history(self, support: int, term: int) -> int:
        if term == 0:
            return self._histories.of_support[support]
        turns = self._histories.of_turn[support]
        assert turns is not None
        return turns[term - 1]

    def _add(
        self, term: int, points: Indices, mine: NDArray[np.bool_], values: Points, history: int
    ) -> None:
        # What is held at zero never moves, whatever its factor: nothing to step.
        moves = mine & (values != 0.0)
        self._values[term][points] = np.where(moves, values, self._values[term][points])
        self._numbers[term][points] = np.where(moves, history, self._numbers[term][points])

    def _add_slanted(self, slanted: SlantedPoints, full: Points) -> None:
        """Points held along all directions move as others do; the rest slide."""
        history = np.array([self._history_of(slanted, k) for k in range(len(slanted.points))])
        whole = slanted.rank == 3
        points = slanted.points[whole]
        self.is_free[slanted.points] = ~whole[:, None]
        values = self._supports.to_global(full)[points]
        everywhere = np.ones(3, dtype=bool)
        for point, value, number in zip(points, values, history[whole], strict=True):
            self._add(0, np.array([point]), everywhere[None], value[None], int(number))
        rows = ~whole
        held = np.arange(2) < slanted.rank[rows, None]
        self.slides = (
            np.ascontiguousarray(slanted.points[rows]),
            np.ascontiguousarray(slanted.axes[rows, :2].reshape(-1, 6)),
            np.ascontiguousarray(np.where(held, full[slanted.points[rows], :2], 0.0)),
            np.where(held, history[rows, None], -1).astype(np.int32),
        )

    def _history_of(self, slanted: SlantedPoints, k: int) -> int:
        """The one history by which a slanted point's supports move it; 0 where none does."""
        supports = [int(s) for s in slanted.supports[k] if s >= 0]
        moving = {s for s in supports if self._problem.supports[s].is_moved}
        found = {self._histories.of_support[s] for s in moving}
        is_turned = any(self._problem.supports[s].rotation is not None for s in moving)
        if len(found) > 1 or is_turned:
            raise InputError(
                f"point {int(slanted.points[k])} is held along a slanted normal and by a support "
                "that turns or has another amplitude; separate the supports"
            )
        return found.pop() if found else 0

    def _require_one_way(self, full: Points) -> None:
        """A component that two supports move goes by one amplitude and one rotation."""
        by = np.full(full.shape, -1)
        supports = self._problem.supports
        keys = [
            (history, support.rotation)
            for history, support in zip(self._histories.of_support, supports, strict=True)
        ]
        kinds = [keys.index(key) for key in keys]
        for support, kind in zip(supports, kinds, strict=True):
            points = support.points
            for axis in np.flatnonzero(support.components) if support.normal is None else ():
                clash = points[(by[points, axis] >= 0) & (by[points, axis] != kind)]
                clash = clash[full[clash, axis] != 0.0]
                if clash.size:
                    raise InputError(
                        f"point {int(clash[0])} is held along {'xyz'[axis]} by two supports with "
                        "different amplitudes; separate the supports"
                    )
                by[points, axis] = kind
