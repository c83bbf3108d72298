"""Slips in the supports of a static case: missing, held in part, at another place, or too much."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.body import Body, Mask, imbalance, ratio
from palpate.validation.diagnosis.explanation import OF_FORCE, Cause, Explanation
from palpate.validation.diagnosis.factors import in_words, is_unit, snapped

# Held components that are this far off, in parts of the largest displacement, are not held: in
# double precision, and in single.
_OFF = (1e-10, 1e-6)
# Free ones that move less are held.
_STILL = 1e-13
_AXES = "xyz"


def support_explanations(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """Each slip of the supports, by the equations with that slip in them."""
    internal = body.internal(displacement)
    external = body.total(body.loads(displacement))
    largest = float(np.abs(displacement).max())
    apart = np.where(body.held, np.abs(displacement - body.prescribed), 0.0)

    def tried(name: str, rows: Mask, miss: float, complexity: int, cause: Cause) -> Explanation:
        left = max(imbalance(internal, external, rows), miss)
        return Explanation(name, cause, left, stated, OF_FORCE, complexity)

    is_found = False
    for share in _OFF:
        # Components that are off carry no support's force; the others are where they belong.
        off = apart > share * largest
        miss = ratio(float(apart[~off].max(initial=0.0)), largest)
        name, plain = _released_words(body, off)
        not_held = tried(name, body.free | off, miss, 1 if plain else 2, Cause.SUPPORT)
        yield not_held
        is_found = is_found or not_held.fits
    if body.prescribed.any():
        asked = body.prescribed[body.held]
        factor = float(displacement[body.held] @ asked / (asked @ asked))
        known = snapped(factor)
        used = factor if known is None else known
        left = np.abs(displacement - used * body.prescribed)[body.held].max(initial=0.0)
        cause = Cause.UNITS if is_unit(used) else Cause.SUPPORT
        name = f"prescribed displacement {in_words(used)}"
        miss = ratio(float(left), largest)
        elsewhere = tried(name, body.free, miss, 1 if known is not None else 2, cause)
        yield elsewhere
        is_found = is_found or elsewhere.fits
    if not is_found:
        yield tried("held points are held at other places", body.free, 0.0, 3, Cause.SUPPORT)
    # What is held that should be free.
    still = body.free & (np.abs(displacement) <= _STILL * largest)
    if still.any() and still.sum() < 0.5 * body.free.sum():
        name = _overheld_words(body, still)
        yield tried(name, body.free & ~still, body.miss(displacement), 2, Cause.SUPPORT)


def _released_words(body: Body, off: Mask) -> tuple[str, bool]:
    """Which supports are not held, and whether it is whole ones or whole components."""
    parts, plain = [], True
    for number, support in enumerate(body.problem.supports, start=1):
        mine = np.zeros_like(off)
        mine[np.ix_(support.points, np.flatnonzero(support.components))] = True
        missing = mine & off
        if not missing.any():
            continue
        name = f"support {number}"
        axes = np.flatnonzero(missing.any(axis=0))
        whole = all(missing[:, k].sum() > 0.9 * mine[:, k].sum() for k in axes)
        if whole and len(axes) == sum(support.components):
            parts.append(f"{name} is not held")
        elif whole:
            parts.append(f"{name} does not hold {' and '.join(_AXES[k] for k in axes)}")
        else:
            plain = False
            count = int(missing.any(axis=1).sum())
            parts.append(
                f"{name} is held in part: {count} of its {len(support.points)} points are not held"
            )
    return ", ".join(parts) or "a support is not held", plain and len(parts) == 1


def _overheld_words(body: Body, still: Mask) -> str:
    for number, support in enumerate(body.problem.supports, start=1):
        mine = np.zeros_like(still)
        mine[support.points] = True
        if not all(support.components) and not (still & ~mine).any():
            axes = " and ".join(_AXES[k] for k in np.flatnonzero(still.any(axis=0)))
            return f"support {number} holds {axes} as well"
    return f"{int(still.any(axis=1).sum())} points are held that should be free"
