"""Hypotheses of how a right result was written down wrongly: unit, sign, axes, order, origin, time.

Each is undone and the rest compared with the reference on the same mesh, at every stored time. And
isotropy, by asking the candidate again: the same problem turned must have the same result turned.
It is named only where the same problem renumbered, and an affine motion of all of the boundary,
are solved right: what is wrong then depends on how the axes lie and on nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from palpate.meshes import transforms
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem
from palpate.validation.diagnosis.explanation import (
    CONVERGED,
    LENGTH_UNITS,
    OF_DISPLACEMENT,
    OF_RELATION,
    SINGLE,
    Cause,
    Explanation,
    displacement_words,
    is_unit,
    snapped,
)
from palpate.validation.diagnosis.static_hypotheses import turn_between

# (num_times, num_points, 3)
Fields = NDArray[np.float64]
_AXES = "xyz"
POSITIONS = "positions sent for displacements"
_MOST_SHIFT = 3
_TIME_FACTORS = (2, 3, 4, 5, 10)


def distance(fields: Fields, reference: Fields) -> float:
    """Largest distance of a point at a time, over the reference's largest displacement."""
    with np.errstate(over="ignore"):
        apart = float(np.linalg.norm(fields - reference, axis=-1).max())
        scale = float(np.linalg.norm(reference, axis=-1).max())
    if scale == 0.0:
        return 0.0 if apart == 0.0 else float("inf")
    return apart / scale


def result_hypotheses(
    fields: Fields, reference: Fields, rest: Points, *, other: tuple[str, Fields] | None = None
) -> Iterator[Explanation]:
    """Try every mistake of the result, whose displacement and the reference's are fields [m].

    `other` is the reference's with the other strain measure, with that mistake's name.
    """
    stated = distance(fields, reference)

    def tried(name: str, cause: Cause, fixed: Fields, complexity: int = 1) -> Explanation:
        left = distance(fixed, reference)
        return Explanation(name, cause, left, stated, OF_DISPLACEMENT, complexity)

    yield from _agreement(fields, stated)
    yield tried("nothing moves: the result is zero", Cause.RESULT, reference + fields, 3)
    for name, cause, fixed, complexity in _scaled(fields, reference, rest):
        yield tried(name, cause, fixed, complexity)
    sizes = [float(np.linalg.norm(f, axis=-1).max()) for f in (fields, reference)]
    known = snapped(sizes[0] / sizes[1]) if sizes[1] > 0.0 else None
    unit = known if known in LENGTH_UNITS else None
    turned = []
    for name, fixed in _turned(fields, unit or 1.0):
        words = name if unit is None else f"{name}, in {LENGTH_UNITS[unit]}"
        turned.append(tried(words, Cause.RESULT, fixed, 1 if unit is None else 2))
    yield from turned
    if not any(each.fits for each in turned):
        for name, fixed in _turned_anyhow(fields, reference, rest):
            yield tried(name, Cause.RESULT, fixed, 3)
    orders = [tried(name, Cause.RESULT, fixed) for name, fixed in _reordered(fields)]
    yield from orders
    if not any(each.fits for each in orders):
        for fixed in _sorted_alike(fields, reference):
            yield tried("points in another order", Cause.RESULT, fixed, 2)
    shift = (fields - reference).mean(axis=1, keepdims=True)
    yield tried("the whole result is shifted: another origin", Cause.RESULT, fields - shift, 2)
    if other is not None and other[1].shape == fields.shape:
        left = distance(fields, other[1])
        yield Explanation(other[0], Cause.LAW, left, stated, OF_DISPLACEMENT)
    yield from _retimed(fields, reference, stated)


def plain_hypotheses(displacement: Points, rest: Points) -> Iterator[tuple[str, Points]]:
    """Mistakes that can be undone without a reference: sign, positions, axes; (num_points, 3)."""
    yield displacement_words(-1.0), -displacement
    yield POSITIONS, displacement - rest
    yield from _turned(displacement, 1.0)


