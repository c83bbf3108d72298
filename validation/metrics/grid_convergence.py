"""The grid convergence index: how far the finest of three meshes may be from the limit.

1. observed order p from three solutions (Celik et al. 2008, step 3; Roache for a constant ratio);
2. Richardson's extrapolated value from the two finest;
3. error bar Fs |f1 - f2| / (r^p - 1), Fs = 1.25 for three meshes.

P. J. Roache, J. Fluids Eng. 116 (1994) 405-413. I. B. Celik et al., Procedure for Estimation and
Reporting of Uncertainty Due to Discretization in CFD Applications, J. Fluids Eng. 130 (2008)
078001. Pure arithmetic: the caller says what is a sequence. Solutions of degree 1, 2, 3 on one mesh
are not: their ratios of size have no meaning here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

from palpate.validation.metrics.difference import largest

SAFETY_FACTOR = 1.25
# Celik et al. ask for a ratio above 1.3; below, noise drowns the order.
SMALLEST_RATIO = 1.3


class Convergence(StrEnum):
    """How a sequence of three solutions behaves."""

    MONOTONE = "monotone"
    BELOW_NOISE = "below noise"
    OSCILLATING = "oscillating"
    DIVERGING = "diverging"
    ORDER_OUT_OF_RANGE = "order out of range"


@dataclass(frozen=True)
class GridConvergence:
    """What three meshes say about a number, whose `value` is that on the finest.

    The observed `order` p [-] is None where there is none to observe; so is Richardson's
    `extrapolated` value. `error_bar` is the half-width around `value` in its unit, None where
    nothing can be concluded. `index_fine` is it over |f1| (GCI12) [-], `index_coarse` that of the
    two coarser meshes (GCI23); `asymptotic_ratio` GCI12 r^p / GCI23, near 1 in the asymptotic
    range.
    """

    value: float
    behaviour: Convergence
    order: float | None = None
    extrapolated: float | None = None
    error_bar: float | None = None
    index_fine: float | None = None
    index_coarse: float | None = None
    asymptotic_ratio: float | None = None


def assess_grid_convergence(
    values: Sequence[float],
    sizes: Sequence[float],
    *,
    expected_order: float,
    noise: float = 0.0,
    safety_factor: float = SAFETY_FACTOR,
) -> GridConvergence:
    """Assess a number computed on three meshes.

    Args:
        values: The number, finest mesh first, 3 finite values.
        sizes: Cell sizes in the same order, growing, each at least 1.3 times the one before.
        expected_order: Order of the discretisation for this number [-], > 0; an observed order
            below a quarter or above twice of it gives no error bar.
        noise: Differences up to this are rounding or solver tolerance, in the number's unit, >= 0.
        safety_factor: Fs [-], >= 1.

    Raises:
        ValueError: Values, sizes or an option out of range.
    """
    _require_usable(values, sizes, expected_order, noise, safety_factor)
    f1, f2, f3 = (float(v) for v in values)
    h1, h2, h3 = (float(h) for h in sizes)
    r21, r32 = h2 / h1, h3 / h2
    fine, coarse = f2 - f1, f3 - f2
    if abs(fine) <= noise and abs(coarse) <= noise:
        return GridConvergence(f1, Convergence.BELOW_NOISE, error_bar=safety_factor * noise)
    if fine * coarse <= 0.0:
        return GridConvergence(f1, Convergence.OSCILLATING)
    order = _observed_order(coarse / fine, r21, r32)
    if order is None or not order > 0.0:
        return GridConvergence(f1, Convergence.DIVERGING, order=order)
    extrapolated = f1 + (f1 - f2) / (r21**order - 1.0)
    bar_fine = safety_factor * abs(fine) / (r21**order - 1.0)
    bar_coarse = safety_factor * abs(coarse) / (r32**order - 1.0)
    is_believable = 0.25 * expected_order <= order <= 2.0 * expected_order
    index_fine = bar_fine / abs(f1) if f1 else None
    index_coarse = bar_coarse / abs(f2) if f2 else None
    return GridConvergence(
        value=f1,
        behaviour=Convergence.MONOTONE if is_believable else Convergence.ORDER_OUT_OF_RANGE,
        order=order,
        extrapolated=extrapolated,
        error_bar=largest((bar_fine, noise)) if is_believable else None,
        index_fine=index_fine,
        index_coarse=index_coarse,
        asymptotic_ratio=(
            index_fine * r21**order / index_coarse if index_fine and index_coarse else None
        ),
    )


def _require_usable(
    values: Sequence[float],
    sizes: Sequence[float],
    expected_order: float,
    noise: float,
    safety_factor: float,
) -> None:
    if len(values) != 3 or len(sizes) != 3:
        raise ValueError(f"need 3 values and 3 sizes, got {len(values)} and {len(sizes)}")
    if not all(math.isfinite(v) for v in (*values, *sizes)):
        raise ValueError(f"need finite values and sizes, got {list(values)}, {list(sizes)}")
    for small, large in pairwise(sizes):
        if not (small > 0.0 and large >= SMALLEST_RATIO * small * (1.0 - 1e-12)):
            raise ValueError(
                f"sizes {list(sizes)}: finest first, each at least {SMALLEST_RATIO} times the last"
            )
    if not (math.isfinite(expected_order) and expected_order > 0.0):
        raise ValueError(f"expected_order = {expected_order}: needs a value above 0")
    if not (math.isfinite(noise) and noise >= 0.0):
        raise ValueError(f"noise = {noise}: needs a value >= 0")
    if not (math.isfinite(safety_factor) and safety_factor >= 1.0):
        raise ValueError(f"safety_factor = {safety_factor}: needs a value >= 1")


def _observed_order(ratio: float, r21: float, r32: float) -> float | None:
    """Solve p ln r21 = ln ratio + ln((r21^p - 1) / (r32^p - 1)), ratio = (f3 - f2) / (f2 - f1).

    The same as (f3 - f2) / (f2 - f1) = r21^p (r32^p - 1) / (r21^p - 1): growing in p, with
    one root. None when there is none between 0.01 and 50.
    """
    if math.isclose(r21, r32, rel_tol=1e-12):
        return math.log(ratio) / math.log(r21)

    def excess(p: float) -> float:
        return math.log(r21**p * (r32**p - 1.0) / (r21**p - 1.0)) - math.log(ratio)

    from scipy.optimize import brentq

    low, high = 0.01, 50.0
    if excess(low) > 0.0 or excess(high) < 0.0:
        return None
    return float(brentq(excess, low, high, xtol=1e-14))
