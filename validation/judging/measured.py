"""A result judged by what was measured of the real body, after ASME V&V 20-2009.

E is predicted less measured, of each value. Its standard uncertainty is
u_val = sqrt(u_num^2 + u_input^2 + u_data^2): of the numerical solution, by the bar of the truth; of
the inputs, by the uncertainties that the case states and the derivatives of the prediction; of the
data, by the scatter of the runs. Passed where |E| + 2 u_val is within the limit, failed where
|E| - 2 u_val is above it, inconclusive otherwise: an E below u_val alone never passes.

A candidate's own numerical error is no uncertainty here: it is part of its E, as it is of what its
user gets. Sections 1-5 to 1-7 of V&V 20 speak of the error of the model; that is E less the error
that `palpate gate` finds against the truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.case.measurement_schema import MeasurementSpec
from palpate.validation.case.measurements import Measured, pins_of, read_measurement
from palpate.validation.judging.measured_model import (
    Prediction,
    derivatives,
    of_equilibrium,
    solve_measured,
)
from palpate.validation.judging.results import MEASUREMENT, CheckResult, MeasuredValues
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import (
    CandidateFailedError,
    Progress,
    State,
    Verdict,
    gravest,
)

# V&V 20-2009: an interval of two standard uncertainties.
_COVERAGE = 2.0
# From an error bar whose error has one sign to its standard uncertainty: V&V 20-2009, section 2.
COVERAGE_OF_BAR = 1.15


class Validation(NamedTuple):
    """One value that was predicted, beside what was measured, all in one unit.

    `error` is E, predicted less measured; `numerical`, `input` and `data` are the standard
    uncertainties of which `u_val` is the root of the sum of squares.
    """

    error: float
    numerical: float
    input: float
    data: float
    limit: float

    @property
    def u_val(self) -> float:
        """Standard uncertainty of E."""
        return math.sqrt(self.numerical**2 + self.input**2 + self.data**2)

    @property
    def doubt(self) -> float:
        """2 u_val."""
        return _COVERAGE * self.u_val

    @property
    def margin(self) -> float:
        """|E| + 2 u_val: how far the prediction may be off."""
        return abs(self.error) + self.doubt

    @property
    def verdict(self) -> Verdict:
        """By |E| +- 2 u_val against the limit."""
        if self.margin <= self.limit:
            return Verdict.PASSED
        if abs(self.error) - self.doubt > self.limit:
            return Verdict.FAILED
        return Verdict.INCONCLUSIVE


def judge_measurements(
    case: Case,
    candidate: Candidate,
    solutions: Mapping[Strain, State],
    failures: Mapping[Strain, str],
    references: ReferenceSet,
    progress: Progress,
) -> list[tuple[CheckResult, MeasuredValues | None]]:
    """Judge a candidate by every measurement of a case that has a limit.

    Args:
        case: The case.
        candidate: Who is judged; it is asked for each experiment with other numbers.
        solutions: Its states of the case itself, by strain measure.
        failures: Why there is none, by strain measure.
        references: The case's references, for the bar of the truth.
        progress: Called with one line for each experiment that is solved.

    Returns:
        For each such measurement the check of its worst value, and all of them; None where none
        was computed.

    Raises:
        InputError: A measurement that cannot be read.
    """
    asked = [spec for spec in case.spec.measurement if spec.limit is not None]
    if not asked or case.strain not in candidate.strains_of(case.strain):
        return []
    found: list[tuple[CheckResult, MeasuredValues | None]] = []
    for spec in asked:
        measured = read_measurement(case, spec)
        unjudged = partial(_unjudged, spec, case, candidate)
        if case.strain in failures and not spec.set:
            found.append((unjudged(Verdict.FAILED, failures[case.strain]), None))
            continue
        if spec.set and not candidate.can_be_asked:
            why = "a result file is of the case's own numbers, and this experiment has others"
            found.append((unjudged(Verdict.SKIPPED, why), None))
            continue
        progress(f"{candidate.name} beside measurement {spec.name}")
        experiment = measured.at({}, like=case)
        try:
            state = (
                solutions[case.strain]
                if not spec.set
                else candidate.solve(experiment.problem, case.strain, progress)
            )
            says = read_state(measured, experiment, state, candidate.element)
        except CandidateFailedError as error:
            found.append((unjudged(Verdict.FAILED, str(error)), None))
            continue
        numerical = _bar_of_truth(measured, state, references, case)
        values = validate(measured, says, numerical=numerical)
        found.append(_result(measured, case, candidate, values))
    return found


def read_state(measured: Measured, case: Case, state: State, element: Element) -> Floats:
    """What a state of a measurement's experiment says to it: of a tool's curve its last value.

    Raises:
        CandidateFailedError: It has no force on the tool.
    """
    if measured.spec.kind != "tool_force":
        return of_equilibrium(measured, case, state.displacement, element=element).values
    tool, forces = (measured.spec.tool or 1) - 1, state.tool_forces
    if forces is None or tool >= len(forces):
        raise CandidateFailedError(f"{state.label} does not report the force on tool {tool + 1}")
    return np.array([forces[tool]["xyz".index(measured.spec.component or "z")]])


def validate(measured: Measured, says: Floats, *, numerical: Floats) -> list[Validation]:
    """Each value with the parts of its uncertainty, by the inputs' stated ones.

    Args:
        measured: The measurement; of a curve the last of its values are used.
        says: What is predicted, shape (m,), SI units.
        numerical: Standard uncertainty of that by mesh and solver, shape (m,).
    """
    count = len(says)
    variance = _input_variance(measured)[-count:]
    limit = math.inf if measured.limit is None else measured.limit
    return [
        Validation(float(e), float(n), math.sqrt(v), float(d), limit)
        for e, n, v, d in zip(
            says - measured.values[-count:],
            numerical,
            variance,
            measured.uncertainty[-count:],
            strict=True,
        )
    ]


# Of measurements that were read in this process: several candidates are judged by one.
_variances: dict[tuple[str, str], Floats] = {}


def _input_variance(measured: Measured) -> Floats:
    """Variance of what is predicted by the inputs' stated uncertainty, shape (n,).

    By fastsim's smoothed tetrahedra, whoever is judged: an own state says nothing of its limits.
    """
    case = measured.case
    key = (f"{case.name}\n{case.spec!r}", measured.spec.name)
    if key not in _variances:
        found = np.zeros(len(measured.values))
        if case.spec.uncertainty:
            at, element = measured.at({}, like=case), Element.SMOOTHED
            there = solve_measured(measured, at, element=element)
            found = input_variance(measured, {}, there, at, element=element)
        _variances[key] = found
    return _variances[key]


def input_variance(
    measured: Measured,
    values: Mapping[str, float],
    prediction: Prediction,
    at: Case,
    *,
    element: Element,
) -> Floats:
    """Variance of a prediction by the inputs that its case says to be uncertain, shape (n,).

    Args:
        measured: The measurement.
        values: Numbers of the case at which it is predicted, by key; these are not uncertain here.
        prediction: By fastsim, there.
        at: The case there, whose mesh is used again.
        element: Tetrahedra of the prediction.
    """
    given = measured.case.spec.uncertainty
    scales = {
        key: u
        for spec in given
        for key, u in zip(spec.inputs, spec.standard, strict=True)
        if key not in values
    }
    variance = np.zeros(len(measured.values))
    if not scales:
        return variance
    slope = derivatives(measured, values, scales, prediction, element=element, like=at)
    columns = dict(zip(scales, (slope * np.array(list(scales.values()))).T, strict=True))
    for spec in given:
        used = [k for k, key in enumerate(spec.inputs) if key in scales]
        parts = np.array([columns[spec.inputs[k]] for k in used]).reshape(len(used), -1)
        correlation = np.array(spec.correlation) if spec.correlation else np.eye(len(spec.inputs))
        variance += np.einsum("in,ij,jn->n", parts, correlation[np.ix_(used, used)], parts)
    return np.maximum(variance, 0.0)


class MarkerMotion(NamedTuple):
    """How far a marker of a case moves [m], (3,), and its standard uncertainty by the inputs."""

    name: str
    motion: Floats
    uncertainty: Floats


def predict_markers(case: Case, displacement: Points) -> list[MarkerMotion]:
    """Where a static solution takes the markers of a case that stand on its surface.

    Args:
        case: The case.
        displacement: The solution [m], shape (num_points, 3).

    Returns:
        One for each marker with a radius. Uncertain are the inputs that the case says to be, by
        fastsim's smoothed tetrahedra; the error of the mesh and of the model is not in it.
    """
    names = tuple(marker.name for marker in case.spec.marker if marker.radius is not None)
    if not names or case.problem.time is not None:
        return []
    rest = case.problem.mesh.points
    moved = [pin.moved(rest, displacement) for pin in pins_of(case, names).values()]
    spec = MeasurementSpec(
        name="markers", kind="rest", files=("-",), markers=names, rest_limit=1.0, uncertainty=1.0
    )
    values = np.concatenate(moved)
    unit = case.spec.units.of("length")
    labels = tuple(f"{name} {axis}" for name in names for axis in "xyz")
    as_measured = Measured(
        spec, case, labels, values, np.ones_like(values), values[None], np.zeros(0), unit
    )
    spread = np.sqrt(_input_variance(as_measured))
    rows = zip(names, moved, spread.reshape(-1, 3), strict=True)
    return [MarkerMotion(*row) for row in rows]


def _bar_of_truth(measured: Measured, state: State, references: ReferenceSet, case: Case) -> Floats:
    """Standard uncertainty by the bar of the case's stored truth, in the values' unit.

    The bar is relative: of an experiment with other numbers it is taken to be the same. A frequency
    goes with the root of stiffness, so that it is off by half of what the displacement is.
    """
    count = 1 if measured.spec.kind != "rest" else len(measured.values)
    metric = "tool_force" if measured.spec.kind == "tool_force" else "displacement_max"
    bar = references.bar_parts(metric, case.strain).whole
    if not math.isfinite(bar):
        return np.zeros(count)
    size = {
        "rest": state.max_displacement,
        "frequency": 0.5 * float(measured.values[0]),
        "tool_force": float(np.abs(measured.values).max()),
    }[measured.spec.kind]
    return np.full(count, bar * size / COVERAGE_OF_BAR)


def _result(
    measured: Measured, case: Case, candidate: Candidate, values: list[Validation]
) -> tuple[CheckResult, MeasuredValues]:
    """One check of the worst value, with a line that says what it is made of; and all values."""
    size, unit = measured.unit
    worst = max(range(len(values)), key=lambda k: values[k].margin)
    value, label = values[worst], measured.labels[-len(values) :][worst]
    seen = float(measured.values[-len(values) :][worst])
    u = [x / size for x in (value.numerical, value.input, value.data)]
    limit = value.limit / size
    message = (
        f"{label}: {(seen + value.error) / size:.4g} {unit} computed, {seen / size:.4g} {unit} "
        f"measured: {abs(value.error) / size:.2g} {unit} off, u_val {value.u_val / size:.2g} "
        f"{unit} (numerical {u[0]:.2g}, inputs {u[1]:.2g}, data {u[2]:.2g}); allowed with twice "
        f"u_val: {limit:.3g} {unit}"
    )
    is_of_markers = measured.spec.kind == "rest"
    pins = pins_of(case, measured.spec.markers) if is_of_markers else {}
    beside = MeasuredValues(
        measured.spec.name,
        candidate.name,
        unit,
        measured.labels[-len(values) :],
        measured.values[-len(values) :] / size,
        np.array([row.error for row in values]) / size + measured.values[-len(values) :] / size,
        np.array([row.doubt for row in values]) / size,
        np.array([pin.position / size for pin in pins.values()]).reshape(-1, 3),
    )
    check = CheckResult(
        metric=name_of(measured.spec),
        against=MEASUREMENT,
        strain=case.strain,
        verdict=gravest([v.verdict for v in values]),
        reason=measured.spec.reason,
        message=message,
        value=abs(value.error) / size,
        limit=limit,
        unit=unit,
        reference_error=value.doubt / size,
        element=candidate.element,
    )
    return check, beside


def _unjudged(
    spec: MeasurementSpec, case: Case, candidate: Candidate, verdict: Verdict, why: str
) -> CheckResult:
    return CheckResult(
        metric=name_of(spec), against=MEASUREMENT, strain=case.strain, verdict=verdict,
        reason=spec.reason, message=why, limit=spec.limit or 0.0, element=candidate.element,
    )  # fmt: skip


def name_of(spec: MeasurementSpec) -> str:
    """The name of a check by a measurement, among the metrics."""
    return f"measured {spec.name}"