def _agreement(fields: Fields, stated: float) -> Iterator[Explanation]:
    if stated > SINGLE:
        return
    if np.array_equal(fields, fields.astype(np.float32)):
        name, cause = (
            "displacement agrees to single precision, in which its numbers are stored",
            Cause.PRECISION,
        )
    elif stated > CONVERGED:
        name, cause = "displacement agrees to single precision", Cause.PRECISION
    else:
        name = "displacement agrees with the reference on this mesh"
        cause = Cause.AGREES
    yield Explanation(name, cause, stated, stated, OF_DISPLACEMENT, 0)


def _scaled(
    fields: Fields, reference: Fields, rest: Points
) -> Iterator[tuple[str, Cause, Fields, int]]:
    squared = float((reference**2).sum())
    if squared > 0.0:
        factor = float((fields * reference).sum()) / squared
        known = snapped(factor)
        used = factor if known is None else known
        if used not in (0.0, 1.0):
            plain = known is not None and (is_unit(known) or known == -1.0)
            cause = Cause.UNITS if is_unit(used) else Cause.RESULT
            yield displacement_words(used), cause, fields / used, 1 if plain else 3
    yield POSITIONS, Cause.RESULT, fields - rest, 1
    name = "points at rest taken off displacements, as if they were positions"
    yield name, Cause.RESULT, fields + rest, 1
    for factor, unit in LENGTH_UNITS.items():
        name = f"positions in {unit} sent for displacements"
        yield name, Cause.UNITS, (fields - factor * rest) / factor, 2


def _turned(fields: Fields, unit: float) -> Iterator[tuple[str, Fields]]:
    """All signed permutations of the axes but none at all and the sign alone."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            if order != (0, 1, 2) or len(set(signs)) > 1:
                # Component k of the truth was written as component order[k].
                yield _axes_words(order, signs), fields[..., order] * (np.array(signs) / unit)


def _turned_anyhow(fields: Fields, reference: Fields, rest: Points) -> Iterator[tuple[str, Fields]]:
    """By any angle: the displacement, or the positions with the body itself."""
    for name, at in (("displacement", 0.0 * rest), ("positions", rest)):
        mine, theirs = at + fields, at + reference
        turn = turn_between(theirs.reshape(-1, 3), mine.reshape(-1, 3))
        if turn is not None:
            R, words = turn
            yield f"{name} turned by {words}: a parent's rotation left out", mine @ R - at


def _axes_words(order: tuple[int, ...], signs: tuple[float, ...]) -> str:
    moved = [k for k in range(3) if order[k] != k]
    turned = [_AXES[order[k]] for k in range(3) if signs[k] < 0.0]
    parts = []
    if len(moved) == 2:
        parts.append(f"components {_AXES[moved[0]]} and {_AXES[moved[1]]} exchanged")
    elif moved:
        cycle = ", ".join(f"{_AXES[k]} as {_AXES[order[k]]}" for k in range(3))
        parts.append(f"axes turned round: {cycle}")
    if turned:
        parts.append(f"{' and '.join(sorted(turned))} reversed")
    return ", ".join(parts)


def _reordered(fields: Fields) -> Iterator[tuple[str, Fields]]:
    for shift in (1, -1):
        yield "points numbered one off", np.roll(fields, shift, axis=1)
    yield "points in reverse order", fields[:, ::-1]
    blocks = fields.reshape(len(fields), 3, -1).transpose(0, 2, 1)
    yield "written as all x, all y, all z, read as x, y, z of each point", blocks
    mixed = fields.transpose(0, 2, 1).reshape(fields.shape)
    yield "written as x, y, z of each point, read as all x, all y, all z", mixed


def _sorted_alike(fields: Fields, reference: Fields) -> Iterator[Fields]:
    """The points in the reference's order, if the rows are the same: so are their projections."""
    count = fields.shape[1]
    mine, theirs = (f.transpose(1, 0, 2).reshape(count, -1) for f in (fields, reference))
    rng = np.random.default_rng(1)
    for _ in range(3):
        direction = rng.normal(size=mine.shape[1])
        order = np.empty(count, dtype=np.int64)
        ranks = np.argsort(theirs @ direction, kind="stable")
        order[ranks] = np.argsort(mine @ direction, kind="stable")
        yield fields[:, order]


