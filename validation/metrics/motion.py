"""Metrics of motion: the whole trajectory, and the oscillation of the point that moves most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields as fields_of

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.metrics.pairs import Difference, l2_norm, ratio
from palpate.validation.metrics.time_series import (
    OscillationError,
    fit_oscillation,
    fit_uncertainty,
    oscillation_error,
    oscillation_offset,
)
from palpate.validation.states import State, Trajectory

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
    error = max(
        l2_norm(problem.mesh, a - b)
        for a, b in zip(ours.displacements, theirs.displacements, strict=True)
    )
    scale = max(l2_norm(problem.mesh, u) for u in theirs.displacements)
    return ratio(error, scale, "largest L2 norm of the reference's displacement over time")


def oscillation(name: str, candidate: State, reference: State) -> Difference:
    """One error of the oscillation where and along which the reference swings most.

    Raises:
        InputError: The reference does not oscillate.
    """
    ours, theirs = _trajectories(candidate, reference)
    point, axis = swinging_most(theirs)
    series = [t.displacements[:, point] @ axis for t in (ours, theirs)]
    expected = fit_oscillation(theirs.times, series[1])
    word = name.removeprefix("oscillation_")
    try:
        found = fit_oscillation(ours.times, series[0])
    except InputError:
        return Difference(math.inf, 1.0, _SCALES[word])
    errors = oscillation_error(found, expected, float(np.ptp(theirs.times)))
    return Difference(float(getattr(errors, word)), 1.0, _SCALES[word])


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
    series = [(motion.times, motion.displacements[:, point] @ axis) for motion in motions]
    swings = [fit_oscillation(*one) for one in series]
    duration = float(np.ptp(motions[0].times))
    offsets = tuple(oscillation_offset(swing, swings[0], duration) for swing in swings)
    return offsets, fit_uncertainty(*series[0], swings[0])


def swinging_most(
    motion: Trajectory,
) -> tuple[int, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """The point that moves most about its mean place, and the direction it does so along."""
    about = motion.displacements - motion.displacements.mean(axis=0)
    point = int((about**2).sum(axis=(0, 2)).argmax())
    axis = np.linalg.svd(about[:, point], full_matrices=False)[2][0]
    return point, axis * np.sign(axis[np.abs(axis).argmax()])


def _trajectories(candidate: State, reference: State) -> tuple[Trajectory, Trajectory]:
    if candidate.trajectory is None or reference.trajectory is None:
        raise InputError("metrics of motion need a case with [time]")
    return candidate.trajectory, reference.trajectory
