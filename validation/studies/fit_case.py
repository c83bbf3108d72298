"""Numbers of a case fitted to its measurements, and what was set apart predicted.

fastsim searches on the case's mesh. The last step is by a better model, so that the error of the
mesh is not fitted into a modulus: quadratic elements of the reference on the same mesh, or fastsim
on cells of two thirds the edge. How far the better model may itself be off, u_num, is of the
reference its difference from the case's stored truth and the truth's error bar, both relative to
the largest displacement; where no truth is stored, and of the finer mesh, the difference of both
models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element
from palpate.reference.availability import is_available, require_available
from palpate.validation.case import Case
from palpate.validation.case.measurements import Measured, read_measurements
from palpate.validation.case.variants import known_keys, require_keys, value_of
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.measured import COVERAGE_OF_BAR, Validation, input_variance
from palpate.validation.judging.measured_model import (
    Prediction,
    derivatives,
    of_equilibrium,
    solve_measured,
)
from palpate.validation.references.reference_set import QUADRATIC
from palpate.validation.solving import Simulator, solve
from palpate.validation.states import Progress, in_silence
from palpate.validation.studies.fit import (
    Experiment,
    Fit,
    FitError,
    Parameter,
    fit,
    predict_held_out,
)

# Of a modulus or a load nothing is known before it is measured: a quarter to four times its value.
_FACTOR = 4.0
# Of a number that is 0 in the case a bound has no scale.
_POISSON = "poissons_ratio"
_POISSONS_BOUNDS = (0.0, 0.499)
_FINER = 2.0 / 3.0
_EDGES = ("geometry.edge_length", "mesh.edge_length")
# What would tell a number that the data cannot, by the end of its key.
_REMEDIES = {
    _POISSON: "measure a change of width or volume, or press it between plates",
    "modulus": "measure under a force that is known, or the force that a known motion takes",
    "density": "measure a rest position and a frequency: both together tell mass from stiffness",
    "mass": "measure a rest position and a frequency: both together tell mass from stiffness",
}


# Values of a measurement by the numbers that are fitted.
Model: TypeAlias = Callable[[Measured, Floats], Floats]


class LastStep(StrEnum):
    """The model of the last step: quadratic elements of the reference, a finer mesh, or none."""

    REFERENCE = "reference"
    MESH = "mesh"
    NONE = "none"


@dataclass(frozen=True, eq=False)
class CaseFit:
    """A fit to measurements of a case.

    Attributes:
        case: The case whose numbers were fitted.
        fit: Values, intervals, correlations and residuals.
        measured: Every measurement that was used or predicted, by name.
        used: Names of those that were fitted to.
        predictions: What the last model says of each measurement, at the fitted values.
        held_out: Of each measurement that was set apart, its values judged; see `Validation`.
        by_run: Fitted values by each run alone, where all measurements have as many.
        last_step: The model of the last step.
        element: Tetrahedra of the search.
        coarse: Values before the last step.
    """

    case: Case
    fit: Fit
    measured: Mapping[str, Measured]
    used: tuple[str, ...]
    predictions: Mapping[str, Floats]
    held_out: Mapping[str, list[Validation]]
    by_run: tuple[Floats, ...]
    last_step: LastStep
    element: Element

    @property
    def values(self) -> dict[str, float]:
        """Fitted numbers by key, in the case's units."""
        names = [parameter.name for parameter in self.fit.parameters]
        return dict(zip(names, map(float, self.fit.values), strict=True))

    @property
    def coarse(self) -> Floats:
        """Values before the last step."""
        return self.fit.values - (0.0 if self.fit.step is None else self.fit.step)

    def score(self) -> tuple[float, float]:
        """Root mean square of what was set apart, over its limits, and two u_val of it [-]."""
        rows = [row for rows in self.held_out.values() for row in rows]
        if not rows:
            return math.nan, math.nan
        sizes = [row.limit if math.isfinite(row.limit) else 1.0 for row in rows]
        errors = [row.error / size for row, size in zip(rows, sizes, strict=True)]
        doubts = [row.doubt / size for row, size in zip(rows, sizes, strict=True)]
        error, doubt = (float(np.sqrt(np.mean(np.square(x)))) for x in (errors, doubts))
        return error, doubt

    def remedy(self, name: str) -> str:
        """What would tell a parameter that these measurements cannot."""
        ways = [words for ending, words in _REMEDIES.items() if name.endswith(ending)]
        return ways[0] if ways else "measure what moves with it and not with the others"


