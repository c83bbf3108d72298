"""Slips in the loads of a static case: left out, doubled, reversed, scaled, not following."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Traction
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.diagnosis.body import PRESSURE_FOLLOWS, PRESSURE_STAYS, Body, load_name
from palpate.validation.diagnosis.explanation import OF_FORCE, SINGLE, Cause, Explanation
from palpate.validation.diagnosis.factors import (
    displacement_words,
    in_words,
    is_unit,
    snapped,
    stiffness_words,
)
from palpate.validation.diagnosis.fitted import fit
from palpate.validation.exchange.nodal_loads import facet_areas

# A much smaller displacement with a much larger stiffness is linear theory in disguise, but for
# strains of the factor's own size: such a pair has to fit better than that.
_BEYOND_SMALL = 1e-7
# The whole answer in another unit beside another stiffness: lengths given in that unit.
_LENGTHS = (1e3, 1e-3, 100.0, 0.01, 1e6, 1e-6)


def load_explanations(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """Each slip of the loads, by the equations with that slip in them."""
    internal = body.internal(displacement)
    loads = body.loads(displacement)
    miss = body.miss(displacement)

    def tried(name: str, cause: Cause, external: Points, complexity: int = 1) -> Explanation:
        left = max(body.residual(displacement, internal, external), miss)
        return Explanation(name, cause, left, stated, OF_FORCE, complexity)

    for group, name in _groups(body).items():
        others = body.total([f for k, f in enumerate(loads) if k not in group])
        mine = body.total([loads[k] for k in group])
        found = fit([mine], internal - others, body.free)
        if found is None:
            continue
        factor = float(found[0])
        known = snapped(factor)
        factor = factor if known is None else known
        complexity = 1 if known is not None else 2
        if len(group) == len(loads) and factor > 0.0:
            words = stiffness_words(1.0 / factor)
            cause = Cause.UNITS if is_unit(factor) else Cause.MATERIAL
        else:
            is_one = len(group) == 1 or name.startswith("every")
            words = f"{name} {'' if is_one else 'all '}{in_words(factor)}"
            cause = Cause.UNITS if is_unit(factor) else Cause.LOAD
            if factor == -1.0 and len(group) == 1 and _is_pressure(body, group):
                words = f"sign of the pressure reversed: {name} pulls"
        yield tried(words, cause, others + factor * mine, complexity)
    yield from _following(body, displacement, internal, loads, stated)
    for index, load in enumerate(body.problem.loads):
        shares = _equal_shares(body, index)
        if shares is not None:
            others = body.total([f for k, f in enumerate(loads) if k != index])
            words = f"{load_name(index, load)} shared equally between its points"
            yield tried(words, Cause.LOAD, others + shares)
    yield from _lengths(body, displacement, stated)


def each_load_apart(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """A factor of its own for every load: only worth trying where nothing simpler fits."""
    loads = body.loads(displacement)
    internal = body.internal(displacement)
    found = fit(loads, internal, body.free) if len(loads) > 1 else None
    if found is None:
        return
    factors = [float(c) if snapped(c) is None else snapped(c) or 0.0 for c in found]
    words = ", ".join(
        f"{load_name(k, load)} {in_words(c)}"
        for k, (load, c) in enumerate(zip(body.problem.loads, factors, strict=True))
        if c != 1.0
    )
    external = body.total([c * f for c, f in zip(factors, loads, strict=True)])
    left = body.residual(displacement, internal, external)
    yield Explanation(words, Cause.LOAD, left, stated, OF_FORCE, 3)


def _groups(body: Body) -> dict[frozenset[int], str]:
    """Loads that may have been treated alike, each group once, the smallest first."""
    loads = body.problem.loads
    groups = {frozenset({k}): load_name(k, load) for k, load in enumerate(loads)}
    pressures = frozenset(k for k, load in enumerate(loads) if isinstance(load, Pressure))
    dead = frozenset(range(len(loads))) - pressures
    groups.setdefault(pressures, "pressures")
    groups.setdefault(dead, "dead loads (external_force)")
    groups.setdefault(frozenset(range(len(loads))), "every load")
    groups.pop(frozenset(), None)
    return groups


def _is_pressure(body: Body, group: frozenset[int]) -> bool:
    return all(isinstance(body.problem.loads[k], Pressure) for k in group)


def _following(
    body: Body, displacement: Points, internal: Points, loads: list[Points], stated: float
) -> Iterator[Explanation]:
    pressures = [k for k, load in enumerate(body.problem.loads) if isinstance(load, Pressure)]
    if not pressures:
        return
    rest = body.total([f for k, f in enumerate(loads) if k not in pressures])
    other = body.total([body.load(k, displacement, is_other=True) for k in pressures])
    name = PRESSURE_STAYS if body.follows else PRESSURE_FOLLOWS
    for words, external, complexity in (
        (name, rest + other, 1),
        (f"{name}, and its sign is reversed", rest - other, 2),
    ):
        left = body.residual(displacement, internal, external)
        yield Explanation(words, Cause.LOAD, left, stated, OF_FORCE, complexity)


def _equal_shares(body: Body, index: int) -> Points | None:
    """The load's total in equal parts at each of its points, whatever their area or volume."""
    load, mesh = body.problem.loads[index], body.mesh
    force = np.zeros_like(mesh.points)
    if isinstance(load, Traction):
        points = np.unique(load.facets)
        total = facet_areas(mesh.points, load.facets).sum() * np.array(load.traction)
    elif isinstance(load, BodyForce):
        points = np.arange(mesh.num_points)
        total = signed_volumes(mesh.points, mesh.cells).sum() * np.array(load.force_density)
    else:
        return None
    force[points] = total / len(points)
    return force


def _lengths(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """An answer in another unit, with lengths in that unit or with another stiffness beside it."""
    loads = body.problem.loads
    for factor in _LENGTHS:
        smaller = displacement / factor
        internal, forces = body.internal(smaller), body.loads(smaller)
        external, miss = body.total(forces), body.miss(smaller)

        def tried(
            words: str,
            inner: Points,
            outer: Points,
            complexity: int,
            miss: float = miss,
            smaller: Points = smaller,
        ) -> Explanation:
            left = max(body.residual(smaller, inner, outer), miss)
            return Explanation(words, Cause.UNITS, left, stated, OF_FORCE, complexity)

        answer = displacement_words(factor)
        # A mesh in that unit has areas, and so forces of stress and pressure, by its square.
        areas = [
            factor**2 * f if isinstance(load, Pressure) else f
            for load, f in zip(loads, forces, strict=True)
        ]
        given = tried(
            f"lengths given {in_words(factor)}, the displacement with them; forces and stresses "
            "as they are",
            factor**2 * internal,
            body.total(areas),
            2,
        )
        if external.any():
            yield given
        if body.strain is Strain.LINEAR:
            # Another unit of the answer is another stiffness there: tried beside the loads.
            continue
        found = fit([internal], external, body.free)
        known = None if found is None else snapped(float(found[0]))
        if known is None or known <= 0.0 or given.fits:
            continue
        words = answer if known == 1.0 else f"{answer}, and {stiffness_words(known)}"
        given = tried(words, known * internal, external, 1 if known == 1.0 else 3)
        yield dataclasses.replace(given, limit=SINGLE if known == 1.0 else _BEYOND_SMALL)
