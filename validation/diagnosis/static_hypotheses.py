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
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material
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
from palpate.validation.exchange.nodal_arrays import facet_areas, nodal_force
from palpate.validation.metrics.body import Body, Mask, imbalance, relative_to
from palpate.validation.metrics.laws import (
    OTHER_STRAIN,
    hooke,
    laws_instead_of_law,
    mistaken_constants,
    push_forward,
    strain_of,
)
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
            words, cause = stiffness_words(1.0 / factor), cause_of(factor, Cause.MATERIAL)
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
        words += "" if known == 1.0 else f", and {stiffness_words(known)}"
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


# A constant that differs by less from what was asked is said to be right.
_SAME = 1e-5
# A factor of one of Lamé's parameters is named to four digits: a solver that comes to rest to 1e-6
# of its forces leaves a tenth of this.
_FACTOR = 1e-4
# Constants this many times larger than what was asked belong to a result that hardly moves, or to
# a strain that the case does not have.
_ABSURD = 1e3
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def law_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Each other law with the material asked for."""
    body, u = result.body, result.displacement
    for name, law in laws_instead_of_law(body.strain, body.law).items():
        internal = body.internal(u, law)
        tried = [result.tried(name, Cause.LAW, internal=internal)]
        if name == OTHER_STRAIN[body.strain]:
            # Pressures go with the strain measure, or are as they were asked for.
            otherwise = body.external(u, is_other=True)
            tried.append(result.tried(name, Cause.LAW, internal=internal, external=otherwise))
        yield min(tried, key=lambda each: each.residual)
    if body.problem.inclusions:
        one = np.ones(body.mesh.num_cells)
        lmbda, mu = (of * one for of in lame_of(body.problem.material))
        name = "inclusions left out: one material everywhere"
        internal = body.internal(u, lame=(lmbda, mu))
        yield result.tried(name, Cause.MATERIAL, internal=internal)


def material_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Lamé's parameters as the result has them, by least squares, and which mistake they are."""
    body = result.body
    H = body.gradient(result.displacement)
    E = strain_of(H, body.strain)
    none = np.zeros(body.mesh.num_cells)
    # Poisson's ratio 0 has no lmbda to multiply: then in parts of mu.
    base = body.lmbda if body.lmbda.all() else body.mu
    if body.is_linear_in_strain:
        volume_part = body.force_of(push_forward(H, hooke(E, base, none), body.strain))
        shape_part = body.force_of(push_forward(H, hooke(E, none, body.mu), body.strain))
    else:
        # Linear in the moduli, all of them.
        volume_part = body.internal(result.displacement, lame=(base, none))
        shape_part = body.internal(result.displacement, lame=(none, body.mu))
    has_forces = bool(result.external[body.free].any())
    if has_forces:
        found = fit([volume_part, shape_part], result.external, body.free)
    else:
        # Without forces only the ratio of the two is determined.
        found = fit([volume_part], -shape_part, body.free)
        found = None if found is None else np.array([found[0], 1.0])
    if found is None:
        return
    a, b = (float(c) for c in found)
    if abs(a - b) <= _SAME * abs(b) and base is body.lmbda:
        # One factor for both is the stiffness, which is tried beside the loads.
        return
    lmbda, mu = a * float(base[0]), b * float(body.mu[0])
    asked = body.problem.material
    if not has_forces:
        # As stiff as was asked, for lack of what would say otherwise.
        stiffness = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu)
        lmbda, mu = (asked.youngs_modulus / stiffness * of for of in (lmbda, mu))
    name, complexity = _material_words(asked, lmbda, mu, has_forces=has_forces)
    internal = a * volume_part + b * shape_part
    yield result.tried(name, Cause.MATERIAL, complexity, internal=internal)