def parameters_of(
    case: Case, keys: Sequence[str], bounds: Mapping[str, tuple[float, float]] | None = None
) -> list[Parameter]:
    """Parameters by their keys, which begin at the case's values.

    Args:
        case: The case.
        keys: Keys of numbers, one or more, each once.
        bounds: Least and largest value that is thought possible, by key, in the case's units; a
            quarter to four times the case's value where nothing is said, 0 to 0.499 of a
            Poisson's ratio.

    Returns:
        In the order of the keys.

    Raises:
        InputError: A key that the case gives no number for, bounds of another key, or a value that
            is 0 or lies outside of its bounds.
    """
    require_keys(case, keys, "--parameter")
    given = dict(bounds or {})
    if other := [key for key in given if key not in keys]:
        raise InputError(f"--bounds {other[0]}: it is not fitted; add --parameter {other[0]}")
    made = []
    for key in keys:
        start = value_of(case, key)
        if key in given:
            low, high = given[key]
        elif key.endswith(_POISSON):
            low, high = _POISSONS_BOUNDS
        elif start:
            low, high = sorted((start / _FACTOR, start * _FACTOR))
        else:
            raise FitError(f"{key} is 0 in the case; state --bounds {key}=LOW:HIGH")
        made.append(Parameter(key, start, low, high))
    return made


class _Body:
    """The experiments of one set of numbers on one mesh: each equilibrium is found once."""

    def __init__(self, keys: Sequence[str], element: Element, more: Mapping[str, float]) -> None:
        self.keys, self.element, self.more = tuple(keys), element, dict(more)
        self._mesh: Case | None = None
        self._last: dict[str, tuple[Floats, Case, Prediction]] = {}
        self._equilibria: dict[str, tuple[Floats, Points]] = {}

    def numbers(self, values: Floats) -> dict[str, float]:
        return {**self.more, **dict(zip(self.keys, map(float, values), strict=True))}

    def predicted(self, measured: Measured, values: Floats) -> tuple[Case, Prediction]:
        name, alike = measured.spec.name, repr(sorted(measured.spec.set.items()))
        last = self._last.get(name)
        if last is not None and np.array_equal(last[0], values):
            return last[1], last[2]
        case = measured.at(self.numbers(values), like=self._mesh)
        self._mesh = self._mesh or case
        known = self._equilibria.get(alike)
        is_of_markers = measured.spec.kind != "tool_force"
        if is_of_markers and known is not None and np.array_equal(known[0], values):
            found = of_equilibrium(measured, case, known[1], element=self.element)
        else:
            start = known[1] if known is not None and is_of_markers else None
            found = solve_measured(measured, case, element=self.element, start=start)
        if is_of_markers:
            self._equilibria[alike] = (np.array(values), found.displacement)
        self._last[name] = (np.array(values), case, found)
        return case, found

    def derivatives(
        self, measured: Measured, values: Floats, parameters: Sequence[Parameter]
    ) -> Floats:
        case, found = self.predicted(measured, values)
        return derivatives(
            measured,
            self.numbers(values),
            {p.name: p.scale for p in parameters},
            found,
            element=self.element,
            like=case,
        )


class _Reference:
    """Quadratic elements on the case's mesh, each experiment solved once for the same numbers."""

    def __init__(self, coarse: _Body, progress: Progress) -> None:
        self._coarse, self._progress = coarse, progress
        self._last: dict[str, tuple[Floats, Points]] = {}

    def predict(self, measured: Measured, values: Floats) -> Floats:
        case, coarse = self._coarse.predicted(measured, values)
        if measured.spec.kind != "rest":
            return coarse.values  # the reference has no swings, and no force along a path
        alike = repr(sorted(measured.spec.set.items()))
        last = self._last.get(alike)
        if last is None or not np.array_equal(last[0], values):
            self._progress(f"reference, degree 2: {measured.spec.name}")
            state = solve(case.problem, with_=Simulator.REFERENCE, strain=case.strain, degree=2)
            last = self._last[alike] = (np.array(values), state.displacement)
        return of_equilibrium(measured, case, last[1], element=self._coarse.element).values


