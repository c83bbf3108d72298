"""Which frequencies the states of a motion can tell, and which are in the motion.

A swing of 10 Hz, sampled 13 times a second, looks like one of 3 Hz, to the last digit: samples
alone never exclude it. The body's own stiffness does: what its elasticity pulls it back with
says how fast it has to swing (Rayleigh's quotient), at any sampling.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.exchange.nodal_arrays import lumped_mass
from palpate.validation.metrics.body import body_of
from palpate.validation.states import Trajectory

# Two are the limit, where phase and amplitude cannot be told apart.
SAMPLES_PER_PERIOD = 2.5
# States that the quotient is taken over.
_MOST_STATES = 64


def largest_gap(motion: Trajectory) -> float:
    """Longest time from one state to the next [s]."""
    return float(np.diff(motion.times).max())


def too_coarse(motion: Trajectory, frequency: float) -> str:
    """Why the states of a motion are too far apart for a frequency [Hz]; "" where they are not."""
    gap = largest_gap(motion)
    highest = 1.0 / (SAMPLES_PER_PERIOD * gap)
    if frequency <= highest:
        return ""
    return (
        f"states {gap:.3g} s apart tell frequencies up to {highest:.3g} Hz, not {frequency:.3g} "
        "Hz: send more of them"
    )


def may_be_alias(
    problem: Problem,
    strain: Strain,
    motion: Trajectory,
    *,
    element: Element = Element.LINEAR,
    of: Trajectory | None = None,
) -> str:
    """Why a frequency that the states of a motion show may be another's; "" where it is not.

    Args:
        problem: With mass, stiffness, supports and loads.
        strain: Whose law pulls the body back.
        motion: The states.
        element: Whose tetrahedra pull it back: those of the candidate.
        of: The motion whose content is looked at, the reference's; `motion` where None.
    """
    gap = largest_gap(motion)
    content = content_frequency(problem, strain, of or motion, element)
    if content <= 0.5 / gap:
        return ""
    return (
        f"states {gap:.3g} s apart tell frequencies up to {0.5 / gap:.3g} Hz at most, and the "
        f"body's stiffness has it swing at about {content:.3g} Hz: what is seen may be an alias"
    )


@lru_cache(maxsize=4)
def content_frequency(
    problem: Problem, strain: Strain, motion: Trajectory, element: Element = Element.LINEAR
) -> float:
    """How fast the body has to swing to be in these states [Hz]: Rayleigh's quotient.

    sum over states of (u - mean).(internal force - load) over that of (u - mean).M (u - mean),
    over what is free and out of the tools' reach; its root over 2 pi. A mean over all modes in
    the motion by how much they move. Linear tetrahedra make it too high rather than too low;
    smoothed ones are never stiffer, and close to the body itself.
    """
    body, mass = body_of(problem, strain, element), lumped_mass(problem)[:, None]
    about = motion.displacements - motion.displacements.mean(axis=0)
    stiff, inert = 0.0, 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(0, len(about), math.ceil(len(about) / _MOST_STATES)):
            displacement, time = motion.displacements[k], float(motion.times[k])
            force = body.internal(displacement) - body.external(displacement, time)
            stiff += float((force * about[k])[body.free].sum())
            inert += float((mass * about[k] ** 2)[body.free].sum())
    if not (math.isfinite(stiff) and math.isfinite(inert)):
        return math.inf
    return math.sqrt(max(stiff / inert, 0.0)) / (2.0 * math.pi) if inert > 0.0 else 0.0
