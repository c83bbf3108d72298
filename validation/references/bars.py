"""Error bars of the truth: what they are made of, where there can be none, and their record.

Each part bounds one cause, and bounds add whatever their signs are: the whole is the sum of
discretisation (mesh and degree), algebra (what the equations are solved to), time (its step), and
of what one check adds by itself: reading (between the states or points that were sent) and stated
(the uncertainty of the number expected).

Geometry stands beside the whole. A case's truth solves the body that the case gives, which for a
curved shape is a polyhedron, and a candidate is given the same polyhedron: what the true surface
would change is no doubt in their comparison, and in the bar it would turn every verdict on a
curved body into "inconclusive" for what no candidate can help. It is reported beside the verdict,
and it counts where the truth is compared with a number of the true body: one that is published,
measured or in closed form.

Under a force on a single point no bar can hold: the displacement grows as 1 / r (Kelvin's
solution), and the square of its gradient cannot be integrated. Under linear strain integrals of the
displacement still have a limit, and so have stresses, the force on a tool and that of a support
elsewhere; the displacement of points, energies and changes of volume and area have none. Under
Green strain no solution is known, and nothing has one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.fingerprint import array_hash
from palpate.meshes.problem import Problem, Strain
from palpate.validation.metrics import CATALOGUE, Part
from palpate.validation.metrics.body import dead_force
from palpate.validation.states import State

# Error bars by metric (or `name_of_part`) and strain measure, relative to the metric's scale.
Bars = dict[tuple[str, Strain], float]

# Relative: what solves to 1e-10 of the forces may leave in a number.
NOISE = 1e-8
# Two grids only: Roache's factor of safety (ASME J. Fluids Eng. 116, 1994), with first order
# assumed, since clamped edges are singular; then GCI = 3 |f2 - f1| / (2^1 - 1).
SAFETY_FACTOR = 3.0
# P1 and P2 farther apart than this say nothing of how far P2 is from the limit.
FAR = 0.5
# Key of the parts in a file's provenance.
PARTS = "bar_parts"
# Key of the true surface that the case's mesh approximates.
GEOMETRY = "geometry"
_WORDS = {"discretisation": "mesh"}
# Fraction of the whole: a smaller part is not reported in a verdict.
_WORTH_REPORTING = 0.01
# Fraction of the largest nodal force: supports of a body in balance carry only rounding.
_NO_FORCE = 1e-6


@dataclass(frozen=True)
class BarParts:
    """Parts of one error bar, each >= 0, in one unit; infinite where a cause cannot be bounded.

    Attributes:
        discretisation: Error of the mesh and the degree of its elements.
        algebra: Error of equations solved to a tolerance.
        time: Error of the time step.
        geometry: Distance of the case's polyhedron from the true surface; not part of the whole.
        reading: Error of one comparison: reading between the points and times that were sent.
        stated: Error of one comparison: the expected number's own, as the case states it.

    >>> BarParts(discretisation=0.003, time=0.001, geometry=0.2).whole
    0.004
    """

    discretisation: float = 0.0
    algebra: float = 0.0
    time: float = 0.0
    geometry: float = 0.0
    reading: float = 0.0
    stated: float = 0.0

    @property
    def whole(self) -> float:
        """The sum of all but geometry."""
        return float(sum(value for name, value in vars(self).items() if name != "geometry"))

    def times(self, factor: float) -> BarParts:
        """The same in another unit; what is not there at all stays 0 in every one."""
        return BarParts(**{n: v * factor if v else 0.0 for n, v in vars(self).items()})

    def reported(self, *, with_geometry: bool = False) -> dict[str, float]:
        """The parts that are there, by name, the largest first."""
        present = {n: v for n, v in vars(self).items() if v and (with_geometry or n != "geometry")}
        return dict(sorted(present.items(), key=lambda item: -item[1]))

    def says(self, *, with_geometry: bool = False, times: float = 1.0, unit: str = "") -> str:
        """The parts that matter, in words, so many `times` and with a unit; empty of one only."""
        least = _WORTH_REPORTING * self.whole
        parts = [
            f"{_WORDS.get(n, n)} {times * v:.2g}{unit}"
            for n, v in self.reported(with_geometry=with_geometry).items()
            if v >= least or math.isinf(v)
        ]
        return ", ".join(parts) if len(parts) > 1 else ""


def of_statics(bar: float) -> BarParts:
    """A bar from meshes, which has what solving leaves in a number in it."""
    algebra = min(bar, NOISE)
    return BarParts(discretisation=math.inf if math.isinf(bar) else bar - algebra, algebra=algebra)


def with_bar(parts: BarParts, bar: float) -> BarParts:
    """Parts whose whole is a bar that was made infinite after them."""
    is_lost = math.isinf(bar) and math.isfinite(parts.whole)
    return dataclasses.replace(parts, discretisation=math.inf) if is_lost else parts


def as_record(parts: Mapping[tuple[str, Strain], BarParts]) -> dict[str, dict[str, float | None]]:
    """The parts for a file's provenance; infinity, which JSON does not have, is None."""
    return {
        f"{metric}|{strain}": {
            name: value if math.isfinite(value) else None
            for name, value in vars(one).items()
            if value
        }
        for (metric, strain), one in parts.items()
    }


