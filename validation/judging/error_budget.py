"""Where an error comes from: model, discretisation, time and solver, on signed numbers.

Each term is what the candidate would gain by repairing one thing and leaving all else as it is:

    model           Green strain instead of linear strain, on the same mesh
    discretisation  the truth's mesh and element, with the candidate's own strain
    time            a quarter of the time step; for a candidate that states scheme and step of
                    its own (`State.steps`) that quarter replaces both
    solver          the same mesh, strain, scheme and step, each step solved by the reference;
                    called by another name where it is not the solver's

For a result on a mesh of its own, which the reference does not solve on, discretisation and solver
are one term. Norms do not add; signed numbers do, but for the interaction: what is left of the
total when all terms are taken off. A large interaction says that repairing one thing alone will not
do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import size_of_change
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.case.units import Units
from palpate.validation.diagnosis import Cause, Diagnosis
from palpate.validation.diagnosis.diagnose import equations_left
from palpate.validation.diagnosis.explanation import CONVERGED, SINGLE
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.reference_set import OF_ELEMENT, QUADRATIC, TRUTH
from palpate.validation.states import Progress, State, in_silence

MODEL, DISCRETISATION, TIME, SOLVER = "model", "discretisation", "time", "solver"
UNEXPLAINED = "not explained by mesh, time or solver"
# What a probe reads, with its unit.
_NUMBERS = (("displacement of the farthest point", "m"), ("change of volume", "m3"))
# How much finer the time step is that stands for none.
_FINER_STEP = 4
# A simulator measures its residual in a norm of its own.
_NORMS_DIFFER = 10.0
# Nobody stops earlier on purpose.
_MOST_SAID = 0.1
_SOLVERS = (Cause.AGREES, Cause.PRECISION)


@dataclass(frozen=True)
class Budget:
    """The error of one number, by cause.

    Attributes:
        quantity: What the number is.
        unit: Unit of every value here.
        candidate: Name of who is judged, with its strain measure.
        value: The candidate's.
        truth: The best there is.
        terms: Contribution of each cause; None where a cause does not apply or is not known.
        scale: What errors are fractions of: the truth, of a change of volume at least 0.1 % of
            the volume at rest, as in the checks.
    """

    quantity: str
    unit: str
    candidate: str
    value: float
    truth: float
    terms: Mapping[str, float | None]
    scale: float

    @property
    def total(self) -> float:
        """Candidate less truth."""
        return self.value - self.truth

    @property
    def rest(self) -> str:
        """Name of the term of mesh, strain and step alike: `SOLVER`, or what it is instead."""
        return next(name for name in self.terms if name not in (MODEL, DISCRETISATION, TIME))

    @property
    def interaction(self) -> float:
        """The error that is left over by all terms."""
        return self.total - sum(term for term in self.terms.values() if term is not None)


@dataclass(frozen=True, eq=False)
class Probe:
    """Signed numbers of a state: the displacement of a point along a direction, the volume.

    Attributes:
        point: Index.
        direction: Unit vector, (3,).
    """

    point: int
    direction: Points

    def read(self, mesh: TetMesh, displacement: Points, volume: float | None = None) -> Points:
        """Displacement of the point [m] and change of volume [m3], shape (2,)."""
        if volume is None:
            volume = float(signed_volumes(mesh.points + displacement, mesh.cells).sum())
        return np.array([float(displacement[self.point] @ self.direction), volume - mesh.volume])


def farthest_probe(displacement: Points) -> Probe:
    """The point that moves most, along the way it goes."""
    lengths = np.linalg.norm(displacement, axis=1)
    point = int(lengths.argmax())
    if not lengths[point] > 0.0:
        raise InputError("nothing moves: there is no probe to set up a budget on")
    return Probe(point, displacement[point] / lengths[point])


def static_budgets(
    problem: Problem,
    candidate: State,
    states: Mapping[tuple[str, Strain], State],
    *,
    diagnoses: Sequence[Diagnosis] = (),
) -> list[Budget]:
    """Budgets of a static result from the reference's states.

    Args:
        problem: The case's problem.
        candidate: Its displacement at the case's points; its `strain` is what it was solved with.
        states: The reference's, by label and strain: on the same mesh with the candidate's
            element, and the truth.
        diagnoses: Diagnoses of the case, where it failed.

    Returns:
        One for the farthest point's displacement, one for the change of volume; none where
        the truth is missing.
    """

    def truth_of(strain: Strain) -> State | None:
        return states.get((TRUTH, strain)) or states.get((QUADRATIC, strain))

    truth = truth_of(Strain.GREEN)
    if truth is None:
        return []
    probe = farthest_probe(truth.displacement)

    def read(state: State | None) -> Points:
        if state is None:
            return np.full(2, np.nan)
        return probe.read(problem.mesh, state.displacement, state.volume)

    strain, on_mesh, own = candidate.strain, OF_ELEMENT[candidate.element], read(candidate)
    same, fine = states.get((on_mesh, strain)), truth_of(strain)
    terms: dict[str, Points | None] = {MODEL: None, TIME: None}
    if strain is Strain.LINEAR:
        terms[MODEL] = read(same) - read(states.get((on_mesh, Strain.GREEN)))
    if candidate.own is not None:
        # Nothing was solved on that mesh but the candidate: its solver's error is in here.
        terms |= {DISCRETISATION: own - read(fine), SOLVER: None}
    else:
        terms[DISCRETISATION] = read(same) - read(fine)
        terms[name_of_rest(problem, candidate, same, diagnoses)] = own - read(same)
    return _budgets(candidate, own, read(truth), terms, problem.mesh.volume)


def motion_budgets(
    problem: Problem,
    candidate: State,
    *,
    same_mesh: State | None = None,
    diagnoses: Sequence[Diagnosis] = (),
    progress: Progress = in_silence,
) -> list[Budget]:
    """Budgets at the end of a motion, by fastsim itself with one thing changed at a time.

    The truth is Green strain on the mesh cut in eight with a quarter of the time step: the terms
    say what that gains, not what is left beyond it.

    Args:
        problem: With a time span and a time step, at which central differences are stable.
        candidate: Its state at the end; its `strain` is what it was solved with. Where it states
            `steps`, those are what its time term is about.
        same_mesh: The reference's state with the same mesh, strain, scheme and step, for the
            solver's term; see `references.runs.solve_by_steps`.
        diagnoses: Diagnoses of the case, where it failed.
        progress: Called with one line for each run.

    Raises:
        InputError: No time step, nothing moves, or steps that are stated without `same_mesh`.
        FastsimError: A run failed.
    """
    span = problem.time
    if span is None or span.time_step is None:
        raise InputError("a budget of a motion needs [time] with a time_step")
    strain, scheme = candidate.strain, candidate.steps
    if scheme is not None and same_mesh is None:
        raise InputError(f"a budget of {scheme} needs the same mesh by these steps; solve it")
    from palpate.fastsim.dynamics import simulate

    finer = dataclasses.replace(span, time_step=span.time_step / _FINER_STEP)
    fine_step = dataclasses.replace(problem, time=finer)
    fine_mesh = dataclasses.replace(refine_problem(problem), time=finer)

    def end(of: Problem, with_strain: Strain) -> Points:
        assert of.time is not None
        progress(f"{of.mesh.num_cells} cells, step {of.time.time_step:g} s, {with_strain} strain")
        last: Points = simulate(of, strain=with_strain).displacements[-1]
        return last

    green = end(fine_mesh, Strain.GREEN)
    probe = farthest_probe(green[: problem.mesh.num_points])
    read, read_fine = partial(probe.read, problem.mesh), partial(probe.read, fine_mesh.mesh)
    plain, truth = read(end(problem, strain)), read_fine(green)
    stepped = read(end(fine_step, strain))
    terms: dict[str, Points | None] = {MODEL: None}
    meshed = truth
    if strain is not Strain.GREEN:
        terms[MODEL] = plain - read(end(problem, Strain.GREEN))
        meshed = read_fine(end(fine_mesh, strain))
    terms[DISCRETISATION] = stepped - meshed
    judged_by = plain if same_mesh is None else read(same_mesh.displacement)
    terms[TIME] = (plain if scheme is None else judged_by) - stepped
    own, rest = read(candidate.displacement), SOLVER
    if same_mesh is not None:
        rest = name_of_rest(problem, candidate, same_mesh, diagnoses)
    terms[rest] = own - judged_by
    return _budgets(candidate, own, truth, terms, problem.mesh.volume)


def name_of_rest(
    problem: Problem,
    candidate: State,
    same_mesh: State | None = None,
    diagnoses: Sequence[Diagnosis] = (),
) -> str:
    """The name of what is left of a candidate's error on the same mesh, strain and step.

    It is the solver's only where the result satisfies the stated equations, or where the simulator
    says of itself that it stopped this early: of a motion, that it takes so many iterations in each
    step of a scheme that it states, which a sweep over both may refute. A wrong law, load or unit
    is called by its name where the diagnosis found it; else the error is not explained.

    Args:
        problem: The case's problem.
        candidate: The candidate's result at the case's points.
        same_mesh: The reference's there, for motions, which have no residual.
        diagnoses: Diagnoses of the case, if it failed.
    """
    which = (candidate.strain, candidate.element)
    first = next((d.first for d in diagnoses if (d.strain, d.element) == which), None)
    if first is not None:
        return SOLVER if first.cause in _SOLVERS else f"explained: {first.name}"
    if problem.time is None:
        said = candidate.details.get("relative_residual")
        allowed = CONVERGED
        if isinstance(said, float) and 0.0 < said <= _MOST_SAID:
            allowed = max(allowed, _NORMS_DIFFER * said)
        return SOLVER if equations_left(problem, candidate) <= allowed else UNEXPLAINED
    if same_mesh is None or candidate.trajectory is None or same_mesh.trajectory is None:
        return UNEXPLAINED
    if distance(candidate.displacements, same_mesh.displacements) <= SINGLE:
        return SOLVER
    iterations = candidate.says.get("iterations")
    stops_early = isinstance(iterations, int) and iterations > 0
    return SOLVER if candidate.steps is not None and stops_early else UNEXPLAINED


def case_budgets(result: CaseResult) -> list[Budget]:
    """Budgets of every state of a static case's candidate; none for cases in motion."""
    if result.problem.time is not None:
        return []
    references = {(s.label, s.strain): s for s in result.states if s.is_reference}
    budgets = []
    for state in result.states:
        if not state.is_reference:
            budgets += static_budgets(result.problem, state, references, diagnoses=result.diagnoses)
    return budgets