def _retimed(fields: Fields, reference: Fields, stated: float) -> Iterator[Explanation]:
    """Motions that are right at other times than they say; compared where both have a state."""
    count = len(fields)
    if count < 4 or reference.shape != fields.shape:
        return

    def tried(name: str, mine: Fields, theirs: Fields, complexity: int) -> Explanation:
        scale = float(np.linalg.norm(reference, axis=-1).max())
        left = float(np.linalg.norm(mine - theirs, axis=-1).max())
        left = left / scale if scale > 0.0 else float("inf")
        return Explanation(name, Cause.TIME, left, stated, OF_DISPLACEMENT, complexity)

    for shift in range(1, min(_MOST_SHIFT, count - 3) + 1):
        outputs = f"{shift} output" + "s" * (shift > 1)
        yield tried(f"time shifted: {outputs} late", fields[shift:], reference[:-shift], 1)
        yield tried(f"time shifted: {outputs} early", fields[:-shift], reference[shift:], 1)
    for factor in _TIME_FACTORS:
        common = (count - 1) // factor + 1
        if common < 4:
            continue
        name = f"time runs {factor} times too"
        yield tried(f"{name} fast", fields[:common], reference[::factor][:common], 1)
        yield tried(f"{name} slow", fields[::factor][:common], reference[:common], 1)


Ask = Callable[[Problem], Points]
_AXIS = (1.0, 2.0, -0.5)
_ANGLE_DEG = 70.0
# What solvers leave of a relation: one that is satisfied better says no more.
_NOISE = 1e-9
_SLOPE = np.array([[0.01, 0.005, 0.0], [-0.004, -0.008, 0.01], [0.0, 0.006, 0.005]])


def isotropy_hypotheses(problem: Problem, result: Points, ask: Ask) -> Iterator[Explanation]:
    """Whether the result of a static problem depends on how the body lies in space.

    Supports of single components cannot be turned, and are not tried. `ask` gives the candidate's
    displacement of another problem, and may raise CandidateFailedError.
    """
    if not all(all(support.components) for support in problem.supports):
        return
    scale = float(np.abs(result).max())
    if scale == 0.0:
        return
    mesh = problem.mesh
    outer = np.unique(mesh.boundary_facets)
    affine = mesh.points @ _SLOPE
    patch = transforms.prescribe(mesh, problem.material, outer, affine)
    # The patch has no inclusions; the test is conclusive only where the body has none either.
    satisfied = float(np.abs(ask(patch) - affine).max() / np.abs(affine).max())
    given, back = transforms.renumber(problem)
    satisfied = max(satisfied, float(np.abs(back(ask(given)) - result).max()) / scale)
    given, back = transforms.turn(problem, transforms.rotation(_AXIS, _ANGLE_DEG))
    broken = float(np.abs(back(ask(given)) - result).max()) / scale
    yield turned_otherwise(satisfied, broken)


def turned_otherwise(satisfied: float, broken: float) -> Explanation:
    """What the relations show about isotropy.

    `satisfied` is the largest error in a relation that every law satisfies, `broken` how far the
    result to the turned problem is from the result turned.
    """
    name = (
        "the law is not isotropic, or axes are mixed up: the turned problem has another result "
        f"than the turned one, by {broken:.2g}"
    )
    return Explanation(name, Cause.LAW, max(satisfied, _NOISE), broken, OF_RELATION, 4)