def recorded(provenance: Mapping[str, Any], metric: str, strain: Strain, bar: float) -> BarParts:
    """The parts that a file records of a bar; without any, all of it is discretisation."""
    table = provenance.get(PARTS)
    row = table.get(f"{metric}|{strain}") if isinstance(table, Mapping) else None
    return read_row(row) or BarParts(discretisation=bar)


def read_row(row: Any) -> BarParts | None:
    """The parts in one row of a record that anybody may have written; None where it is none."""
    if not isinstance(row, Mapping):
        return None
    values = {name: math.inf if value is None else value for name, value in row.items()}
    names = {field.name for field in dataclasses.fields(BarParts)}
    are_sizes = all(
        isinstance(v, int | float) and not isinstance(v, bool) and v >= 0.0 for v in values.values()
    )
    return BarParts(**values) if are_sizes and values.keys() <= names else None


def saturated(apart: float) -> float:
    """Bar of P2 by its relative difference from P1 [-]; infinite where they are too far apart.

        |u2 - u| <= beta |u1 - u|   gives   |u2 - u| <= beta / (1 - beta) |u2 - u1|

    (R. E. Bank, R. K. Smith, SIAM J. Numer. Anal. 30, 1993), which is |u2 - u1| for beta = 1/2:
    half of the error must go when the degree is raised. Where the two are more than half apart that
    cannot be relied on.
    """
    return apart if apart <= FAR else math.inf


def has_point_forces(problem: Problem, state: State | None = None) -> bool:
    """Whether forces act on single points: loads, or supports without facets that carry any.

    Args:
        problem: The problem with its supports and loads.
        state: Where its nodal forces are known, supports of single points count only if they carry
            some; otherwise all of them do.
    """
    if any(isinstance(load, PointForce) for load in problem.loads):
        return True
    single = [support for support in problem.supports if not len(support.facets)]
    if not single or state is None or state.integrals is None:
        return bool(single)
    # Along its own directions alone: the point may lie on another support's or load's face as well.
    nodal = state.integrals.internal_force
    pushed = nodal - dead_force(problem)
    least = _NO_FORCE * np.linalg.norm(nodal, axis=1).max()
    return any(
        bool((np.abs(pushed[support.points] @ support.directions.T) > least).any())
        for support in single
    )


def has_limit(metric: str, strain: Strain) -> bool:
    """Whether a metric tends to anything under forces on points."""
    known = CATALOGUE.get(metric)
    return strain is Strain.LINEAR and known is not None and known.has_limit_at_points


def without_limits(
    problem: Problem, strain: Strain, bars: Mapping[str, float], state: State | None = None
) -> dict[str, float]:
    """Bars by metric, infinite where forces on points leave no limit; see `has_point_forces`."""
    if not has_point_forces(problem, state):
        return dict(bars)
    return {m: bar if has_limit(m, strain) else math.inf for m, bar in bars.items()}


def name_of_part(metric: str, part: Part) -> str:
    """Name of a part's metric among error bars: the same cells, the same name."""
    arrays = {
        "cells": np.sort(part.cells).astype(np.int64),
        "weights": part.weights,
        "support": np.array(-1 if part.support is None else part.support),
    }
    return f"{metric}@{array_hash('palpate part', arrays)[:12]}"
