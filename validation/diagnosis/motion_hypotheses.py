"""Hypotheses of a motion: its first steps are repeated with each mistake in them.

This needs the candidate's step: the case's, or the one that the candidate names. What is
shown in statics by equilibrium is shown here by the steps themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Problem
from palpate.reference.schemes import Integrator, are_whole_steps_apart
from palpate.validation.diagnosis.explanation import (
    OF_MOTION,
    PRESSURE_FOLLOWS,
    PRESSURE_STAYS,
    SINGLE,
    Cause,
    Explanation,
    in_words,
    is_unit,
    load_name,
    snapped,
)
from palpate.validation.diagnosis.material_hypotheses import lame_hypotheses
from palpate.validation.exchange.nodal_arrays import lumped_mass
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.implicit_stepping import (
    ImplicitStepper,
    can_be_stepped,
    consistent_mass,
)
from palpate.validation.metrics.laws import OTHER_STRAIN, laws_instead_of_law
from palpate.validation.metrics.stepping import MotionHypothesis, Stepper
from palpate.validation.states import State

Fields = NDArray[np.float64]
# Cells times steps that are stepped for one hypothesis, and steps at most: some tenths of a second.
_WORK = 3e5
_MOST_STEPS = 500
# A full mass matrix is inverted up to this size.
_FULL_MASS = 600
_FACTORS = (2.0, 0.5, 1e3, 1e-3)
_DAMPINGS = {
    "damping left out": 0.0,
    "damping twice what was asked (D = 2 lambda M)": 2.0,
    "half the damping (D = lambda/2 M)": 0.5,
    "damping reversed in sign": -1.0,
}
_VISCOSITIES = {
    "stiffness damping left out": 0.0,
    "stiffness damping twice what was asked": 2.0,
    "half the stiffness damping": 0.5,
}
_STEPPINGS = {
    "wrong start: the step before the first taken for the first, without half of its "
    "acceleration": MotionHypothesis(start=0.0),
    "wrong start: twice the acceleration at first": MotionHypothesis(start=1.0),
    "another time integration: semi-implicit Euler": MotionHypothesis(is_semi_implicit=True),
    "another time integration: semi-implicit Euler, damping at the end of a step": MotionHypothesis(
        is_semi_implicit=True, is_damped_at_end=True
    ),
    "another time integration: explicit Euler": MotionHypothesis(is_explicit_euler=True),
    "every state stored one step late": MotionHypothesis(late=-1),
    "every state stored one step early": MotionHypothesis(late=1),
}
# Schemes that solve equations, in words, and steps to an output that simulators take with them.
_IMPLICIT = {
    Integrator.BACKWARD_EULER: "backward Euler",
    Integrator.BDF2: "BDF2",
    Integrator.TRAPEZOIDAL: "the trapezoidal rule (Newmark, gamma = 1/2, beta = 1/4)",
    Integrator.IMPLICIT_MIDPOINT: "the implicit midpoint rule",
}
_PER_OUTPUT = (1, 2, 4, 5, 10, 20)
# Outputs that such a step is tried on, and what one costs, in explicit steps: some iterations.
_FEWEST, _MOST, _COST = 3, 8, 10
# Fitted numbers: how far one is moved to see the change, and how often it is corrected.
_NUDGE = 1e-5
_ROUNDS = 8
_UNTRIED = "mechanical mistakes were not tried"


def stepper_of(body: Body, candidate: State) -> tuple[Stepper | None, str]:
    """The stepper of the candidate's motion, or why it cannot be stepped again."""
    span = body.problem.time
    assert span is not None
    step = span.time_step or _stated_step(candidate)
    if body.problem.springs:
        return None, f"A motion with springs is not stepped again: {_UNTRIED}"
    if body.problem.tools:
        return None, f"A motion with tools is not stepped again: {_UNTRIED}"
    if step is None:
        return None, f"No time step is known: {_UNTRIED} (name `time_step`)"
    between = span.end_time / span.num_outputs
    # A step that a candidate claims may be anything above 0.
    per_output = max(1, int(np.ceil(min(between / step, 2 * _MOST_STEPS) * (1.0 - 1e-12))))
    most = min(_MOST_STEPS, int(_WORK / body.mesh.num_cells))
    outputs = min(span.num_outputs, most // per_output)
    if outputs < 1:
        return None, f"Too many steps to an output to repeat here: {_UNTRIED}"
    return Stepper(body, between / per_output, per_output, outputs), ""


def _stated_step(candidate: State) -> float | None:
    said = candidate.says.get("time_step", candidate.details.get("time_step"))
    return said if isinstance(said, float) and 0.0 < said < np.inf else None


def own_steps_of(problem: Problem, candidate: State) -> int | None:
    """Steps to an output of a step that the candidate states and the case does not ask for."""
    span, step = problem.time, _stated_step(candidate)
    if span is None or step is None or not are_whole_steps_apart(span, step):
        return None
    return min(round(span.end_time / span.num_outputs / step), _MOST_STEPS)


def motion_hypotheses(
    stepper: Stepper, fields: Fields, own_steps: int | None = None
) -> Iterator[Explanation]:
    """Try each hypothesis, and numbers to fit where none of the plain ones fits.

    `fields` are the candidate's displacement at the outputs [m], (num_times, num_points, 3), and
    `own_steps` the steps to an output that it states, if it does.
    """
    wanted = fields[1 : stepper.num_outputs + 1]
    stated = _misfit(stepper, MotionHypothesis(), wanted, None)
    if stated <= SINGLE:
        return
    found = False
    for name, cause, hypothesis in _plain_hypotheses(stepper.body, fields):
        left = _misfit(stepper, hypothesis, wanted, SINGLE)
        tried = Explanation(name, cause, left, stated, OF_MOTION, 1)
        found = found or tried.fits
        yield tried
    if not found and can_be_stepped(stepper.body):
        for tried in _other_integrations(stepper, wanted, stated, own_steps):
            found = found or tried.fits
            yield tried
    if not found:
        yield from _fitted(stepper, wanted, stated)


def _other_integrations(
    stepper: Stepper, wanted: Fields, stated: float, own_steps: int | None
) -> Iterator[Explanation]:
    """Schemes and steps that are not the case's; nothing where they would take too long here.

    `own_steps` are those to an output that the candidate's own step makes, where it states one.
    """
    body, given = stepper.body, stepper.per_output
    counts = sorted({*_PER_OUTPUT, given, *([own_steps] if own_steps else [])})
    span = body.problem.time
    assert span is not None
    between = span.end_time / span.num_outputs
    if own_steps and own_steps != given:
        own = replace(stepper, step=between / own_steps, per_output=own_steps)
        for name in [name for name in _STEPPINGS if "integration" in name]:
            left = _misfit(own, _STEPPINGS[name], wanted, SINGLE)
            words = f"{name}, {own_steps} steps to an output"
            yield Explanation(words, Cause.TIME, left, stated, OF_MOTION, 1)
    for count, is_full in ((c, full) for full in (False, True) for c in counts):
        outputs = min(_MOST, len(wanted), int(_WORK / _COST / body.mesh.num_cells / count))
        if outputs < _FEWEST or (is_full and body.mesh.num_points > _FULL_MASS):
            continue
        for scheme, called in _IMPLICIT.items():
            implicit = ImplicitStepper(body, scheme, count, outputs, is_full)
            left = _largest_misfit(implicit.outputs(), wanted[:outputs], SINGLE)
            words = f"another time integration: {called}, steps of {between / count:.4g} s"
            words += ", with the consistent mass matrix" if is_full else ""
            yield Explanation(words, Cause.TIME, left, stated, OF_MOTION, 1 + is_full)


def _misfit(
    stepper: Stepper, hypothesis: MotionHypothesis, wanted: Fields, give_up: float | None
) -> float:
    """See `_largest_misfit`."""
    return _largest_misfit(stepper.outputs(hypothesis), wanted, give_up)


def _largest_misfit(outputs: Iterator[Points], wanted: Fields, give_up: float | None) -> float:
    """Largest distance over the largest displacement; stops where it is beyond `give_up`."""
    scale = float(np.linalg.norm(wanted, axis=-1).max())
    if scale == 0.0:
        return float("inf")
    left, count = 0.0, 0
    for count, state in enumerate(outputs, start=1):
        left = max(left, float(np.linalg.norm(state - wanted[count - 1], axis=-1).max()) / scale)
        if give_up is not None and left > give_up:
            return left
        if count == len(wanted):
            break
    return left if count == len(wanted) else float("inf")


def _plain_hypotheses(body: Body, fields: Fields) -> Iterator[tuple[str, Cause, MotionHypothesis]]:
    problem, span = body.problem, body.problem.time
    assert span is not None
    asked = span.mass_damping
    pressures = any(isinstance(load, Pressure) for load in problem.loads)
    if asked:
        for name, factor in _DAMPINGS.items():
            yield name, Cause.TIME, MotionHypothesis(damping=factor * asked)
    if span.stiffness_damping:
        for name, factor in _VISCOSITIES.items():
            yield name, Cause.TIME, MotionHypothesis(viscosity=factor)
    yield from _mass_hypotheses(body)
    yield from _load_hypotheses(body)
    for name, law in laws_instead_of_law(body.strain, body.law).items():
        yield name, Cause.LAW, MotionHypothesis(law=law)
        if name == OTHER_STRAIN[body.strain] and pressures:
            # Pressures go with the strain measure, or are as they were asked for.
            yield name, Cause.LAW, MotionHypothesis(law=law, is_other_pressure=True)
    yield from _material_hypotheses(body)
    for name, hypothesis in _STEPPINGS.items():
        yield name, Cause.TIME, hypothesis
    for pieces in (2, 4, 8, 10):
        yield f"a time step {pieces} times shorter", Cause.TIME, MotionHypothesis(pieces=pieces)
    for factor in _FACTORS:
        words = f"time runs {in_words(factor)}".replace("counted twice", "twice as fast")
        words = words.replace("halved", "half as fast")
        yield words, Cause.TIME, MotionHypothesis(step_factor=factor)
    for number, support in enumerate(problem.supports, start=1):
        if support.normal is not None:
            continue
        released = np.zeros_like(body.fixed)
        released[np.ix_(support.points, np.flatnonzero(support.components))] = True
        yield f"support {number} is not fixed", Cause.SUPPORT, MotionHypothesis(released=released)
    off = body.fixed & (np.abs(fields - body.prescribed).max(axis=0) > 1e-6 * np.abs(fields).max())
    if off.any():
        count = int(off.any(axis=1).sum())
        name = f"supports are fixed in part: {count} points are not fixed"
        yield name, Cause.SUPPORT, MotionHypothesis(released=off)
    if any(item.amplitude for item in (*problem.loads, *problem.supports)):
        yield "amplitudes left out", Cause.LOAD, MotionHypothesis(with_amplitudes=False)


def _mass_hypotheses(body: Body) -> Iterator[tuple[str, Cause, MotionHypothesis]]:
    mass = lumped_mass(body.problem)
    for factor in _FACTORS:
        yield f"density {in_words(factor)}", Cause.MASS, _weighed(body, factor)
    if body.problem.masses:
        yield "masses on the surface left out", Cause.MASS, _weighed(body, 1.0, 0.0)
    equal = np.full_like(mass, mass.mean())
    yield "another lumping: every point the same mass", Cause.MASS, MotionHypothesis(mass=equal)
    mesh = body.mesh
    at_point = np.bincount(mesh.cells.ravel(), minlength=mesh.num_points)
    shared = MotionHypothesis(mass=mass.sum() * at_point / at_point.sum())
    yield "another lumping: by the number of cells at a point, not by volume", Cause.MASS, shared
    if mesh.num_points <= _FULL_MASS:
        full = consistent_mass(body).toarray()
        yield (
            "another lumping: the consistent mass matrix",
            Cause.MASS,
            MotionHypothesis(inverse_mass=np.linalg.inv(full)),
        )


def _mass_of_cells(body: Body) -> Points:
    return lumped_mass(replace(body.problem, masses=()))


def _weighed(body: Body, of_cells: float, of_masses: float = 1.0) -> MotionHypothesis:
    """With factors on the density of the cells, and on the masses on the surface."""
    own = _mass_of_cells(body)
    hung = lumped_mass(body.problem) - own
    return MotionHypothesis(mass=of_cells * own + of_masses * hung)


def _load_groups(body: Body) -> list[tuple[str, tuple[int, ...]]]:
    """Each load alone, and all of them together, by name."""
    loads = body.problem.loads
    groups: list[tuple[str, tuple[int, ...]]] = [
        (load_name(k, load), (k,)) for k, load in enumerate(loads)
    ]
    return groups if len(loads) < 2 else [*groups, ("every load", tuple(range(len(loads))))]


def _loaded(body: Body, indices: tuple[int, ...], factor: float) -> MotionHypothesis:
    numbers = range(len(body.problem.loads))
    return MotionHypothesis(load_factors=tuple(factor if k in indices else 1.0 for k in numbers))


def _load_hypotheses(body: Body) -> Iterator[tuple[str, Cause, MotionHypothesis]]:
    loads = body.problem.loads
    for name, indices in _load_groups(body):
        for factor in (0.0, 2.0, -1.0):
            words = f"{name} {in_words(factor)}"
            if factor == -1.0 and len(indices) == 1 and isinstance(loads[indices[0]], Pressure):
                words = f"sign of the pressure reversed: {name} pulls"
            yield words, Cause.LOAD, _loaded(body, indices, factor)
    if any(isinstance(load, Pressure) for load in loads):
        name = PRESSURE_STAYS if body.follows else PRESSURE_FOLLOWS
        yield name, Cause.LOAD, MotionHypothesis(is_other_pressure=True)


def _material_hypotheses(body: Body) -> Iterator[tuple[str, Cause, MotionHypothesis]]:
    for name, lame in lame_hypotheses(body.lmbda, body.mu, body.problem.material.law).items():
        yield name, Cause.MATERIAL, MotionHypothesis(lame=lame)
    for factor in (1e3, 1e-3):
        name = f"stiffness {in_words(factor)}"
        yield name, Cause.UNITS, MotionHypothesis(stiffness_factor=factor)


def _fitted(stepper: Stepper, wanted: Fields, stated: float) -> Iterator[Explanation]:
    """One number at a time by Gauss-Newton steps of the motion itself, from what was asked."""
    body = stepper.body
    assert body.problem.time is not None
    damping = body.problem.time.mass_damping
    numbers: list[tuple[str, Cause, Callable[[float], MotionHypothesis]]] = [
        ("density", Cause.MASS, lambda c: _weighed(body, c)),
        ("stiffness", Cause.MATERIAL, lambda c: MotionHypothesis(stiffness_factor=c)),
        ("length of the time step", Cause.TIME, lambda c: MotionHypothesis(step_factor=c)),
    ]
    if body.problem.masses:
        numbers.append(("masses on the surface", Cause.MASS, lambda c: _weighed(body, 1.0, c)))
    if damping:
        numbers.append(("damping", Cause.TIME, lambda c: MotionHypothesis(damping=c * damping)))
    if body.problem.time.stiffness_damping:
        numbers.append(("stiffness damping", Cause.TIME, lambda c: MotionHypothesis(viscosity=c)))
    numbers += [
        (name, Cause.LOAD, partial(_loaded, body, indices)) for name, indices in _load_groups(body)
    ]
    few = replace(stepper, num_outputs=min(stepper.num_outputs, _few_outputs(stepper)))
    for name, cause, mistake_of in numbers:
        factor = _fit(few, mistake_of, wanted[: few.num_outputs])
        known = snapped(factor)
        factor = factor if known is None else known
        left = _misfit(stepper, mistake_of(factor), wanted, None)
        words = f"{name} {in_words(factor)}"
        cause = Cause.UNITS if is_unit(factor) else cause
        yield Explanation(words, cause, left, stated, OF_MOTION, 2)


def _few_outputs(stepper: Stepper) -> int:
    """Enough of the motion to fit a number: some two hundred steps, two outputs at least."""
    return max(2, 200 // stepper.per_output)


def _fit(
    stepper: Stepper, mistake_of: Callable[[float], MotionHypothesis], wanted: Fields
) -> float:
    """The number that brings the motion nearest; 1 where it cannot be found."""

    def motion(factor: float) -> Fields | None:
        states = list(islice(stepper.outputs(mistake_of(factor)), len(wanted)))
        return np.array(states) if len(states) == len(wanted) else None

    factor, last = 1.0, np.inf
    for _ in range(_ROUNDS):
        here, there = motion(factor), motion(factor * (1.0 + _NUDGE))
        if here is None or there is None:
            return 1.0
        slope = (there - here) / (factor * _NUDGE)
        squared = float((slope**2).sum())
        left = float(np.abs(wanted - here).max())
        if squared == 0.0 or left > 0.9 * last:
            return factor
        step = float((slope * (wanted - here)).sum()) / squared
        # A factor does not change sign, and comes no nearer to 0 than half of itself at a time.
        factor, last = max(factor + step, 0.5 * factor), left
        if abs(step) < 1e-13 * factor:
            return factor
    return factor
