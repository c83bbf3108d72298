"""Oscillation of the point that moves most: its errors, what sampling shows, numerical damping.

A swing of 10 Hz, sampled 13 times a second, looks like one of 3 Hz, to the last digit: samples
alone never exclude it. The body's own stiffness does: what its elasticity pulls it back with
says how fast it has to swing (Rayleigh's quotient), at any sampling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import fields as fields_of
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norms
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.schemes import Steps, frequency_ratio, numerical_damping_ratio
from palpate.validation.exchange.nodal_arrays import lumped_mass
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.difference import Difference, are_at_same_times, largest
from palpate.validation.metrics.time_series import (
    OscillationError,
    fit_oscillation,
    fit_uncertainty,
    oscillation_error,
    oscillation_offset,
)
from palpate.validation.states import State, Trajectory

Array = NDArray[np.float64]
# A motion has left another one where it is off by this part of its largest displacement.
_LEFT = 0.01
# Two fits of one motion that drift apart by more of a turn over it are two swings: an alias.
_SAME_SWING = 0.25
OSCILLATION = tuple(f"oscillation_{field.name}" for field in fields_of(OscillationError))
_SCALES = {
    "amplitude": "the reference's amplitude",
    "frequency": "the reference's frequency",
    "phase": "one period",
    "damping": "the reference's frequency",
    "mean": "the reference's amplitude",
}
# Two are the limit, where phase and amplitude cannot be separated.
SAMPLES_PER_PERIOD = 2.5
# States that the quotient is taken over.
_MOST_STATES = 64
# Part of a motion before which nothing is fitted: quick modes, which a scheme damps most, are in
# the swing until then, and their end would look like the swing's decay.
_EARLY = 1.0 / 3.0
# Angles of a step between which the true frequency is looked for [rad].
_LEAST, _MOST = 1e-9, 1e4


def oscillation(name: str, problem: Problem, candidate: State, reference: State) -> Difference:
    """One error of the oscillation where and along which the reference swings most.

    The candidate's own samples are fitted: those at the reference's times where all were sent,
    unless all that were sent show another swing. What either sampling cannot show is uncertain
    without end.

    Raises:
        InputError: The reference does not oscillate.
    """
    ours, theirs = _trajectories(candidate, reference)
    theirs = reference.sent or theirs
    point, axis = swinging_most(theirs)
    expected = fit_oscillation(theirs.times, _along(theirs, point, axis))
    word = name.removeprefix("oscillation_")
    sent = candidate.sent or ours
    try:
        found = fit_oscillation(sent.times, _along(sent, point, axis))
        if candidate.other_reading is None and reference.sent is None and sent is not ours:
            there = fit_oscillation(ours.times, _along(ours, point, axis))
            turns = abs(there.frequency - found.frequency) * float(np.ptp(theirs.times))
            found = there if turns <= _SAME_SWING else found
    except InputError as error:
        remark = f"its motion has no swing to compare: {error}"
        return Difference(math.inf, 1.0, _SCALES[word], remark=remark)
    errors = oscillation_error(found, expected, float(np.ptp(theirs.times)))
    uncertainty, remark = 0.0, ""
    is_read = candidate.other_reading is not None or reference.sent is not None
    if is_read and not are_at_same_times(candidate, reference):
        # Fits of other samples differ by how the other modes leak into them.
        for motion, fitted in ((sent, found), (theirs, expected)):
            off = fit_uncertainty(motion.times, _along(motion, point, axis), fitted)
            uncertainty += float(getattr(off, word))
    for whose, motion in (("the reference", theirs), ("the candidate", sent)):
        why = too_coarse(motion, expected.frequency)
        why = why or may_be_alias(
            problem, reference.strain, motion, element=candidate.element, of=theirs
        )
        if why:
            uncertainty, remark = math.inf, f"of {whose}, {why}"
    return Difference(
        float(getattr(errors, word)), 1.0, _SCALES[word], uncertainty=uncertainty, remark=remark
    )


def departure(problem: Problem, candidate: State, reference: State) -> str:
    """By how much a motion is off at worst, and since when by a hundredth; "" where it is nowhere.

    Errors are in L2, over the reference's largest displacement over time, as of `trajectory_l2`.
    The step is counted where the candidate's time step is known.
    """
    ours, theirs = _trajectories(candidate, reference)
    size = largest(l2_norms(problem.mesh, theirs.displacements))
    with np.errstate(over="ignore", invalid="ignore"):
        off = l2_norms(problem.mesh, ours.displacements - theirs.displacements) / (size or 1.0)
    off = np.where(np.isfinite(off), off, np.inf)
    worst, has_left = int(off.argmax()), off > _LEFT
    if not has_left.any():
        return ""
    first = int(has_left.argmax())
    time = float(theirs.times[first])
    step = (
        "" if candidate.steps is None else f", step {math.ceil(time / candidate.steps.time_step)}"
    )
    most = f"{100.0 * off[worst]:.3g} %" if off[worst] < math.inf else "no number"
    return (
        f"its motion is off by {most} of the largest displacement at {theirs.times[worst]:.4g} s, "
        f"and by more than {100.0 * _LEFT:g} % from {time:.4g} s on (output {first}{step})"
    )


def _along(motion: Trajectory, point: int, axis: Array) -> Array:
    """Displacement of a point along an axis [m], (num_times,)."""
    path: Array = motion.displacements[:, point] @ axis
    return path


def oscillation_offsets(
    states: Sequence[State],
) -> tuple[tuple[OscillationError, ...], OscillationError]:
    """Errors with their signs against the first of some states, where and along which it swings.

    And how far the first one's fit may be off.

    Raises:
        InputError: One of them does not oscillate.
    """
    motions = [_trajectories(state, states[0])[0] for state in states]
    point, axis = swinging_most(motions[0])
    series = [(motion.times, _along(motion, point, axis)) for motion in motions]
    swings = [fit_oscillation(*one) for one in series]
    duration = float(np.ptp(motions[0].times))
    offsets = tuple(oscillation_offset(swing, swings[0], duration) for swing in swings)
    return offsets, fit_uncertainty(*series[0], swings[0])


def swinging_most(motion: Trajectory) -> tuple[int, Array]:
    """The point that moves most about its mean position, and the direction of that motion."""
    about = motion.displacements - motion.displacements.mean(axis=0)
    point = int((about**2).sum(axis=(0, 2)).argmax())
    axis = np.linalg.svd(about[:, point], full_matrices=False)[2][0]
    return point, axis * np.sign(axis[np.abs(axis).argmax()])


def _trajectories(candidate: State, reference: State) -> tuple[Trajectory, Trajectory]:
    if candidate.trajectory is None or reference.trajectory is None:
        raise InputError("metrics of motion need a case with [time]")
    return candidate.trajectory, reference.trajectory


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

    `element` are the tetrahedra that pull the body back, the candidate's; `of` is the motion whose
    content is looked at, the reference's, or `motion`.
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


@dataclass(frozen=True)
class NumericalDamping:
    """Numerical damping of the oscillation of the point that swings most, of this `frequency` [Hz].

    Damping ratios [-]: by the scheme's `formula`, and as `measured`, less that of the case's own
    dampings; `uncertainty` of the latter: what other modes leak into the fit, and how far the
    motion's first third would move it.
    """

    steps: Steps
    frequency: float
    formula: float
    measured: float
    uncertainty: float

    def __str__(self) -> str:
        return (
            f"numerical damping at {self.frequency:.4g} Hz ({self.steps}): "
            f"{100.0 * self.formula:.3g} % of critical by the scheme, {100.0 * self.measured:.3g} "
            f"+- {100.0 * self.uncertainty:.2g} % measured"
        )


def measure_numerical_damping(problem: Problem, state: State) -> NumericalDamping:
    """Damping by the scheme that a result states, and the damping that it has.

    measured = (g - lambda / 2) / w - beta w / 2 for a decay exp(-g t) at w = 2 pi f under mass
    damping lambda and stiffness damping beta. The formula is of the frequency that the scheme makes
    f of, without them: their product is of second order in the step. Two modes of nearly one
    frequency beat: what is measured then is that of neither.

    Raises:
        InputError: No motion, no stated scheme, nothing that swings for two periods and a quarter,
            or a frequency that the scheme cannot have with this step.
    """
    motion = state.trajectory
    if motion is None or state.steps is None or problem.time is None:
        raise InputError("numerical damping is of a motion whose scheme and step are stated")
    point, axis = swinging_most(motion)
    along = motion.displacements[:, point] @ axis
    whole = fit_oscillation(motion.times, along)
    late = motion.times >= motion.times[0] + _EARLY * np.ptp(motion.times)
    swing = fit_oscillation(motion.times[late], along[late])
    off = fit_uncertainty(motion.times[late], along[late], swing).damping * swing.frequency
    off += abs(swing.damping - whole.damping)
    omega = 2.0 * math.pi * swing.frequency
    angle = true_angle(state.steps, swing.frequency)
    return NumericalDamping(
        state.steps,
        swing.frequency,
        numerical_damping_ratio(state.steps.integrator, angle),
        (swing.damping - 0.5 * problem.time.mass_damping) / omega
        - 0.5 * problem.time.stiffness_damping * omega,
        off / omega,
    )


def true_angle(steps: Steps, frequency: float) -> float:
    """Omega dt [rad] of the undamped oscillation that a scheme shows at a frequency [Hz].

    Raises:
        InputError: With this step the scheme shows no such frequency.
    """
    shown = 2.0 * math.pi * frequency * steps.time_step
    scheme, low = steps.integrator, _LEAST
    high = _MOST if scheme.is_implicit else 2.0 * (1.0 - 1e-12)

    def of(angle: float) -> float:
        return angle * frequency_ratio(scheme, angle)

    if not of(low) < shown < of(high):
        raise InputError(f"{steps}: shows no oscillation of {frequency:g} Hz")
    from scipy.optimize import brentq

    root = brentq(lambda log: of(math.exp(log)) - shown, math.log(low), math.log(high), xtol=1e-15)
    return math.exp(float(root))