def lame_of(material: Material) -> tuple[float, float]:
    """Lamé's parameters lmbda and mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def lame_hypotheses(lmbda: Array, mu: Array, law: Law) -> dict[str, tuple[Array, Array]]:
    """Lamé's parameters, numbers or arrays by cell, as mistakes would have them, by name.

    Those of the constants of a stable neo-Hookean law under that law alone: at nu = 0.3 lmbda - mu
    is a third of lmbda.
    """
    E = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu)
    return {
        **mistaken_constants(law, lmbda, mu),
        "Lamé's parameters exchanged": (mu, lmbda),
        "bulk modulus instead of Lamé's lmbda": (lmbda + 2.0 * mu / 3.0, mu),
        "Lamé's lmbda instead of the bulk modulus": (lmbda - 2.0 * mu / 3.0, mu),
        "mu instead of 2 mu": (lmbda, 0.5 * mu),
        "4 mu instead of 2 mu": (lmbda, 2.0 * mu),
        "Young's modulus instead of mu": (lmbda, E),
        "lmbda of plane stress": (2.0 * lmbda * mu / (lmbda + 2.0 * mu), mu),
        "lmbda left out": (0.0 * lmbda, mu),
        "Young's modulus and the shear modulus taken for lmbda and mu": (E, mu),
    }


def _material_words(
    asked: Material, lmbda: float, mu: float, *, has_forces: bool
) -> tuple[str, int]:
    E0, nu0 = asked.youngs_modulus, asked.poissons_ratio
    l0, m0 = (np.array(of) for of in lame_of(asked))
    for name, (l1, m1) in lame_hypotheses(l0, m0, asked.law).items():
        if abs(lmbda - l1) + abs(mu - m1) <= _SAME * (abs(l0) + 2.0 * m0):
            return name, 1
    if lmbda + mu == 0.0:
        return f"lmbda {lmbda:.6g} Pa and mu {mu:.6g} Pa", 3
    E, nu = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu)
    ratio = f"Poisson's ratio {nu:.6g} instead of {nu0:.6g}"
    of_lmbda, of_mu = (float(a / b) if b else 0.0 for a, b in ((lmbda, l0), (mu, m0)))
    if not has_forces:
        # The ratio of the two alone: several mistakes make the same one.
        several = lame_factor_words("lmbda", of_lmbda / of_mu if of_mu else 0.0, nu0)
        if several:
            return f"{several}, or {ratio}: without forces they are the same", 2
        return ratio, 2
    for parameter, times, other in (("lmbda", of_lmbda, of_mu), ("mu", of_mu, of_lmbda)):
        words = lame_factor_words(parameter, times, nu0)
        if words and abs(other - 1.0) <= _FACTOR:
            return words, 2
    if abs(E / E0 - 1.0) <= _SAME:
        return ratio, 2
    factor = snapped(E / E0)
    return f"Young's modulus {factor or E / E0:.6g} times what was asked, and {ratio}", 3


def lame_factor_words(parameter: str, factor: float, nu: float) -> str:
    """What is said where one of Lamé's parameters is a known factor of what was asked, or "".

    Args:
        parameter: "lmbda" or "mu".
        factor: How many times what was asked it is [-].
        nu: Poisson's ratio that was asked for [-].
    """
    known = {2.0: "", 0.5: "", 3.0: "", 1 / 3: "", 1.5: "", 2 / 3: "", 4.0: "", 0.25: ""}
    for value, formula in (
        (1.0 - nu, "1 - nu"),
        (1.0 + nu, "1 + nu"),
        (1.0 - 2.0 * nu, "1 - 2 nu"),
    ):
        for times, words in ((value, f"({formula})"), (1.0 / value, f"1 / ({formula})")):
            known[times] = f" = {words}" if known.get(times) is None else f" or {words}"
    found = [value for value in known if abs(factor / value - 1.0) <= _FACTOR]
    if not found or abs(factor - 1.0) <= _FACTOR:
        return ""
    also = "".join(known[value] for value in found)
    return f"Lamé's {parameter} {factor:.3f} times what was asked{also}"


def anisotropy_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Nine constants of a stiffness that is symmetric to the axes, by least squares.

    Of one material everywhere, with the stress linear in the strain. Worth trying only where
    nothing simpler fits: it takes in every isotropic one.
    """
    body = result.body
    if body.problem.inclusions or not result.external[body.free].any():
        return
    if not body.is_linear_in_strain:
        return
    H = body.gradient(result.displacement)
    E = strain_of(H, body.strain)
    columns = []
    for i, j in _PAIRS:
        S = np.zeros_like(E)
        S[:, i, i] += E[:, j, j]
        if i != j:
            S[:, j, j] += E[:, i, i]
        columns.append(S)
    for i, j in _PAIRS[3:]:
        S = np.zeros_like(E)
        S[:, i, j] = S[:, j, i] = 2.0 * E[:, i, j]
        columns.append(S)
    forces = [body.force_of(push_forward(H, S, body.strain)) for S in columns]
    found = fit(forces, result.external, body.free)
    if found is None or np.abs(found).max() > _ABSURD * body.lmbda.max() + _ABSURD * body.mu.max():
        return
    internal = body.total([c * f for c, f in zip(found, forces, strict=True)])
    l0, m0 = float(body.lmbda[0]), float(body.mu[0])
    asked = np.array([l0 + 2.0 * m0] * 3 + [l0] * 3 + [m0] * 3)
    yield result.tried(_constants(found, asked), Cause.LAW, 4, internal=internal)


def _constants(found: Array, asked: Array) -> str:
    names = [f"C{i + 1}{j + 1}" for i, j in _PAIRS] + ["C66", "C55", "C44"]
    changed = [
        f"{name} {c:.5g} Pa where {a:.5g} Pa was asked"
        for name, c, a in zip(names, found, asked, strict=True)
        if abs(c - a) > 1e-4 * asked[0]
    ]
    return "the law is not isotropic: " + ", ".join(changed)
