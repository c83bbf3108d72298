"""Amplitude, frequency, phase and damping of an oscillation, and their errors.

A damped cosine x(t) = c + A exp(-g t) cos(w t + p) is fitted to the samples: for given w and g the
rest is linear least squares, so only those two are searched for (variable projection; Golub and
Pereyra 1973), by Gauss-Newton from the best of a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.meshes.errors import InputError
from palpate.validation.metrics.difference import are_measurable, largest

Array = NDArray[np.float64]
# Less than this many periods do not separate frequency from damping.
FEWEST_PERIODS = 1.5
_FEWEST_SAMPLES = 12
_SHIFTS = 12
_WINDOWS = 8
# Frequencies on the grid of a first guess; more of them cost more than they show.
_MOST_FREQUENCIES = 1200
_SLOWEST = 24
_PEAKS = 5
# Number of frequencies of each decay rate's grid that are fitted one by one.
_FITTED = 4
# Cosine and sine are separated where their Gram determinant is this part of what it would be
# at right angles.
_DETERMINED = 1e-8


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
        mean: Difference of the centres of oscillation, over the reference's amplitude [-].
    """

    amplitude: float
    frequency: float
    phase: float
    damping: float
    mean: float


def fit_oscillation(times: ArrayLike, values: ArrayLike) -> Oscillation:
    """Fit a damped cosine to n >= 12 finite values at increasing times [s], 1.5 periods or more.

    Raises:
        InputError: Too few samples or periods, a constant series, or NaN.
    """
    t = np.asarray(times, dtype=np.float64)
    x = np.asarray(values, dtype=np.float64)
    if t.shape != x.shape or t.ndim != 1 or len(t) < _FEWEST_SAMPLES:
        raise InputError(f"an oscillation needs {_FEWEST_SAMPLES} samples; got {x.shape}")
    if not (are_measurable(t, x) and (np.diff(t) > 0.0).all()):
        raise InputError("an oscillation needs finite values at increasing times")
    spread = float(np.sqrt(np.mean((x - x.mean()) ** 2)))
    if spread <= 1e-12 * float(np.abs(x).max()):
        raise InputError("the series does not oscillate")
    t = t - t[0]
    found = _best_fit(t.tobytes(), x.tobytes(), spread)
    periods = found.frequency * float(t[-1])
    if periods < FEWEST_PERIODS:
        raise InputError(f"{periods:.2g} periods in the series; {FEWEST_PERIODS} are needed")
    return found


@lru_cache(maxsize=32)
def _best_fit(times: bytes, values: bytes, spread: float) -> Oscillation:
    """Fit of a series that begins at 0 s; every number of one swing asks for the same fit."""
    t, x = np.frombuffer(times), np.frombuffer(values)
    return _refine(t, x, *_first_guess(t, x), spread)