def fit_case(
    case: Case,
    parameters: Sequence[Parameter],
    *,
    data: Sequence[str] | None = None,
    hold_out: Sequence[str] = (),
    element: Element = Element.SMOOTHED,
    last_step: LastStep | None = None,
    confidence: float = 0.95,
    by_run: bool = False,
    progress: Progress = in_silence,
) -> CaseFit:
    """Fit numbers of a case to its measurements, and predict those that are set apart.

    Args:
        case: The case, without [time].
        parameters: What is fitted; see `parameters_of`.
        data: Names of the measurements to fit to; where None all that the case has for that and
            that are not set apart.
        hold_out: Names of those that are predicted and judged.
        element: Tetrahedra of the search.
        last_step: Model of the last step; None takes the reference where FEniCSx is there, else a
            finer mesh where the case gives an edge length.
        confidence: Of the intervals.
        by_run: Fit each run alone, too.
        progress: Called with one line now and then.

    Returns:
        The fit, with verdicts on what was set apart.

    Raises:
        InputError: A measurement that is not there or both fitted to and set apart, a last step
            that this case cannot have, or a fit that cannot be made: see `fit`.
        MeasurementError: A file that cannot be used.
        FastsimError: An experiment has no equilibrium.
    """
    if not case.spec.measurement:
        raise InputError(
            f"{case.path.name} has no [[measurement]] to fit to; see the built-in silicone-bar"
        )
    known = [spec.name for spec in case.spec.measurement if spec.fitted]
    used = tuple(n for n in known if n not in hold_out) if data is None else tuple(data)
    if both := [name for name in used if name in hold_out]:
        raise InputError(f"measurement {both[0]!r} is fitted to and held out; name it once")
    if not used:
        raise InputError(f"{case.path.name}: no measurement is left to fit to; name --data")
    measured = read_measurements(case, tuple(dict.fromkeys((*used, *hold_out))))
    keys = [parameter.name for parameter in parameters]
    coarse = _Body(keys, element, {})
    step = _last_step(case, last_step)
    better = _better(case, coarse, step, progress)

    def experiment(name: str, one: Measured, *, has_better: bool = True) -> Experiment:
        def predict(values: Floats) -> Floats:
            shown = ", ".join(f"{k} = {v:.6g}" for k, v in zip(keys, values, strict=True))
            progress(f"{name}: {shown}")
            return coarse.predicted(one, values)[1].values

        return Experiment(
            name,
            one.labels,
            one.values,
            one.uncertainty,
            predict,
            lambda values: coarse.derivatives(one, values, parameters),
            partial(better, one) if has_better and better is not None else None,
        )

    experiments = {name: experiment(name, one) for name, one in measured.items()}
    found = fit(parameters, [experiments[name] for name in used], confidence=confidence)
    best = found.values
    predictions, held_out = {}, {}
    for name, one in measured.items():
        at, there = coarse.predicted(one, best)
        coarse_values = there.values
        predictions[name] = coarse_values if better is None else better(one, best)
        if name in hold_out:
            progress(f"predicting {name}")
            numerical = _numerical(case, one, step, coarse_values, predictions[name])
            limit = math.inf if one.limit is None else one.limit
            held_out[name] = predict_held_out(
                found,
                experiments[name],
                limit=np.full(len(one.values), limit),
                numerical=numerical,
                other_inputs=np.sqrt(
                    input_variance(one, coarse.numbers(best), there, at, element=element)
                ),
            )
    runs = _by_run(measured, used, parameters, experiment, found.step) if by_run else ()
    return CaseFit(case, found, measured, used, predictions, held_out, runs, step, element)


