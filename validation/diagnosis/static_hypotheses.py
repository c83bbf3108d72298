"""Hypotheses of a static result: each changes the equations, which are evaluated at the result.

Loads left out, doubled, reversed, scaled or not following; supports missing, incomplete, elsewhere
or too many; tools left out; another law or material. What is left of the changed equations at the
free components says how well a hypothesis fits: no reference is needed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Traction
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.explanation import (
    CONVERGED,
    OF_FORCE,
    OF_TOOL_FORCE,
    PRESSURE_FOLLOWS,
    PRESSURE_STAYS,
    SINGLE,
    Cause,
    Explanation,
    displacement_words,
    in_words,
    is_unit,
    load_name,
    snapped,
    stiffness_words,
)
from palpate.validation.exchange.nodal_arrays import facet_areas, lumped_mass, nodal_force
from palpate.validation.metrics.body import Body, Mask, imbalance, relative_to
from palpate.validation.metrics.smoothing import Array
from palpate.validation.states import State


class StaticResult:
    """The state of a static case on which every mistake is tried, `apart` from any reference.

    `internal`, that of each of `loads`, and `external` (with springs) are forces [N]; `miss` is the
    largest relative error of fixed components, `stated` the residual of the equations as stated.
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
        """The equations with a mistake in them; what is not given is as stated."""
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
    """Units where the factor is one that a mistake of units makes."""
    return Cause.UNITS if is_unit(factor) else otherwise


# Forces that differ by less cannot be distinguished.
_DEPENDENT = 1e-9
# Rows for each unknown: fewer, and a fit says nothing.
_ROWS_EACH = 5


def fit(columns: Sequence[Points], target: Points, rows: Mask) -> Points | None:
    """Factors c with the least |sum c_k column_k - target|^2 over these components.

    None where the columns are not independent there, or one vanishes.
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


# A much smaller displacement with a much larger stiffness is linear theory in disguise, but for
# strains of the factor's own size: such a pair has to fit better than that.
_BEYOND_SMALL = 1e-7
# The whole result in another unit beside another stiffness: lengths given in that unit.
_LENGTHS = (1e3, 1e-3, 100.0, 0.01, 1e6, 1e-6)


def load_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Each mistake of the loads, by the equations with that mistake in them."""
    body, loads = result.body, result.body.problem.loads
    for group, name in _groups(loads).items():
        mine, others = result.of_loads(group)
        found = fit([mine], result.internal - others, body.free)
        if found is None:
            continue
        factor, is_known = known_factor(float(found[0]))
        if len(group) == len(loads) and factor > 0.0:
            nu = body.problem.material.poissons_ratio
            words, cause = stiffness_words(1.0 / factor, nu), cause_of(factor, Cause.MATERIAL)
        else:
            is_one = len(group) == 1 or name.startswith("every")
            words = f"{name} {'' if is_one else 'all '}{in_words(factor)}"
            cause = cause_of(factor, Cause.LOAD)
            if factor == -1.0 and len(group) == 1 and group <= _pressures(loads):
                words = f"sign of the pressure reversed: {name} pulls"
        yield result.tried(words, cause, 1 if is_known else 2, external=others + factor * mine)
    yield from _following(result)
    for index, load in enumerate(loads):
        force = _equal_parts(body.mesh, load)
        if force is not None:
            words = f"{load_name(index, load)} shared equally between its points"
            _, others = result.of_loads(frozenset({index}))
            yield result.tried(words, Cause.LOAD, external=others + force)
        mean = _mean(body.mesh, load)
        if mean is not None:
            words = f"{load_name(index, load)} taken as uniform, at its mean"
            _, others = result.of_loads(frozenset({index}))
            yield result.tried(words, Cause.LOAD, external=others + nodal_force(body.mesh, mean))
    yield from _lengths(result)


def each_load_apart(result: StaticResult) -> Iterator[Explanation]:
    """A factor of its own for every load: only worth trying where nothing simpler fits."""
    loads = result.loads
    found = fit(loads, result.internal, result.body.free) if len(loads) > 1 else None
    if found is None:
        return
    factors = [known_factor(float(c))[0] for c in found]
    words = ", ".join(
        f"{load_name(k, load)} {in_words(c)}"
        for k, (load, c) in enumerate(zip(result.body.problem.loads, factors, strict=True))
        if c != 1.0
    )
    external = result.body.total([c * f for c, f in zip(factors, loads, strict=True)])
    yield result.tried(words, Cause.LOAD, 3, external=external)


# Loads of one direction, to this part of them, determine a turn but for one about themselves.
_ONE_DIRECTION = 1e-9


