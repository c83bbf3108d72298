"""Amplitude, frequency, phase and damping of an oscillation, and their errors.

A damped cosine x(t) = c + A exp(-g t) cos(w t + p) is fitted to the samples: for given w and g the
rest is linear least squares, so only those two are searched for (variable projection; Golub and
Pereyra 1973), by Gauss-Newton from the best of a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.meshes.errors import InputError

Array = NDArray[np.float64]
# Less than this many periods do not tell frequency from damping.
FEWEST_PERIODS = 1.5
_FEWEST_SAMPLES = 12


@dataclass(frozen=True)
class Oscillation:
    """The damped cosine nearest to a series.

    Attributes:
        mean: c, in the series' unit.
        amplitude: A at the first sample, in the series' unit, >= 0.
        frequency: w / 2 pi [Hz].
        phase: p at the first sample [rad], in (-pi, pi].
        damping: g [1/s]; mass damping alpha gives alpha / 2.
        misfit: Root mean square of what is left, over that of the series about its mean [-].
    """

    mean: float
    amplitude: float
    frequency: float
    phase: float
    damping: float
    misfit: float


@dataclass(frozen=True)
class OscillationError:
    """Candidate against reference.

    Attributes:
        amplitude: Relative to the reference's amplitude [-].
        frequency: Relative to the reference's frequency [-].
        phase: Difference of phase at the end of the series, in periods [-]: frequency errors
            add up in it.
        damping: Difference of the decay rates times the reference's period [-]: the relative
            error of amplitude that one period adds.
        mean: Of the centre of oscillation, over the reference's amplitude [-].
    """

    amplitude: float
    frequency: float
    phase: float
    damping: float
    mean: float


def fit_oscillation(times: ArrayLike, values: ArrayLike) -> Oscillation:
    """Fit a damped cosine.

    Args:
        times: [s], increasing, shape (n,), n >= 12; at least 1.5 periods.
        values: Shape (n,), finite.

    Raises:
        InputError: Too few samples or periods, a constant series, or NaN.
    """
    t = np.asarray(times, dtype=np.float64)
    x = np.asarray(values, dtype=np.float64)
    if t.shape != x.shape or t.ndim != 1 or len(t) < _FEWEST_SAMPLES:
        raise InputError(f"an oscillation needs {_FEWEST_SAMPLES} samples; got {x.shape}")
    if not (np.isfinite(t).all() and np.isfinite(x).all() and (np.diff(t) > 0.0).all()):
        raise InputError("an oscillation needs finite values at increasing times")
    spread = float(np.sqrt(np.mean((x - x.mean()) ** 2)))
    if spread <= 1e-12 * float(np.abs(x).max()):
        raise InputError("the series does not oscillate")
    t = t - t[0]
    span = float(t[-1])
    w, g = _first_guess(t, x)
    best = _misfit(t, x, w, g)
    for _ in range(100):
        steps = np.array([1e-6 * w, 1e-6 * w])
        J = np.column_stack(
            [
                (_misfit(t, x, w + steps[0], g) - _misfit(t, x, w - steps[0], g)) / (2 * steps[0]),
                (_misfit(t, x, w, g + steps[1]) - _misfit(t, x, w, g - steps[1])) / (2 * steps[1]),
            ]
        )
        move = np.linalg.lstsq(J, -best, rcond=None)[0]
        share = 1.0
        while share > 1e-4:
            tried = _misfit(t, x, w + share * move[0], g + share * move[1])
            if float(tried @ tried) < float(best @ best):
                break
            share /= 2.0
        else:
            break
        w, g, best = w + share * move[0], g + share * move[1], tried
        if float(np.abs(share * move).max()) <= 1e-13 * w:
            break
    if w * span < FEWEST_PERIODS * 2.0 * math.pi:
        raise InputError(
            f"{w * span / (2.0 * math.pi):.2g} periods in the series; {FEWEST_PERIODS} are needed"
        )
    c, a, b = _coefficients(t, x, w, g)
    return Oscillation(
        mean=c,
        amplitude=math.hypot(a, b),
        frequency=w / (2.0 * math.pi),
        phase=math.atan2(-b, a),
        damping=g,
        misfit=float(np.sqrt(np.mean(best**2))) / spread,
    )


def oscillation_error(
    candidate: Oscillation, reference: Oscillation, duration: float
) -> OscillationError:
    """Errors over a series of this duration [s]."""
    turns = (candidate.phase - reference.phase) / (2.0 * math.pi)
    turns -= round(turns)
    turns += (candidate.frequency - reference.frequency) * duration
    return OscillationError(
        amplitude=abs(candidate.amplitude - reference.amplitude) / reference.amplitude,
        frequency=abs(candidate.frequency - reference.frequency) / reference.frequency,
        phase=abs(turns),
        damping=abs(candidate.damping - reference.damping) / reference.frequency,
        mean=abs(candidate.mean - reference.mean) / reference.amplitude,
    )


def _basis(t: Array, w: float, g: float) -> Array:
    decay = np.exp(np.clip(-g * t, -50.0, 50.0))
    return np.column_stack([np.ones_like(t), decay * np.cos(w * t), decay * np.sin(w * t)])


def _coefficients(t: Array, x: Array, w: float, g: float) -> tuple[float, float, float]:
    c, a, b = np.linalg.lstsq(_basis(t, w, g), x, rcond=None)[0]
    return float(c), float(a), float(b)


def _misfit(t: Array, x: Array, w: float, g: float) -> Array:
    basis = _basis(t, w, g)
    left: Array = x - basis @ np.linalg.lstsq(basis, x, rcond=None)[0]
    return left


def _first_guess(t: Array, x: Array) -> tuple[float, float]:
    """Angular frequency [rad/s] and decay rate [1/s] of the best fit on a grid."""
    span = float(t[-1])
    highest = math.pi * (len(t) - 1) / span
    grid = np.arange(math.pi / span, highest, 0.5 * math.pi / span)
    rates = np.array([0.0, 1.0, 3.0, 6.0]) / span
    left = [
        (float(np.sum(_misfit(t, x, w, g) ** 2)), float(w), float(g)) for w in grid for g in rates
    ]
    return min(left)[1:]