def _last_step(case: Case, asked: LastStep | None) -> LastStep:
    edges = _edges(case)
    if asked is LastStep.REFERENCE:
        require_available()
    if asked is LastStep.MESH and not edges:
        raise InputError(
            f"{case.path.name} gives no edge_length, and so no finer mesh; take the last step by "
            "the reference, or none"
        )
    if asked is not None:
        return asked
    if is_available() and any(spec.kind == "rest" for spec in case.spec.measurement):
        return LastStep.REFERENCE
    return LastStep.MESH if edges else LastStep.NONE


def _edges(case: Case) -> list[str]:
    """Keys of edge lengths that a case gives."""
    return [key for key in _EDGES if key in known_keys(case)]


def _better(case: Case, coarse: _Body, step: LastStep, progress: Progress) -> Model | None:
    """The model of the last step: values by measurement and numbers; None without one."""
    if step is LastStep.REFERENCE:
        return _Reference(coarse, progress).predict
    if step is LastStep.NONE:
        return None
    edge = _edges(case)[0]
    finer = _Body(coarse.keys, coarse.element, {edge: _FINER * value_of(case, edge)})

    def predict(measured: Measured, values: Floats) -> Floats:
        progress(f"finer mesh: {measured.spec.name}")
        return finer.predicted(measured, values)[1].values

    return predict


def _numerical(
    case: Case, measured: Measured, step: LastStep, coarse: Floats, better: Floats
) -> Floats:
    """Standard uncertainty of the better model's values by mesh and solver."""
    apart = np.asarray(np.abs(coarse - better))
    if step is not LastStep.REFERENCE or measured.spec.kind != "rest":
        return apart
    try:
        references = find_references(case, live=False, progress=in_silence)
    except InputError:
        return apart
    truth, quadratic = (
        references.truth(case.strain),
        references.states.get((QUADRATIC, case.strain)),
    )
    bar = references.bar_parts("displacement_max", case.strain).whole
    if truth is None or quadratic is None or not math.isfinite(bar):
        return apart
    off = np.linalg.norm(quadratic.displacement - truth.displacement, axis=1).max()
    relative = float(off) / truth.max_displacement + bar
    size = float(np.linalg.norm(better.reshape(-1, 3), axis=1).max())
    return np.full(len(better), relative * size / COVERAGE_OF_BAR)


def _by_run(
    measured: Mapping[str, Measured],
    used: Sequence[str],
    parameters: Sequence[Parameter],
    experiment: Callable[..., Experiment],
    step: Floats | None,
) -> tuple[Floats, ...]:
    """Fitted values by each run alone, moved by the same last step."""
    counts = {len(measured[name].runs) for name in used}
    if counts == {1} or len(counts) > 1:
        raise InputError(
            "each run alone needs two or more runs, the same number in every measurement"
        )
    found = []
    for number in range(counts.pop()):
        alone = [
            experiment(f"{name}, run {number + 1}", measured[name].with_runs([number]),
                       has_better=False)
            for name in used
        ]  # fmt: skip
        values = fit(parameters, alone).values
        found.append(values + (0.0 if step is None else step))
    return tuple(found)


def law_fits(
    case: Case,
    laws: Sequence[Law],
    keys: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None,
    **options: Any,
) -> dict[str, CaseFit]:
    """A fit under each of several laws, by its name; see `fit_case`.

    Raises:
        InputError: A law that is named twice, or that the case cannot follow.
    """
    if len(set(laws)) < len(laws):
        raise InputError("--law names a law twice")
    found = {}
    for law in laws:
        other = case.under(law)
        found[str(law)] = fit_case(other, parameters_of(other, keys, bounds), **options)
    return found


def preferred(fits: Mapping[str, CaseFit]) -> str | None:
    """The law whose held-out error is least, if no other's interval overlaps it; else None."""
    scores = {name: one.score() for name, one in fits.items()}
    best = min(scores, key=lambda name: scores[name][0])
    high = scores[best][0] + scores[best][1]
    others = [error - doubt for name, (error, doubt) in scores.items() if name != best]
    return best if others and high < min(others) else None
