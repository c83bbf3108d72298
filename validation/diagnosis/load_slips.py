"""Slips in the loads of a static case: left out, doubled, reversed, scaled, not following."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Traction
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.explanation import SINGLE, Cause, Explanation
from palpate.validation.diagnosis.factors import (
    PRESSURE_FOLLOWS,
    PRESSURE_STAYS,
    displacement_words,
    in_words,
    load_name,
    snapped,
    stiffness_words,
)
from palpate.validation.diagnosis.static_answer import StaticAnswer, cause_of, fit, known_factor
from palpate.validation.exchange.nodal_arrays import facet_areas, nodal_force

# A much smaller displacement with a much larger stiffness is linear theory in disguise, but for
# strains of the factor's own size: such a pair has to fit better than that.
_BEYOND_SMALL = 1e-7
# The whole answer in another unit beside another stiffness: lengths given in that unit.
_LENGTHS = (1e3, 1e-3, 100.0, 0.01, 1e6, 1e-6)


def load_explanations(answer: StaticAnswer) -> Iterator[Explanation]:
    """Each slip of the loads, by the equations with that slip in them."""
    body, loads = answer.body, answer.body.problem.loads
    for group, name in _groups(loads).items():
        mine, others = answer.of_loads(group)
        found = fit([mine], answer.internal - others, body.free)
        if found is None:
            continue
        factor, is_known = known_factor(float(found[0]))
        if len(group) == len(loads) and factor > 0.0:
            words, cause = stiffness_words(1.0 / factor), cause_of(factor, Cause.MATERIAL)
        else:
            is_one = len(group) == 1 or name.startswith("every")
            words = f"{name} {'' if is_one else 'all '}{in_words(factor)}"
            cause = cause_of(factor, Cause.LOAD)
            if factor == -1.0 and len(group) == 1 and group <= _pressures(loads):
                words = f"sign of the pressure reversed: {name} pulls"
        yield answer.tried(words, cause, 1 if is_known else 2, external=others + factor * mine)
    yield from _following(answer)
    for index, load in enumerate(loads):
        force = _equal_parts(body.mesh, load)
        if force is not None:
            words = f"{load_name(index, load)} shared equally between its points"
            _, others = answer.of_loads(frozenset({index}))
            yield answer.tried(words, Cause.LOAD, external=others + force)
        mean = _mean(body.mesh, load)
        if mean is not None:
            words = f"{load_name(index, load)} taken as uniform, at its mean"
            _, others = answer.of_loads(frozenset({index}))
            yield answer.tried(words, Cause.LOAD, external=others + nodal_force(body.mesh, mean))
    yield from _lengths(answer)


def each_load_apart(answer: StaticAnswer) -> Iterator[Explanation]:
    """A factor of its own for every load: only worth trying where nothing simpler fits."""
    loads = answer.loads
    found = fit(loads, answer.internal, answer.body.free) if len(loads) > 1 else None
    if found is None:
        return
    factors = [known_factor(float(c))[0] for c in found]
    words = ", ".join(
        f"{load_name(k, load)} {in_words(c)}"
        for k, (load, c) in enumerate(zip(answer.body.problem.loads, factors, strict=True))
        if c != 1.0
    )
    external = answer.body.total([c * f for c, f in zip(factors, loads, strict=True)])
    yield answer.tried(words, Cause.LOAD, 3, external=external)


def _pressures(loads: tuple[Load, ...]) -> frozenset[int]:
    return frozenset(k for k, load in enumerate(loads) if isinstance(load, Pressure))


def _groups(loads: tuple[Load, ...]) -> dict[frozenset[int], str]:
    """Loads that may have been treated alike, each group once, the smallest first."""
    groups = {frozenset({k}): load_name(k, load) for k, load in enumerate(loads)}
    every, pressures = frozenset(range(len(loads))), _pressures(loads)
    groups.setdefault(pressures, "pressures")
    groups.setdefault(every - pressures, "dead loads (external_force)")
    groups.setdefault(every, "every load")
    groups.pop(frozenset(), None)
    return groups


def _following(answer: StaticAnswer) -> Iterator[Explanation]:
    body, pressures = answer.body, _pressures(answer.body.problem.loads)
    if not pressures:
        return
    _, rest = answer.of_loads(pressures)
    other = body.total([body.load(k, answer.displacement, is_other=True) for k in pressures])
    name = PRESSURE_STAYS if body.follows else PRESSURE_FOLLOWS
    yield answer.tried(name, Cause.LOAD, external=rest + other)
    words = f"{name}, and its sign is reversed"
    yield answer.tried(words, Cause.LOAD, 2, external=rest - other)


def _equal_parts(mesh: TetMesh, load: Load) -> Points | None:
    """The load's total in equal parts at each of its points, whatever their area or volume."""
    force = np.zeros_like(mesh.points)
    match load:
        case Traction():
            points = np.unique(load.facets)
            resultant = _resultant(mesh, load)
            if resultant is None:
                return None
            total = resultant
        case BodyForce():
            points = np.arange(mesh.num_points)
            total = mesh.volume * np.array(load.force_density)
        case _:
            return None
    force[points] = total / len(points)
    return force


def _mean(mesh: TetMesh, load: Load) -> Traction | None:
    """A traction that varies at its mean everywhere; None where there is no such slip."""
    if not isinstance(load, Traction) or load.is_uniform:
        return None
    total = _resultant(mesh, load)
    if total is None:
        return None
    x, y, z = (total / facet_areas(mesh.points, load.facets).sum()).tolist()
    return Traction(load.facets, (x, y, z))


def _resultant(mesh: TetMesh, load: Traction) -> Points | None:
    """A traction's force in all [N]; None of a moment, whose force is zero but for rounding."""
    force = nodal_force(mesh, load)
    total: Points = force.sum(axis=0)
    return total if np.abs(total).max() > 1e-12 * np.abs(force).sum() else None


def _lengths(answer: StaticAnswer) -> Iterator[Explanation]:
    """An answer in another unit, with lengths in that unit or with another stiffness beside it."""
    for factor in _LENGTHS:
        smaller = StaticAnswer(answer.body, answer.displacement / factor)
        smaller.stated = answer.stated
        # A mesh in that unit has areas, and so forces of stress and pressure, by its square.
        pressed, others = smaller.of_loads(_pressures(answer.body.problem.loads))
        given = smaller.tried(
            f"lengths given {in_words(factor)}, the displacement with them; forces and stresses "
            "as they are",
            Cause.UNITS,
            2,
            internal=factor**2 * smaller.internal,
            external=factor**2 * pressed + others,
        )
        if smaller.external.any():
            yield given
        if not answer.body.follows:
            # Another unit of the answer is another stiffness there: tried beside the loads.
            continue
        found = fit([smaller.internal], smaller.external, answer.body.free)
        known = None if found is None else snapped(float(found[0]))
        if known is None or known <= 0.0 or given.fits:
            continue
        words = displacement_words(factor)
        words += "" if known == 1.0 else f", and {stiffness_words(known)}"
        complexity, limit = (1, SINGLE) if known == 1.0 else (3, _BEYOND_SMALL)
        given = smaller.tried(words, Cause.UNITS, complexity, internal=known * smaller.internal)
        yield dataclasses.replace(given, limit=limit)
