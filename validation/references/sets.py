"""The reference solutions of a case: on its mesh by element, P2 for the truth, with error bars."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.result import Formulation, formulation_for
from palpate.validation.metrics import stress_integrals, tells_stress
from palpate.validation.references.adaptive_truth import (
    ADAPTIVE,
    DEGREE,
    TruthRequest,
    refine_truth,
    truth_of,
    whole_metrics,
)
from palpate.validation.references.bar_parts import PARTS, BarParts, as_record, of_statics, recorded
from palpate.validation.references.static_states import first_state, state_of, stresses_of
from palpate.validation.states import REFERENCE, Progress, State

SAME_MESH = "reference P1"
SMOOTHED = "reference smoothed"
QUADRATIC = "reference P2"
# P2 on finer meshes of the case's body: only stored references have it.
TRUTH = "reference P2, refined"

# What checks go against.
BOTH = ("same_mesh", "truth")

Bars = dict[tuple[str, Strain], float]
# The reference on the case's mesh, by what its tetrahedra are.
OF_ELEMENT = {Element.LINEAR: SAME_MESH, Element.SMOOTHED: SMOOTHED}


@dataclass(frozen=True, eq=False)
class ReferenceSet:
    """States by (label, strain), and error bars by (metric, strain) relative to their scale.

    Attributes:
        states: On the same mesh and of degree 2; one that did not converge is missing.
        bars: Error bars of the truth.
        origin: One line on where this comes from.
        failures: Why a state is missing, by (label, strain).
        provenance: Versions and how it was made.
        element: Whose states "the same mesh" means.
        aside: States of other elements on that mesh, which no candidate is held against: error
            bars of the truth are told from them, whoever is judged.
        remarks: What a reader must know of its bars, a sentence each.
    """

    states: Mapping[tuple[str, Strain], State]
    bars: Mapping[tuple[str, Strain], float]
    origin: str
    failures: Mapping[tuple[str, Strain], str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    element: Element = Element.LINEAR
    aside: Mapping[tuple[str, Strain], State] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def of_element(self, element: Element) -> ReferenceSet:
        """What a candidate with this element is held against: no other element's states."""
        others = [label for kind, label in OF_ELEMENT.items() if kind is not element]
        every = {**self.aside, **self.states}
        states = {place: state for place, state in every.items() if place[0] not in others}
        aside = {place: state for place, state in every.items() if place[0] in others}
        return replace(self, states=states, element=element, aside=aside)

    def with_same_mesh(
        self, strain: Strain, state: State | None, note: str, failure: str = ""
    ) -> ReferenceSet:
        """Another state on the case's mesh with the element, or why there is none.

        Args:
            strain: Of it.
            state: In the place of what is there.
            note: Of it, for who reads the verdict; left out where there is no state.
            failure: Why there is no state.
        """
        place = (OF_ELEMENT[self.element], strain)
        states = {known: kept for known, kept in self.states.items() if known != place}
        failures = {known: why for known, why in self.failures.items() if known != place}
        if state is None:
            return replace(self, states=states, failures=failures | {place: failure})
        states[place] = state
        return replace(self, states=states, failures=failures, remarks=(*self.remarks, note))

    def same_mesh(self, strain: Strain) -> State | None:
        """The state on the case's mesh with the element."""
        return self.states.get((OF_ELEMENT[self.element], strain))

    def truth(self, strain: Strain) -> State | None:
        """The best state there is: P2 on the refined mesh, else P2 on the case's mesh."""
        return self.states.get((TRUTH, strain)) or self.states.get((QUADRATIC, strain))

    def stress_truth(self, strain: Strain) -> State | None:
        """The truth where its stress is known, else P2 solved here; None where there is none."""
        truth, here = self.truth(strain), self.states.get((QUADRATIC, strain))
        if truth is not None and not tells_stress(truth):
            return here if here is not None and here.stresses is not None else None
        return truth

    def bar_parts(self, metric: str, strain: Strain) -> BarParts:
        """What the error bar of a metric is made of; infinite where it has none."""
        bar = self.bars.get((metric, strain), math.inf)
        return recorded(self.provenance, metric, strain, bar)

    def failure(self, against: str, strain: Strain) -> str:
        """Why a reference is missing; empty when it is not, or nobody knows."""
        label = QUADRATIC if against == "truth" else OF_ELEMENT[self.element]
        return self.failures.get((label, strain), "")