_DIMENSIONS = {"m": "length", "m3": "volume"}


def budget_rows(
    budgets: list[Budget], units: Units | None = None
) -> tuple[list[str], list[list[str]]]:
    """Column names, and a row of text for each budget; errors in per cent of its scale.

    Values are in the case's `units`, or in SI; what is not known is "".
    """
    used = units or Units()
    columns = ["number", "candidate", "value", "truth"]
    # Where it is not the solver's for all of them, each says what it is.
    is_solvers = all(budget.rest == SOLVER for budget in budgets)
    causes = [MODEL, DISCRETISATION, TIME, SOLVER if is_solvers else "the rest", "interaction"]
    columns += [f"{name} [%]" for name in ("error", *causes)]
    rows = []
    for budget in budgets:
        size, unit = used.of(_DIMENSIONS[budget.unit])

        def part(value: float | None, scale: float = budget.scale) -> str:
            return "" if value is None else f"{100.0 * value / scale:+.3g}" if value else "0"

        rows.append(
            [
                f"{budget.quantity} [{unit}]",
                budget.candidate,
                f"{budget.value / size:.5g}",
                f"{budget.truth / size:.5g}",
                part(budget.total),
                *(part(budget.terms.get(name)) for name in (MODEL, DISCRETISATION, TIME)),
                part(budget.terms[budget.rest]) + ("" if is_solvers else f" ({budget.rest})"),
                part(budget.interaction),
            ]
        )
    return columns, rows


def _budgets(
    candidate: State,
    own: Points,
    truth: Points,
    terms: Mapping[str, Points | None],
    rest: float,
) -> list[Budget]:
    """A budget of each number of a probe, of a body whose volume at rest is `rest` [m3]."""
    own_mesh = f", own mesh of {candidate.own.mesh.num_cells} cells" if candidate.own else ""
    strain = "Green" if candidate.strain is Strain.GREEN else str(candidate.strain)
    name = f"{candidate.label}, {strain} strain{own_mesh}"
    scales = (abs(float(truth[0])) or 1.0, size_of_change(rest + float(truth[1]), rest))
    budgets = []
    for k, (quantity, unit) in enumerate(_NUMBERS):
        # A term is missing where what it would be computed from is.
        found = {
            cause: None if term is None or np.isnan(term[k]) else float(term[k])
            for cause, term in terms.items()
        }
        values = float(own[k]), float(truth[k])
        budgets.append(Budget(quantity, unit, name, *values, found, scales[k]))
    return budgets
