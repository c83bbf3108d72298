"""A number of a case file, published or in closed form, beside an answer's own."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.case.regions import part_of_check, point_at
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.metrics import Number, Part
from palpate.validation.metrics.finite import are_measurable
from palpate.validation.metrics.sampling import may_be_alias, too_coarse
from palpate.validation.metrics.time_series import fit_oscillation, fit_uncertainty
from palpate.validation.references.bars import name_of_part
from palpate.validation.states import State

_LENGTHS = ("amplitude", "mean")
_WHOLE = Part(np.zeros(0, dtype=np.int32), np.zeros((0, 3)))


def metric_of_bar(spec: CheckSpec) -> str:
    """Which metric's error bar says how far the truth's number may be off."""
    if spec.quantity is not None:
        return f"oscillation_{spec.quantity}"
    return spec.about.bar_of or spec.metric


def name_of_bar(spec: CheckSpec, problem: Problem, units: Units) -> str:
    """The same, of the part of the body that the check is about."""
    part = part_of_check(spec, problem, units, f"check {spec.metric}")
    metric = metric_of_bar(spec)
    if part is None or not spec.about.is_of_integrals:
        return metric
    return name_of_part(metric, part)


def number_of(spec: CheckSpec, problem: Problem, state: State, units: Units) -> Number | None:
    """The number of a state that a check is about, in SI units; None where it is not told."""
    part = part_of_check(spec, problem, units, f"check {spec.metric}")
    assert spec.about.read is not None
    with np.errstate(over="ignore", invalid="ignore"):
        return spec.about.read(problem, state, part or _WHOLE, spec.component or "")


@dataclass(frozen=True)
class Comparison:
    """One number of an answer beside the number expected.

    Attributes:
        error: Relative to the number expected [-]; infinite where there is none to be had.
        message: One line on it.
        scale: What errors of `metric_of_bar` are divided by, over the number expected [-].
        uncertainty: Of the number expected, as the case states it, and of what was fitted or read
            between states, relative to the number expected [-]; infinite where the states tell
            nothing of it.
        stated: What of that the case states, likewise.
    """

    error: float
    message: str
    scale: float = math.inf
    uncertainty: float = 0.0
    stated: float = 0.0


def compare_published(
    spec: CheckSpec, problem: Problem, state: State, units: Units | None
) -> Comparison:
    """Hold a number of a state against the one expected.

    Of an oscillation: what is fitted to a point's component over time.

    Raises:
        InputError: No point of the mesh lies there, or no such part of the body.
    """
    used = units or Units()
    if spec.about.read is not None:
        return _compare_number(spec, problem, state, used)
    assert spec.component is not None
    assert spec.at is not None
    point = point_at(problem.mesh, spec.at, used, "check")
    axis = "xyz".index(spec.component)
    metre = used.metres(1.0)
    if spec.quantity is None:
        found = float(state.displacement[point, axis]) / metre
        other = state.other_reading
        off = 0.0 if other is None else abs(found - float(other.displacement[point, axis]) / metre)
        # No component at a point is farther off than the largest error of displacement.
        return _compare(spec, found, used.length, state.max_displacement / metre, off)
    motion = state.given
    try:
        if motion is None:
            raise InputError("there is no trajectory")
        series = motion.times, motion.displacements[:, point, axis]
        swing = fit_oscillation(*series)
    except InputError as why:
        return Comparison(math.inf, f"no {spec.quantity} to be had: {why}")
    found = float(getattr(swing, spec.quantity))
    # Also of a truth: its bars are of two fits alike, not of what one fit makes of a motion.
    off = float(getattr(fit_uncertainty(*series, swing), spec.quantity))
    is_frequency = spec.quantity == "frequency"
    wanted = abs(spec.expected or 0.0) if is_frequency else swing.frequency
    why_not = too_coarse(motion, wanted)
    scale = swing.amplitude / metre if spec.quantity in _LENGTHS else swing.frequency
    unit = used.length if spec.quantity in _LENGTHS else "Hz" if is_frequency else "1/s"
    found = found / metre if spec.quantity in _LENGTHS else found
    compared = _compare(spec, found, unit, scale, off * scale)
    if not why_not and compared.error <= spec.limit:
        # What is wrong at any frequency is wrong; what is right may be an alias's.
        why_not = may_be_alias(problem, state.strain, motion, element=state.element)
    if not why_not:
        return compared
    message = f"{compared.message}; {why_not}"
    return dataclasses.replace(compared, message=message, uncertainty=math.inf)


def _compare_number(spec: CheckSpec, problem: Problem, state: State, units: Units) -> Comparison:
    if not are_measurable(*state.fields):
        return Comparison(math.inf, "the displacement is no number, or too large for one")
    found = number_of(spec, problem, state, units)
    if found is None:
        return Comparison(math.inf, f"{state.label} does not tell it")
    unit, name = units.of(spec.about.dimension)
    scale = found.scale / unit
    off = found.doubt
    if state.other_reading is not None:
        other = number_of(spec, problem, state.other_reading, units)
        off += math.inf if other is None else abs(found.value - other.value)
    compared = _compare(spec, found.value / unit, name, scale, off / unit)
    part = part_of_check(spec, problem, units, f"check {spec.metric}")
    if part is None:
        return compared
    where = f"{spec.component}, {part.says}"
    return dataclasses.replace(compared, message=f"{compared.message}; {where}")


def _compare(
    spec: CheckSpec, found: float, unit: str, scale: float, uncertainty: float
) -> Comparison:
    """The scale is that of the metric's bar; it and the uncertainty are in the unit."""
    assert spec.expected is not None
    size = abs(spec.expected)
    error = abs(found - spec.expected) / size
    # That of what was measured or published counts like the answer's own.
    stated = spec.uncertainty or 0.0
    expected = f"{spec.expected:.8g}" + (f" +- {stated:.3g}" if stated else "")
    shown = f"{found:.8g} {unit}, expected {expected}: {error:.2g}"
    message = f"{shown} {'<=' if error <= spec.limit else '>'} {spec.limit:g}"
    return Comparison(error, message, scale / size, (uncertainty + stated) / size, stated / size)
