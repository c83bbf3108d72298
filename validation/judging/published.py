"""A number of a case file, published or in closed form, beside an answer's own."""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.case.schema import PUBLISHED, CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.judging.results import State
from palpate.validation.metrics.time_series import (
    Oscillation,
    fit_oscillation,
    fit_uncertainty,
)

# A point is there within this part of the body's size.
_SAME_PLACE = 1e-6
_LENGTHS = ("amplitude", "mean")


def metric_of_bar(spec: CheckSpec) -> str:
    """Which metric's error bar says how far the truth's number may be off."""
    if spec.quantity is not None:
        return f"oscillation_{spec.quantity}"
    return "displacement_max" if spec.metric == PUBLISHED else spec.metric


def compare_published(
    spec: CheckSpec, problem: Problem, state: State, units: Units | None
) -> tuple[float, str]:
    """Relative error of one component at one point, and a line on it.

    Of an oscillation: of what is fitted to that component over time; infinite where it does not
    oscillate.

    Raises:
        InputError: No point of the mesh lies there.
    """
    used = units or Units()
    point = _point(spec, problem, used)
    assert spec.expected is not None
    unit: str = used.length
    if spec.quantity is None:
        found = float(state.displacement[point, _axis(spec)]) / used.metres(1.0)
    else:
        try:
            found = float(getattr(fit_oscillation(*_series(spec, state, point)), spec.quantity))
        except InputError as why:
            return math.inf, f"no {spec.quantity} to be had: {why}"
        if spec.quantity in _LENGTHS:
            found /= used.metres(1.0)
        else:
            unit = "Hz" if spec.quantity == "frequency" else "1/s"
    error = abs(found - spec.expected) / abs(spec.expected)
    shown = f"{found:.8g} {unit}, expected {spec.expected:.8g}: {error:.2g}"
    return error, f"{shown} {'<=' if error <= spec.limit else '>'} {spec.limit:g}"


def bar_of_published(
    spec: CheckSpec, problem: Problem, truth: State, bar: float, units: Units | None
) -> float:
    """The truth's error bar, relative to the number expected.

    Args:
        spec: The check.
        problem: The case's.
        truth: What is held against the number.
        bar: Of `metric_of_bar`, relative to that metric's scale.
        units: The case's; SI where None.
    """
    used = units or Units()
    assert spec.expected is not None
    expected = abs(spec.expected)
    if spec.quantity is None:
        # No component at a point is farther off than the largest error of displacement.
        return bar * truth.max_displacement / used.metres(expected)
    try:
        swing = fit_oscillation(*_series(spec, truth, _point(spec, problem, used)))
    except InputError:
        return math.inf
    return bar * _share_of_expected(spec, swing, used)


def uncertainty_of_fit(
    spec: CheckSpec, problem: Problem, state: State, units: Units | None
) -> float:
    """How far the fit of an oscillation may be off, relative to the number expected.

    0 for a displacement, which is read; 0 where nothing is fitted, which fails for itself.
    """
    if spec.quantity is None:
        return 0.0
    used = units or Units()
    point = _point(spec, problem, used)
    try:
        series = _series(spec, state, point)
        swing, off = fit_oscillation(*series), fit_uncertainty(*series)
    except InputError:
        return 0.0
    return float(getattr(off, spec.quantity)) * _share_of_expected(spec, swing, used)


def _share_of_expected(spec: CheckSpec, swing: Oscillation, used: Units) -> float:
    """What errors of an oscillation are divided by, over the number expected."""
    assert spec.expected is not None
    expected = abs(spec.expected)
    if spec.quantity in _LENGTHS:
        return swing.amplitude / used.metres(expected)
    return swing.frequency / expected


def _series(spec: CheckSpec, state: State, point: int) -> tuple[Points, Points]:
    """Times and the component there."""
    if state.trajectory is None:
        raise InputError("there is no trajectory")
    return state.trajectory.times, state.trajectory.displacements[:, point, _axis(spec)]


def _axis(spec: CheckSpec) -> int:
    assert spec.component is not None
    return "xyz".index(spec.component)


def _point(spec: CheckSpec, problem: Problem, used: Units) -> int:
    assert spec.at is not None
    place = np.array([used.metres(x) for x in spec.at])
    apart = np.linalg.norm(problem.mesh.points - place, axis=1)
    point = int(apart.argmin())
    if apart[point] > _SAME_PLACE * float(np.ptp(problem.mesh.points, axis=0).max()):
        raise InputError(f"check at {list(spec.at)}: no point of the mesh lies there; mesh it in")
    return point
