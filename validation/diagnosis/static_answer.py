"""A static answer, and what it leaves of the equations, as stated or with a slip in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.explanation import OF_FORCE, Cause, Explanation
from palpate.validation.diagnosis.factors import is_unit, snapped
from palpate.validation.metrics.body import Body, Mask, imbalance


class StaticAnswer:
    """What every slip of a static case is tried on.

    Attributes:
        body: Of the problem as stated.
        displacement: The candidate's [m].
        apart: Its distance from the reference; None where there is no reference.
        internal: Its internal force [N].
        loads: The force of each load [N].
        external: Their sum, and that of springs.
        miss: How far held components are off.
        stated: What is left of the equations as stated.
    """

    def __init__(self, body: Body, displacement: Points, apart: float | None = None) -> None:
        self.body, self.displacement, self.apart = body, displacement, apart
        self.internal = body.internal(displacement)
        self.loads = body.loads(displacement)
        self.external = body.total(self.loads) + body.pull_of_springs(displacement)
        self.miss = body.miss(displacement)
        self.stated = self._left(self.internal, self.external, body.free, self.miss)

    def _left(self, internal: Points, external: Points, rows: Mask, miss: float) -> float:
        return max(imbalance(internal, external, rows), miss)

    def tried(
        self,
        name: str,
        cause: Cause,
        complexity: int = 1,
        *,
        internal: Points | None = None,
        external: Points | None = None,
        rows: Mask | None = None,
        miss: float | None = None,
    ) -> Explanation:
        """The equations with a slip in them: what is not given is as stated."""
        left = self._left(
            self.internal if internal is None else internal,
            self.external if external is None else external,
            self.body.free if rows is None else rows,
            self.miss if miss is None else miss,
        )
        return Explanation(name, cause, left, self.stated, OF_FORCE, complexity)

    def of_loads(self, indices: frozenset[int]) -> tuple[Points, Points]:
        """Sum of these loads, and of the others [N]."""
        mine = [f for k, f in enumerate(self.loads) if k in indices]
        others = [f for k, f in enumerate(self.loads) if k not in indices]
        return self.body.total(mine), self.body.total(others)


def known_factor(factor: float) -> tuple[float, bool]:
    """A factor that was found, as the known one that it is, and whether it is one."""
    known = snapped(factor)
    return (factor, False) if known is None else (known, True)


def cause_of(factor: float, otherwise: Cause) -> Cause:
    """Units where the factor is one that a slip of units makes."""
    return Cause.UNITS if is_unit(factor) else otherwise


# Forces that differ by less cannot be told apart.
_DEPENDENT = 1e-9
# Rows for each unknown: fewer, and a fit says nothing.
_ROWS_EACH = 5


def fit(columns: Sequence[Points], target: Points, rows: Mask) -> Points | None:
    """Factors c with the least |sum c_k column_k - target|^2 over these components.

    Returns:
        (len(columns),); None where the columns cannot be told apart there, or one vanishes.
    """
    matrix = np.stack([column[rows] for column in columns], axis=1)
    wanted = target[rows]
    if not (np.isfinite(matrix).all() and np.isfinite(wanted).all()):
        return None
    sizes = np.abs(matrix).max(axis=0, initial=0.0)
    if len(matrix) < _ROWS_EACH * len(columns) or not (sizes > 0.0).all():
        return None
    factors, _, rank, _ = np.linalg.lstsq(matrix / sizes, wanted, rcond=_DEPENDENT)
    if rank < len(columns):
        return None
    found: Points = factors / sizes
    return found