def solve_state(
    problem: Problem,
    strain: Strain,
    degree: int,
    progress: Progress,
    *,
    formulation: Formulation | None = None,
    element: Element = Element.LINEAR,
    start: Points | None = None,
    time_limit: float = 3600.0,
) -> State:
    """One static reference solve in a child process, as a state.

    Mixed by itself for nearly incompressible material: see `formulation_for`; `start`: see
    `solve_static`; `time_limit` [s]: see `run_task`.

    Raises:
        InputError: The problem has a time span: see `solve_reference`.
        ReferenceFailedError: No FEniCSx, no convergence, a crash, or out of time.
    """
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    if problem.time is not None:
        raise InputError("a problem in time has no static solution; solve its motion")
    begin = time.perf_counter()
    label = OF_ELEMENT[element] if degree == 1 else f"{REFERENCE} P{degree}"
    progress(f"{label}, {strain} strain, {problem.mesh.num_cells} cells")
    form = formulation or formulation_for(problem, degree)
    task = StaticTask(strain, degree, formulation=form, element=element, start=start)
    result = run_task(task, problem, time_limit=time_limit, progress=progress)
    stresses = stresses_of(result)
    return state_of(
        result,
        strain,
        label=label,
        degree=degree,
        seconds=time.perf_counter() - begin,
        element=element,
        stresses=stresses,
        integrals=None
        if degree == 1
        else stress_integrals(problem.mesh, stresses, result.strain_energy),
    )


def parts_of_statics(bars: Bars) -> dict[str, Any]:
    """The record of what bars from meshes are made of."""
    return as_record({place: of_statics(bar) for place, bar in bars.items()})


def _solve_adaptive_set(
    problem: Problem, progress: Progress, truth_strains: Collection[Strain], request: TruthRequest
) -> ReferenceSet:
    """Both elements and P2 on the case's mesh; of the truth's strain measures adaptive ones too."""
    states: dict[tuple[str, Strain], State] = {}
    bars: Bars = {}
    records: dict[str, Any] = {}
    # First: on several ranks smoothed tetrahedra are solved beside all that these hold.
    for strain, element in itertools.product(Strain, Element):
        state = solve_state(problem, strain, 1, progress, element=element)
        states[state.label, strain] = replace(state, stresses=None)
    for strain in Strain:
        if strain not in truth_strains:
            states[QUADRATIC, strain] = replace(
                solve_state(problem, strain, DEGREE, progress), stresses=None, integrals=None
            )
            continue
        near = _beside(problem, strain, states[SMOOTHED, strain])
        asked = request if near is None else replace(request, start=near)
        found = refine_truth(problem, strain, asked, progress, label=TRUTH)
        states[QUADRATIC, strain] = first_state(found, QUADRATIC)
        truth, told, record = truth_of(problem, strain, request, found, label=TRUTH)
        states[TRUTH, strain] = truth
        bars |= {(metric, strain): bar for metric, bar in told.items()}
        records[strain.value] = record
    versions = next(s.versions for (label, _), s in states.items() if label == TRUTH)
    return ReferenceSet(
        states,
        bars,
        "stored: P1, smoothed tetrahedra and P2 on the case's mesh, and P2 on meshes refined where "
        "its error comes from as the truth",
        provenance={
            "versions": dict(versions),
            ADAPTIVE: records,
            PARTS: parts_of_statics(bars),
        },
    )


def _beside(problem: Problem, strain: Strain, state: State) -> Points | None:
    """Where Newton's method for quadratic tetrahedra begins; None: at rest.

    At the answer of smoothed tetrahedra, some per cent away. Not with what touches the body, whose
    way counts, nor with pressures among the unknowns.
    """
    is_free = not (problem.tools or problem.springs)
    is_plain = formulation_for(problem, DEGREE) is Formulation.DISPLACEMENT
    return state.displacement if is_free and is_plain and strain is Strain.GREEN else None


def solve_for_storing(
    problem: Problem,
    progress: Progress,
    *,
    wanted: Collection[str] = BOTH,
    truth_strains: Collection[Strain] = (),
    request: TruthRequest | None = None,
) -> ReferenceSet:
    """Both elements and P2 on the case's mesh, and P2 on adaptive ones for the truth.

    Args:
        problem: The case's.
        progress: Called with one line for each run.
        wanted: What checks go against; of a motion nothing else is solved.
        truth_strains: Of the truth, which takes the most time; all where empty.
        request: What is asked of a static truth: small bars of everything that is of the whole
            body where None.

    Raises:
        ReferenceFailedError: Any of the solves fails: nothing incomplete is ever stored.
    """
    strains = truth_strains or tuple(Strain)
    if problem.time is not None:
        from palpate.validation.references.motions import solve_motion_set

        return solve_motion_set(
            problem,
            progress,
            wanted=wanted,
            is_for_storing=True,
            elements=tuple(Element),
            truth_strains=strains,
        )
    whole = TruthRequest(metrics=dict.fromkeys(Strain, whole_metrics(problem)))
    return _solve_adaptive_set(problem, progress, strains, request or whole)
