"""A fit of numbers to measurements that says what the measurements do not know.

Least squares of residuals over their standard uncertainties, with bounds, each parameter scaled by
half the width of its bounds (`scipy.optimize.least_squares`, trust region reflective). Intervals
are the linearised ones, value +- t s sqrt((J^T J)^-1_kk), with Student's t and s^2 the sum of
squares over its degrees of freedom (G. A. F. Seber, C. J. Wild, Nonlinear Regression, 1989, section
5.1); where another parameter cannot be identified, they reach to the optima with it at either of
its bounds. A combination of parameters, a right singular vector of J, is *not identifiable* where
its interval is wider than the bounds: the measurement adds nothing to what was known before.

A coarse model searches; where a finer one is given, a last Gauss-Newton step from its optimum
with the finer predictions and the coarse derivatives keeps the mesh's error out of the parameters.

The verdict of a prediction is after ASME V&V 20-2009: passed where |E| + 2 u_val <= limit, failed
where |E| - 2 u_val > limit, inconclusive otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.validation.judging.measured import Validation

Prediction: TypeAlias = Callable[[Floats], Floats]
# A Gauss-Newton step between two discretisations is small, or the coarse one says nothing.
_LARGEST_STEP = 0.5


class FitError(InputError):
    """A fit cannot be made of what is given; the message names the thing and the remedy."""


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted.

    Attributes:
        name: Key of the case, such as `material.youngs_modulus`.
        start: First guess, within the bounds.
        lower: Least value that is thought possible before measuring.
        upper: Largest such value.

    Raises:
        FitError: Not finite, or not lower < start < upper.
    """

    name: str
    start: float
    lower: float
    upper: float

    def __post_init__(self) -> None:
        if not -math.inf < self.lower < self.start < self.upper < math.inf:
            raise FitError(
                f"{self.name}: needs lower < start < upper, all finite; got {self.lower:g}, "
                f"{self.start:g}, {self.upper:g}"
            )

    @property
    def scale(self) -> float:
        """Half the width of the bounds."""
        return 0.5 * (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class Experiment:
    """What was measured, and what the model says to it.

    Attributes:
        name: For people.
        labels: Of each value, for tables.
        values: Measured, shape (n,).
        uncertainty: Standard uncertainty of each value, shape (n,), > 0, in the values' unit.
        predict: Values by the parameters, shape (num_parameters,).
        derivatives: Of the predicted values, shape (n, num_parameters); None takes differences.
        finer: Values by a finer model, for the last step; None where there is none.

    Raises:
        FitError: Shapes differ, values are not finite, or an uncertainty is not above 0.
    """

    name: str
    labels: Sequence[str]
    values: Floats
    uncertainty: Floats
    predict: Prediction
    derivatives: Prediction | None = None
    finer: Prediction | None = None

    def __post_init__(self) -> None:
        sizes = {len(self.labels), len(self.values), len(self.uncertainty)}
        if len(sizes) > 1 or not np.isfinite(self.values).all():
            raise FitError(
                f"experiment {self.name}: needs one finite value, label and uncertainty for each"
            )
        bad = np.flatnonzero(~((self.uncertainty > 0.0) & np.isfinite(self.uncertainty)))
        if len(bad):
            raise FitError(
                f"experiment {self.name}: uncertainty of {self.labels[bad[0]]} is "
                f"{self.uncertainty[bad[0]]:g}; state one above 0, or measure more runs"
            )


class Blind(NamedTuple):
    """A combination of parameters that the measurements cannot tell.

    `direction` are its parts, one for each parameter, over half the width of the bounds, of norm 1;
    `half_width` that of its interval in the same scale, above 1.
    """

    direction: Floats
    half_width: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Values with what is known of them.

    Attributes:
        parameters: What was fitted.
        values: Shape (num_parameters,).
        covariance: Standard uncertainties squared and their products, in the parameters' units.
        half_widths: Of the intervals; at most the distance of the bounds.
        confidence: Of the intervals, such as 0.95.
        singular_values: Of the scaled Jacobian, falling.
        blind: Combinations that the measurements cannot tell.
        residuals: Measured less predicted by experiment, in the values' unit.
        scatter: s, root of the sum of squares over its degrees of freedom [-]; about 1 where the
            stated uncertainties explain the residuals.
        degrees: Degrees of freedom.
        step: The last step by the finer model, in the parameters' units; None without one.
    """

    parameters: tuple[Parameter, ...]
    values: Floats
    covariance: Floats
    half_widths: Floats
    confidence: float
    singular_values: Floats
    blind: tuple[Blind, ...]
    residuals: dict[str, Floats]
    scatter: float
    degrees: int
    step: Floats | None

    @property
    def correlation(self) -> Floats:
        """Of the parameters, shape (num_parameters, num_parameters)."""
        spread = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(spread, spread))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of parameters whose interval is no narrower than their bounds."""
        return tuple(
            p.name for p, w in zip(self.parameters, self.half_widths, strict=True) if w >= p.scale
        )


def fit(parameters: Sequence[Parameter], experiments: Sequence[Experiment], *,
        confidence: float = 0.95) -> Fit:  # fmt: skip
    """Fit parameters to measurements.

    Args:
        parameters: One or more, of different names.
        experiments: One or more, with more values than parameters together.
        confidence: Of the intervals, between 0 and 1.

    Returns:
        Values, intervals and what the measurements cannot tell.

    Raises:
        FitError: Too few values, a confidence out of range, a prediction of another shape or not
            finite, an optimum that was not found, or a last step that is too large.
    """
    from scipy.optimize import least_squares
    from scipy.stats import t as student

    if not 0.0 < confidence < 1.0:
        raise FitError(f"confidence = {confidence:g}: needs a value between 0 and 1")
    if not parameters or len({p.name for p in parameters}) < len(parameters):
        raise FitError("needs one or more parameters, each named once")
    degrees = sum(len(x.values) for x in experiments) - len(parameters)
    if degrees < 1:
        raise FitError(
            f"{degrees + len(parameters)} values for {len(parameters)} parameters leave nothing to "
            "judge the fit by; measure more, or fit fewer parameters"
        )
    scale = np.array([p.scale for p in parameters])
    bounds = np.array([(p.lower, p.upper) for p in parameters]).T / scale

    def residual(z: Floats) -> Floats:
        return np.concatenate([_residual(x, x.predict, z * scale) for x in experiments])

    def jacobian(z: Floats) -> Floats:
        return np.vstack([_jacobian(x, z, scale, bounds) for x in experiments])

    start = np.array([p.start for p in parameters]) / scale
    found = least_squares(residual, start, jac=jacobian, bounds=bounds, xtol=1e-10, ftol=1e-12)
    if not found.success:
        raise FitError(f"no optimum was found ({found.message}); state a better start")
    z, slope = np.asarray(found.x), jacobian(found.x)
    left, step = np.asarray(found.fun), None
    if any(x.finer for x in experiments):
        z, left = _finer(experiments, z, slope, scale, bounds)
        step = (z - found.x) * scale
    scatter = math.sqrt(float(left @ left) / degrees)
    _, sizes, directions = np.linalg.svd(slope, full_matrices=False)
    factor = float(student.ppf(0.5 + 0.5 * confidence, degrees)) * scatter
    # A singular value of rounding only is none.
    safe = np.maximum(sizes, np.finfo(float).eps * max(float(sizes[0]), 1e-300))
    covariance = (directions.T * (scatter / safe) ** 2) @ directions
    widths = factor / max(scatter, 1e-300) * np.sqrt(np.diag(covariance)) if scatter else 0.0 * z
    lost = [k for k, width in enumerate(widths) if width >= 1.0]
    for k in lost:
        # Linear intervals of the others end where what cannot be identified bends away.
        for end in bounds[:, k]:
            other = _with_fixed(residual, jacobian, z, bounds, k, float(end))
            widths = np.maximum(widths, np.abs(other - z) * (np.arange(len(z)) != k))
    ends = np.cumsum([len(x.values) for x in experiments])[:-1]
    return Fit(
        tuple(parameters),
        z * scale,
        covariance * np.outer(scale, scale),
        np.minimum(widths, 2.0) * scale,
        confidence,
        sizes,
        tuple(Blind(d, factor / s) for d, s in zip(directions, safe, strict=True) if factor > s),
        {
            x.name: -part * x.uncertainty
            for x, part in zip(experiments, np.split(left, ends), strict=True)
        },
        scatter,
        degrees,
        step,
    )


def _with_fixed(
    residual: Prediction, jacobian: Prediction, z: Floats, bounds: Floats, k: int, value: float
) -> Floats:
    """The optimum with one parameter fixed."""
    from scipy.optimize import least_squares

    others = np.arange(len(z)) != k
    if not others.any():
        return np.array([value])

    def whole(part: Floats) -> Floats:
        full = np.full(len(z), value)
        full[others] = part
        return full

    found = least_squares(
        lambda part: residual(whole(part)),
        z[others],
        jac=lambda part: jacobian(whole(part))[:, others],
        bounds=bounds[:, others],
        xtol=1e-6,
    )
    return whole(np.asarray(found.x))


def _residual(experiment: Experiment, predict: Prediction, values: Floats) -> Floats:
    predicted = np.asarray(predict(values), float)
    if predicted.shape != np.shape(experiment.values) or not np.isfinite(predicted).all():
        raise FitError(
            f"experiment {experiment.name}: the prediction at {values.tolist()} is not "
            f"{len(experiment.values)} finite values; narrow the bounds"
        )
    return np.asarray((predicted - experiment.values) / experiment.uncertainty)


def _jacobian(experiment: Experiment, z: Floats, scale: Floats, bounds: Floats) -> Floats:
    if experiment.derivatives is not None:
        slope = np.asarray(experiment.derivatives(z * scale), float) * scale
        return np.asarray(slope / np.asarray(experiment.uncertainty)[:, None])
    columns = []
    for k in range(len(z)):
        # The bounds are 2 apart: a ten-thousandth of them, and never beyond.
        ahead, behind = z.copy(), z.copy()
        ahead[k] = min(z[k] + 1e-4, bounds[1, k])
        behind[k] = max(z[k] - 1e-4, bounds[0, k])
        pair = [_residual(experiment, experiment.predict, x * scale) for x in (ahead, behind)]
        columns.append((pair[0] - pair[1]) / (ahead[k] - behind[k]))
    return np.column_stack(columns)


def _finer(experiments: Sequence[Experiment], z: Floats, slope: Floats, scale: Floats,
           bounds: Floats) -> tuple[Floats, Floats]:  # fmt: skip
    """The optimum after a step by the finer predictions, and the residuals it leaves."""
    left = np.concatenate([_residual(x, x.finer or x.predict, z * scale) for x in experiments])
    # Combinations that the data cannot tell stay where they are.
    step = -np.linalg.lstsq(slope, left, rcond=1e-6)[0]
    if np.abs(step).max() > _LARGEST_STEP:
        worst = int(np.argmax(np.abs(step)))
        raise FitError(
            f"the finer model moves parameter {worst + 1} by {abs(step[worst]) * scale[worst]:g}, "
            "over a quarter of its bounds; search on a finer mesh"
        )
    moved = np.clip(z + step, *bounds)
    return moved, np.asarray(left + slope @ (moved - z))


def predict_held_out(found: Fit, experiment: Experiment, *, limit: Floats, numerical: Floats,
                     other_inputs: Floats | None = None) -> list[Validation]:  # fmt: skip
    """Predict an experiment that took no part in a fit, and judge each value.

    Args:
        found: The fit.
        experiment: What was set apart; its finer prediction is used where it has one.
        limit: Largest error that is allowed, written before the fit, shape (n,), > 0.
        numerical: Standard uncertainty of the predictions by mesh and solver, shape (n,).
        other_inputs: Standard uncertainty by inputs that were not fitted, shape (n,).

    Returns:
        One for each value.
    """
    scale = np.array([p.scale for p in found.parameters])
    bounds = np.array([(p.lower, p.upper) for p in found.parameters]).T / scale
    predict = experiment.finer or experiment.predict
    error = _residual(experiment, predict, found.values) * experiment.uncertainty
    slope = _jacobian(experiment, found.values / scale, scale, bounds)
    slope = slope * np.asarray(experiment.uncertainty)[:, None] / scale
    variance = np.einsum("ik,kl,il->i", slope, found.covariance, slope)
    if other_inputs is not None:
        variance = variance + np.asarray(other_inputs) ** 2
    rows = zip(error, numerical, np.sqrt(variance), experiment.uncertainty, limit, strict=True)
    return [Validation(*map(float, row)) for row in rows]