def turned_loads(result: StaticResult) -> Iterator[Explanation]:
    """Loads in another frame than the body, each or all: turned about one axis by one angle.

    The same equations hold where the internal forces are turned back: those of a body whose parent
    is turned, without that. A gravity that was not asked for is the last thing tried. Only worth
    trying where nothing simpler fits.
    """
    body = result.body
    rows = body.free.all(axis=1)
    tried = []
    for group, name in _groups(body.problem.loads).items():
        mine, others = result.of_loads(group)
        turn = turn_between(mine[rows], (result.internal - others)[rows])
        if turn is None:
            continue
        R, words = turn
        all_of = "" if len(group) == 1 or name.startswith("every") else "all "
        where = "gravity" if _is_body_force(body.problem.loads, group) else "a load"
        words = f"{name} {all_of}turned by {words}: {where} in another frame"
        if len(group) == len(body.problem.loads):
            words += ", or a parent's rotation left out"
        tried.append(result.tried(words, Cause.LOAD, 2, external=others + mine @ R.T))
    yield from tried
    if any(each.fits for each in tried):
        return
    mass = lumped_mass(body.problem)
    columns = [np.outer(mass, axis) for axis in np.eye(3)]
    g = fit(columns, result.internal - result.external, body.free)
    if g is not None:
        words = f"gravity of ({', '.join(f'{c:.5g}' for c in g)}) m/s2 that was not asked for"
        external = result.external + np.outer(mass, g)
        yield result.tried(words, Cause.LOAD, 3, external=external)


def _is_body_force(loads: tuple[Load, ...], group: frozenset[int]) -> bool:
    return all(isinstance(loads[k], BodyForce) for k in group)


def turn_between(vectors: Points, turned: Points) -> tuple[Array, str] | None:
    """The rotation R that brings vectors nearest to others, and in words; (num_vectors, 3) each.

    W. Kabsch, Acta Cryst. A 32, 1976; of vectors of one direction, the smallest such rotation. None
    where it is no turn, or half of one of a single direction, which is a reversal.
    """
    if not (np.isfinite(vectors).all() and np.isfinite(turned).all()) or not len(vectors):
        return None
    U, sizes, Vt = np.linalg.svd(vectors.T @ turned)
    if sizes[1] <= _ONE_DIRECTION * sizes[0]:
        a, b = U[:, 0], Vt[0]
        K = np.cross(np.eye(3), np.cross(a, b))  # K x = (a x b) x x
        if a @ b <= _ONE_DIRECTION - 1.0:
            return None
        R: Array = np.eye(3) + K + K @ K / (1.0 + a @ b)
    else:
        R = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, np.trace(R) - 1.0))
    if size <= _ONE_DIRECTION:
        if angle < 1.0:
            return None
        axis, size = np.linalg.eigh(R)[1][:, 2], 1.0  # half a turn: the axis stays
    x, y, z = np.round(axis / size, 3) + 0.0
    return R, f"{np.degrees(angle):.2f} degrees about ({x:g}, {y:g}, {z:g})"


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


def _following(result: StaticResult) -> Iterator[Explanation]:
    body, pressures = result.body, _pressures(result.body.problem.loads)
    if not pressures:
        return
    _, rest = result.of_loads(pressures)
    other = body.total([body.load(k, result.displacement, is_other=True) for k in pressures])
    name = PRESSURE_STAYS if body.follows else PRESSURE_FOLLOWS
    yield result.tried(name, Cause.LOAD, external=rest + other)
    words = f"{name}, and its sign is reversed"
    yield result.tried(words, Cause.LOAD, 2, external=rest - other)


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
    """A traction that varies at its mean everywhere; None where there is no such mistake."""
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


def _lengths(result: StaticResult) -> Iterator[Explanation]:
    """A result in another unit, with lengths in that unit or with another stiffness beside it."""
    for factor in _LENGTHS:
        smaller = StaticResult(result.body, result.displacement / factor)
        smaller.stated = result.stated
        # A mesh in that unit has areas, and so forces of stress and pressure, by its square.
        pressed, others = smaller.of_loads(_pressures(result.body.problem.loads))
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
        if not result.body.follows:
            # Another unit of the result is another stiffness there: tried beside the loads.
            continue
        found = fit([smaller.internal], smaller.external, result.body.free)
        known = None if found is None else snapped(float(found[0]))
        if known is None or known <= 0.0 or given.fits:
            continue
        words = displacement_words(factor)
        nu = result.body.problem.material.poissons_ratio
        words += "" if known == 1.0 else f", and {stiffness_words(known, nu)}"
        complexity, limit = (1, SINGLE) if known == 1.0 else (3, _BEYOND_SMALL)
        given = smaller.tried(words, Cause.UNITS, complexity, internal=known * smaller.internal)
        yield dataclasses.replace(given, limit=limit)


# Fixed components that are this far off, in parts of the largest displacement, are not fixed: in
# double precision, and in single.
_OFF = (1e-10, 1e-6)
# Free ones that move less are fixed.
_STILL = 1e-13
_AXES = "xyz"


