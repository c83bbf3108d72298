"""Slips in the tools of a static case: left out, or their forces wrong where nothing else is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.body import Body, imbalance
from palpate.validation.diagnosis.explanation import (
    CONVERGED,
    OF_FORCE,
    OF_TOOL_FORCE,
    Cause,
    Explanation,
)
from palpate.validation.diagnosis.factors import in_words, is_unit, snapped
from palpate.validation.states import State


def tool_explanation(
    body: Body, displacement: Points, apart: float | None
) -> Iterator[Explanation]:
    """Equilibrium without the tools, where they could touch as well.

    Args:
        body: With its tools.
        displacement: The candidate's [m].
        apart: Its distance from the reference: equilibrium elsewhere does not see the tools.
    """
    if not body.problem.tools or apart is None:
        return
    internal = body.internal(displacement)
    external = body.total(body.loads(displacement))
    left = max(imbalance(internal, external, ~body.held), body.miss(displacement))
    yield Explanation("tools left out: nothing touches", Cause.TOOL, left, apart, OF_FORCE)


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
    factor = float((ours * theirs).sum()) / float((theirs**2).sum())
    known = snapped(factor)
    used = factor if known is None else known
    if used == 0.0:
        return
    left = float(np.linalg.norm(ours / used - theirs, axis=-1).max()) / scale
    name = f"force on the tools {in_words(used)}"
    if used > 0.0:
        name += ": the stiffness, or the unit of force"
    cause = Cause.UNITS if is_unit(used) else Cause.MATERIAL
    yield Explanation(name, cause, left, stated, OF_TOOL_FORCE, 1 if known is not None else 2)