def fit_uncertainty(
    times: ArrayLike, values: ArrayLike, fitted: Oscillation | None = None
) -> OscillationError:
    """How far a fit may be off because the series is not one cosine: other modes leak into it.

    What the fit leaves over is moved along time, end to start, with the cosine's decay (that of all
    modes under damping by mass), added to the cosine, and fitted again: had the rest come at
    another phase, this is what would have been found (a bootstrap that preserves the rest's
    frequencies; Politis and Romano 1992). Its mean stays, so the series is also fitted without
    parts of its last period. Largest error of all. `fitted` is the result of `fit_oscillation`.
    """
    t = np.asarray(times, dtype=np.float64)
    x = np.asarray(values, dtype=np.float64)
    fitted = fitted or fit_oscillation(t, x)
    t = t - t[0]
    w, g = 2.0 * math.pi * fitted.frequency, fitted.damping
    rest = _misfit(t, x, w, g)
    cosine, decay = x - rest, np.exp(np.clip(-g * t, -50.0, 50.0))
    spread = float(np.sqrt(np.mean((x - x.mean()) ** 2)))
    duration = float(t[-1])
    errors = []
    for shift in np.linspace(0, len(t), _SHIFTS + 1, dtype=int)[1:-1]:
        again = _refine(t, cosine + decay * np.roll(rest / decay, shift), w, g, spread)
        errors.append(oscillation_error(again, fitted, duration))
    # A quarter at most: less than a period and a half says nothing.
    in_period = min(int(np.count_nonzero(t > duration - 1.0 / fitted.frequency)), len(t) // 4)
    for less in np.unique(np.linspace(1, in_period, _WINDOWS, dtype=int)):
        again = _refine(t[:-less], x[:-less], w, g, spread)
        errors.append(oscillation_error(again, fitted, duration))
    return OscillationError(
        **{
            field.name: largest(getattr(error, field.name) for error in errors)
            for field in fields(OscillationError)
        }
    )


def oscillation_error(
    candidate: Oscillation, reference: Oscillation, duration: float
) -> OscillationError:
    """Sizes of the errors over a series of this duration [s]."""
    offset = oscillation_offset(candidate, reference, duration)
    return OscillationError(**{f.name: abs(getattr(offset, f.name)) for f in fields(offset)})


def oscillation_offset(
    candidate: Oscillation, reference: Oscillation, duration: float
) -> OscillationError:
    """The errors with their signs: candidate less reference."""
    turns = (candidate.phase - reference.phase) / (2.0 * math.pi)
    turns -= round(turns)
    turns += (candidate.frequency - reference.frequency) * duration
    return OscillationError(
        amplitude=(candidate.amplitude - reference.amplitude) / reference.amplitude,
        frequency=(candidate.frequency - reference.frequency) / reference.frequency,
        phase=turns,
        damping=(candidate.damping - reference.damping) / reference.frequency,
        mean=(candidate.mean - reference.mean) / reference.amplitude,
    )


def _refine(t: Array, x: Array, w: float, g: float, spread: float) -> Oscillation:
    """The best fit by Gauss-Newton from an angular frequency [rad/s] and a decay rate [1/s]."""
    best = _misfit(t, x, w, g)
    for _ in range(100):
        step = 1e-6 * w
        J = np.column_stack(
            [
                (_misfit(t, x, w + step, g) - _misfit(t, x, w - step, g)) / (2 * step),
                (_misfit(t, x, w, g + step) - _misfit(t, x, w, g - step)) / (2 * step),
            ]
        )
        move = np.linalg.lstsq(J, -best, rcond=None)[0]
        fraction = 1.0
        while fraction > 1e-4:
            tried = _misfit(t, x, w + fraction * move[0], g + fraction * move[1])
            if float(tried @ tried) < float(best @ best):
                break
            fraction /= 2.0
        else:
            break
        w, g, best = w + fraction * move[0], g + fraction * move[1], tried
        if float(np.abs(fraction * move).max()) <= 1e-13 * w:
            break
    c, a, b = _coefficients(t, x, w, g)
    return Oscillation(
        mean=c,
        amplitude=math.hypot(a, b),
        frequency=w / (2.0 * math.pi),
        phase=math.atan2(-b, a),
        damping=g,
        misfit=float(np.sqrt(np.mean(best**2))) / spread,
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
    """Angular frequency [rad/s] and decay rate [1/s] of the best fit on a grid.

    The grid ends where the samples show nothing more (Nyquist). Of long series it has the slowest
    frequencies and those around the peaks of the spectrum.
    """
    span = float(t[-1])
    step = 0.5 * math.pi / span
    numbers = np.arange(2, 2 * (len(t) - 1))
    if len(numbers) > _MOST_FREQUENCIES:
        even = np.interp(np.linspace(0.0, span, len(t)), t, x - x.mean())
        # The spectrum's lines are a turn over the series apart, four steps of the grid.
        peaks = 4 * np.argsort(np.abs(np.fft.rfft(even)))[-_PEAKS:]
        around = (peaks[:, None] + np.arange(-4, 5)).ravel()
        wanted = np.union1d(np.arange(2, _SLOWEST), around)
        numbers = wanted[(wanted >= 2) & (wanted < 2 * (len(t) - 1))]
    frequencies = step * numbers
    rates = np.array([0.0, 1.0, 3.0, 6.0]) / span
    few = _nearest_fits(t, x, frequencies, rates)
    near = [(float(frequencies[k]), float(g)) for k, g in few]
    return min((float(np.sum(_misfit(t, x, w, g) ** 2)), w, g) for w, g in near)[1:]


def _nearest_fits(
    t: Array, x: Array, frequencies: Array, rates: Array
) -> list[tuple[np.int64, np.float64]]:
    """Which frequencies by number, with which decay rate, leave least of a series: a few of each.

    By normal equations of all at once, which lose half of the digits: the few are then fitted one
    by one. A frequency at which cosine and sine cannot be separated is always among them.
    """
    turns = np.multiply.outer(frequencies, t)
    waves = np.cos(turns), np.sin(turns)
    about = x - x.mean()
    few = []
    for g in rates:
        decay = np.exp(np.clip(-g * t, -50.0, 50.0))
        # The constant is taken out of everything beforehand.
        cosine, sine = (decay * wave - (wave @ decay / len(t))[:, None] for wave in waves)
        a, b = cosine @ about, sine @ about
        products = (cosine, cosine), (sine, sine), (cosine, sine)
        aa, bb, ab = (np.einsum("wt,wt->w", *pair) for pair in products)
        determinant = aa * bb - ab**2
        is_known = determinant > _DETERMINED * aa * bb
        fitted = (bb * a**2 - 2.0 * ab * a * b + aa * b**2) / np.where(is_known, determinant, 1.0)
        explained = np.where(is_known, fitted, np.inf)
        count = _FITTED + int(np.count_nonzero(~is_known))
        few += [(k, g) for k in np.argsort(-explained, kind="stable")[:count]]
    return few
