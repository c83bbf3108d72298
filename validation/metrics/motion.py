"""Metrics of motion: the whole trajectory, and the oscillation of the point that moves most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields as fields_of

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norms
from palpate.meshes.problem import Problem
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.pairs import Difference, ratio
from palpate.validation.metrics.sampling import may_be_alias, too_coarse
from palpate.validation.metrics.time_series import (
    OscillationError,
    fit_oscillation,
    fit_uncertainty,
    oscillation_error,
    oscillation_offset,
)
from palpate.validation.states import State, Trajectory

Array = NDArray[np.float64]
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


def trajectory_l2(problem: Problem, candidate: State, reference: State) -> Difference:
    """Largest L2 error of displacement over time, over the reference's largest L2 norm."""
    ours, theirs = _trajectories(candidate, reference)
    error = largest(l2_norms(problem.mesh, ours.displacements - theirs.displacements))
    scale = largest(l2_norms(problem.mesh, theirs.displacements))
    return ratio(error, scale, "largest L2 norm of the reference's displacement over time")


def oscillation(name: str, problem: Problem, candidate: State, reference: State) -> Difference:
    """One error of the oscillation where and along which the reference swings most.

    The candidate's own samples are fitted: those at the reference's times where all were sent,
    unless all that were sent tell another swing. What either sampling cannot tell is uncertain
    without end.

    Raises:
        InputError: The reference does not oscillate.
    """
    ours, theirs = _trajectories(candidate, reference)
    point, axis = swinging_most(theirs)
    expected = fit_oscillation(theirs.times, _along(theirs, point, axis))
    word = name.removeprefix("oscillation_")
    sent = candidate.sent or ours
    try:
        found = fit_oscillation(sent.times, _along(sent, point, axis))
        if candidate.other_reading is None and sent is not ours:
            there = fit_oscillation(ours.times, _along(ours, point, axis))
            turns = abs(there.frequency - found.frequency) * float(np.ptp(theirs.times))
            found = there if turns <= _SAME_SWING else found
    except InputError:
        return Difference(math.inf, 1.0, _SCALES[word])
    errors = oscillation_error(found, expected, float(np.ptp(theirs.times)))
    uncertainty, remark = 0.0, ""
    if candidate.other_reading is not None:
        # Fits of other samples differ by how the other modes leak into them.
        for motion, fitted in ((sent, found), (theirs, expected)):
            off = fit_uncertainty(motion.times, _along(motion, point, axis), fitted)
            uncertainty += float(getattr(off, word))
    for who, motion in (("the reference", theirs), ("the candidate", sent)):
        why = too_coarse(motion, expected.frequency)
        why = why or may_be_alias(
            problem, reference.strain, motion, element=candidate.element, of=theirs
        )
        if why:
            uncertainty, remark = math.inf, f"of {who}, {why}"
    return Difference(
        float(getattr(errors, word)), 1.0, _SCALES[word], uncertainty=uncertainty, remark=remark
    )


def _along(motion: Trajectory, point: int, axis: Array) -> Array:
    """What a point does along an axis [m], (num_times,)."""
    path: Array = motion.displacements[:, point] @ axis
    return path


def oscillation_offsets(
    states: Sequence[State],
) -> tuple[tuple[OscillationError, ...], OscillationError]:
    """Errors with their signs against the first of some states, where and along which it swings.

    Returns:
        Of every state, the first one's all 0; and how far the first one's fit may be off.

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
    """The point that moves most about its mean place, and the direction it does so along."""
    about = motion.displacements - motion.displacements.mean(axis=0)
    point = int((about**2).sum(axis=(0, 2)).argmax())
    axis = np.linalg.svd(about[:, point], full_matrices=False)[2][0]
    return point, axis * np.sign(axis[np.abs(axis).argmax()])


def _trajectories(candidate: State, reference: State) -> tuple[Trajectory, Trajectory]:
    if candidate.trajectory is None or reference.trajectory is None:
        raise InputError("metrics of motion need a case with [time]")
    return candidate.trajectory, reference.trajectory