def support_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Each mistake of the supports, by the equations with that mistake in them."""
    body, displacement = result.body, result.displacement
    largest = float(np.abs(displacement).max())
    apart = np.where(body.fixed, np.abs(displacement - body.prescribed), 0.0)
    tried = []
    for part in _OFF:
        # Components that are off carry no support's force; the others are where they belong.
        off = apart > part * largest
        miss = relative_to(float(apart[~off].max(initial=0.0)), largest)
        name, is_plain = _released_words(body, off)
        complexity = 1 if is_plain else 2
        tried.append(result.tried(name, Cause.SUPPORT, complexity, rows=body.free | off, miss=miss))
    if body.prescribed.any():
        asked = body.prescribed[body.fixed]
        factor = float(displacement[body.fixed] @ asked / (asked @ asked))
        factor, is_known = known_factor(factor)
        left = np.abs(displacement - factor * body.prescribed)[body.fixed].max(initial=0.0)
        name, cause = f"prescribed displacement {in_words(factor)}", cause_of(factor, Cause.SUPPORT)
        complexity = 1 if is_known else 2
        tried.append(result.tried(name, cause, complexity, miss=relative_to(float(left), largest)))
    yield from tried
    if not any(each.fits for each in tried):
        name = "fixed points are fixed at other positions"
        yield result.tried(name, Cause.SUPPORT, 3, miss=0.0)
    # Components that are fixed and should be free.
    still = body.free & (np.abs(displacement) <= _STILL * largest)
    if still.any() and still.sum() < 0.5 * body.free.sum():
        name = _overfixed_words(body, still)
        yield result.tried(name, Cause.SUPPORT, 2, rows=body.free & ~still)


def _released_words(body: Body, off: Mask) -> tuple[str, bool]:
    """Which supports are not fixed, and whether it is whole ones or whole components."""
    parts, plain = [], True
    for number, support in enumerate(body.problem.supports, start=1):
        if support.normal is not None:
            continue
        mine = np.zeros_like(off)
        mine[np.ix_(support.points, np.flatnonzero(support.components))] = True
        missing = mine & off
        if not missing.any():
            continue
        name = f"support {number}"
        axes = np.flatnonzero(missing.any(axis=0))
        whole = all(missing[:, k].sum() > 0.9 * mine[:, k].sum() for k in axes)
        if whole and len(axes) == sum(support.components):
            parts.append(f"{name} is not fixed")
        elif whole:
            parts.append(f"{name} does not fix {' and '.join(_AXES[k] for k in axes)}")
        else:
            plain = False
            count = int(missing.any(axis=1).sum())
            parts.append(
                f"{name} is fixed in part: {count} of its {len(support.points)} points are not "
                "fixed"
            )
    return ", ".join(parts) or "a support is not fixed", plain and len(parts) == 1


def _overfixed_words(body: Body, still: Mask) -> str:
    for number, support in enumerate(body.problem.supports, start=1):
        mine = np.zeros_like(still)
        mine[support.points] = True
        if not all(support.components) and not (still & ~mine).any():
            axes = " and ".join(_AXES[k] for k in np.flatnonzero(still.any(axis=0)))
            return f"support {number} fixes {axes} as well"
    return f"{int(still.any(axis=1).sum())} points are fixed that should be free"


def tool_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Equilibrium without the tools, where they could touch as well.

    How far it is from the reference is what has to be explained: equilibrium elsewhere does not
    see the tools.
    """
    if not result.body.problem.tools or result.apart is None:
        return
    found = result.tried("tools left out: nothing touches", Cause.TOOL, rows=~result.body.fixed)
    yield replace(found, stated=result.apart)


def tool_force_hypotheses(candidate: State, reference: State) -> Iterator[Explanation]:
    """Forces of the tools where the displacement is right: their sign, unit, or the stiffness."""
    ours, theirs = candidate.tool_forces, reference.tool_forces
    if ours is None or theirs is None or ours.shape != theirs.shape or not theirs.any():
        return
    scale = float(np.linalg.norm(theirs, axis=-1).max())
    stated = float(np.linalg.norm(ours - theirs, axis=-1).max()) / scale
    apart = float(np.abs(candidate.displacement - reference.displacement).max())
    if apart > CONVERGED * reference.max_displacement:
        return
    factor, is_known = known_factor(float((ours * theirs).sum()) / float((theirs**2).sum()))
    if factor == 0.0:
        return
    left = float(np.linalg.norm(ours / factor - theirs, axis=-1).max()) / scale
    name = f"force on the tools {in_words(factor)}"
    if factor > 0.0:
        name += ": the stiffness, or the unit of force"
    cause, complexity = cause_of(factor, Cause.MATERIAL), 1 if is_known else 2
    yield Explanation(name, cause, left, stated, OF_TOOL_FORCE, complexity)
