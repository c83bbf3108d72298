"""Slips in the supports and tools of a static case: missing, held in part, elsewhere, too much."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from palpate.validation.diagnosis.explanation import CONVERGED, OF_TOOL_FORCE, Cause, Explanation
from palpate.validation.diagnosis.factors import in_words
from palpate.validation.diagnosis.static_answer import StaticAnswer, cause_of, known_factor
from palpate.validation.metrics.body import Body, Mask, ratio
from palpate.validation.states import State

# Held components that are this far off, in parts of the largest displacement, are not held: in
# double precision, and in single.
_OFF = (1e-10, 1e-6)
# Free ones that move less are held.
_STILL = 1e-13
_AXES = "xyz"


def support_explanations(answer: StaticAnswer) -> Iterator[Explanation]:
    """Each slip of the supports, by the equations with that slip in them."""
    body, displacement = answer.body, answer.displacement
    largest = float(np.abs(displacement).max())
    apart = np.where(body.held, np.abs(displacement - body.prescribed), 0.0)
    tried = []
    for part in _OFF:
        # Components that are off carry no support's force; the others are where they belong.
        off = apart > part * largest
        miss = ratio(float(apart[~off].max(initial=0.0)), largest)
        name, is_plain = _released_words(body, off)
        complexity = 1 if is_plain else 2
        tried.append(answer.tried(name, Cause.SUPPORT, complexity, rows=body.free | off, miss=miss))
    if body.prescribed.any():
        asked = body.prescribed[body.held]
        factor = float(displacement[body.held] @ asked / (asked @ asked))
        factor, is_known = known_factor(factor)
        left = np.abs(displacement - factor * body.prescribed)[body.held].max(initial=0.0)
        name, cause = f"prescribed displacement {in_words(factor)}", cause_of(factor, Cause.SUPPORT)
        complexity = 1 if is_known else 2
        tried.append(answer.tried(name, cause, complexity, miss=ratio(float(left), largest)))
    yield from tried
    if not any(each.fits for each in tried):
        name = "held points are held at other places"
        yield answer.tried(name, Cause.SUPPORT, 3, miss=0.0)
    # What is held that should be free.
    still = body.free & (np.abs(displacement) <= _STILL * largest)
    if still.any() and still.sum() < 0.5 * body.free.sum():
        name = _overheld_words(body, still)
        yield answer.tried(name, Cause.SUPPORT, 2, rows=body.free & ~still)


def _released_words(body: Body, off: Mask) -> tuple[str, bool]:
    """Which supports are not held, and whether it is whole ones or whole components."""
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


def tool_explanation(answer: StaticAnswer) -> Iterator[Explanation]:
    """Equilibrium without the tools, where they could touch as well.

    How far it is from the reference is what has to be explained: equilibrium elsewhere does not
    see the tools.
    """
    if not answer.body.problem.tools or answer.apart is None:
        return
    found = answer.tried("tools left out: nothing touches", Cause.TOOL, rows=~answer.body.held)
    yield replace(found, stated=answer.apart)


def tool_force_explanations(candidate: State, reference: State) -> Iterator[Explanation]:
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
