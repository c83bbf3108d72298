"""What a scheme damps by itself, as a damping ratio: by its formula, and measured on an answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.reference.schemes import (
    Steps,
    frequency_ratio,
    numerical_damping_ratio,
)
from palpate.validation.metrics.motion import swinging_most
from palpate.validation.metrics.time_series import fit_oscillation, fit_uncertainty
from palpate.validation.states import State

# Of a motion, before which nothing is fitted: quick modes, which a scheme damps most, are in the
# swing until then, and their end would look like the swing's decay.
_EARLY = 1.0 / 3.0
# Angles of a step between which the true frequency is looked for [rad].
_LEAST, _MOST = 1e-9, 1e4
_BISECTIONS = 200


@dataclass(frozen=True)
class NumericalDamping:
    """Of the oscillation of the point that swings most.

    Attributes:
        steps: Scheme and time step.
        frequency: As the answer has it [Hz].
        formula: Damping ratio by the scheme [-].
        measured: That of the answer, less what the case's dampings make of it [-].
        uncertainty: Of `measured`: what other modes leak into the fit, and how far the motion's
            first third would move it [-].
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


def measure_numerical_damping(problem: Problem, answer: State) -> NumericalDamping:
    """Damping by the scheme that an answer states, and the one that it has.

    measured = (g - lambda / 2) / w - beta w / 2 for a decay exp(-g t) at w = 2 pi f under mass
    damping lambda and stiffness damping beta. The formula is of the frequency that the scheme makes
    f of, without them: their product is of second order in the step.

    Args:
        problem: The case's.
        answer: A motion with `steps`.

    Raises:
        InputError: No motion, no stated scheme, nothing that swings for two periods and a quarter,
            or a frequency that the scheme cannot have with this step.

    Note:
        Two modes of nearly one frequency beat: what is measured then is neither's.
    """
    motion = answer.trajectory
    if motion is None or answer.steps is None or problem.time is None:
        raise InputError("numerical damping is of a motion whose scheme and step are stated")
    point, axis = swinging_most(motion)
    along = motion.displacements[:, point] @ axis
    whole = fit_oscillation(motion.times, along)
    late = motion.times >= motion.times[0] + _EARLY * np.ptp(motion.times)
    swing = fit_oscillation(motion.times[late], along[late])
    off = fit_uncertainty(motion.times[late], along[late], swing).damping * swing.frequency
    off += abs(swing.damping - whole.damping)
    omega = 2.0 * math.pi * swing.frequency
    angle = true_angle(answer.steps, swing.frequency)
    return NumericalDamping(
        answer.steps,
        swing.frequency,
        numerical_damping_ratio(answer.steps.integrator, angle),
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
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if of(middle) < shown else (low, middle)
    return math.sqrt(low * high)
