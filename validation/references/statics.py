"""The references of a static case: solved here with bars that theory stands behind, or for storing.

The truth is P2 on graded meshes (`adaptive_truth`); solved here on a few of them, within a budget
that is the same on every machine unless it is slow. Where no second mesh can be had it is P2 on the
case's mesh, and its bars are its differences from P1 there: see `bars.saturated`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import EDGES
from palpate.reference.errors import (
    ReferenceFailedError,
    ReferenceNotConvergedError,
    ReferenceUnavailableError,
)
from palpate.reference.result import LOST, AdaptiveResult, Formulation, formulation_for
from palpate.validation.metrics import measure, stress_integrals
from palpate.validation.references.adaptive_truth import (
    ADAPTIVE,
    DEGREE,
    TruthRequest,
    record_of,
    refine_truth,
    truth_of,
    whole_metrics,
)
from palpate.validation.references.bars import (
    FAR,
    GEOMETRY,
    PARTS,
    Bars,
    as_record,
    has_limit,
    of_statics,
    saturated,
    without_limits,
)
from palpate.validation.references.branches import load_over_critical
from palpate.validation.references.reference_set import (
    BOTH,
    OF_ELEMENT,
    QUADRATIC,
    SAME_MESH,
    SMOOTHED,
    TRUTH,
    ReferenceSet,
    StateKey,
)
from palpate.validation.references.runs import (
    failure_recorded,
    first_state,
    solve_state,
    state_of,
    stresses_of,
)
from palpate.validation.states import Progress, State

# Unknowns of the largest graded mesh, and time for all of one strain measure [s]: a case of 5 000
# cells has three meshes within about half a minute of one core.
UNKNOWNS = 80_000.0
SECONDS = 120.0


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
        truth_strains: Strain measures of the truth, which takes the most time; all where empty.
        request: What a static truth has to reach: small bars of every metric of the whole
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
    request = request or _whole(problem)
    states: dict[StateKey, State] = {}
    bars: Bars = {}
    records: dict[str, Any] = {}
    # First: on several ranks smoothed tetrahedra are solved beside all that these hold.
    for strain, element in itertools.product(Strain, Element):
        state = solve_state(problem, strain, 1, progress, element=element)
        states[state.label, strain] = dataclasses.replace(state, stresses=None)
    for strain in Strain:
        if strain not in strains:
            states[QUADRATIC, strain] = dataclasses.replace(
                solve_state(problem, strain, DEGREE, progress), stresses=None, integrals=None
            )
            continue
        near = _start_of_newton(problem, strain, states[SMOOTHED, strain])
        asked = request if near is None else dataclasses.replace(request, start=near)
        found = refine_truth(problem, strain, asked, progress)
        states[QUADRATIC, strain] = first_state(found)
        truth, of_truth, records[strain.value] = truth_of(problem, strain, request, found)
        states[TRUTH, strain] = truth
        bars |= {(metric, strain): bar for metric, bar in of_truth.items()}
    return ReferenceSet(
        states,
        bars,
        "stored: P1, smoothed tetrahedra and P2 on the case's mesh, and P2 on meshes refined where "
        "its error comes from as the truth",
        provenance={
            "versions": dict(truth.versions),
            ADAPTIVE: records,
            PARTS: _parts_of(bars),
        },
    )


def solve_same_mesh_again(
    problem: Problem, stored: ReferenceSet, progress: Progress
) -> ReferenceSet:
    """A stored set with its states on the case's mesh solved anew; its truth and bars as they are.

    Raises:
        ReferenceFailedError: Any of the solves fails.
    """
    from palpate.validation.references.runs import solve_by_steps

    states = dict(stored.states)
    for element, strain in itertools.product(Element, Strain):
        key = (OF_ELEMENT[element], strain)
        if key in states and problem.time is not None:
            states[key] = solve_by_steps(problem, strain, None, progress, element=element)
        elif key in states:
            state = solve_state(problem, strain, 1, progress, element=element)
            states[key] = dataclasses.replace(state, stresses=None)
    return dataclasses.replace(stored, states=states)


def _start_of_newton(problem: Problem, strain: Strain, state: State) -> Points | None:
    """Where Newton's method for quadratic tetrahedra begins: at smoothed ones' solution, or rest.

    Not with what touches the body, whose path counts, nor with pressures among the unknowns.
    """
    is_free = not (problem.tools or problem.springs)
    is_plain = formulation_for(problem, DEGREE) is Formulation.DISPLACEMENT
    return state.displacement if is_free and is_plain and strain is Strain.GREEN else None


def _whole(problem: Problem) -> TruthRequest:
    """Small bars of everything that is of the whole body."""
    return TruthRequest(metrics=dict.fromkeys(Strain, whole_metrics(problem)))


def _parts_of(bars: Bars) -> dict[str, Any]:
    return as_record({position: of_statics(bar) for position, bar in bars.items()})


def solve_live(
    problem: Problem,
    progress: Progress,
    *,
    stored: ReferenceSet | None = None,
    wanted: Collection[str] = BOTH,
    elements: Collection[Element] = (Element.LINEAR,),
    request: TruthRequest | None = None,
    has_stress: bool = True,
    strains: Collection[Strain] = tuple(Strain),
    unknowns: float = UNKNOWNS,
    known: Mapping[StateKey, State] | None = None,
    has_truth: bool = True,
) -> ReferenceSet:
    """Solve P1 on the case's mesh and the truth; of a motion what is `wanted`.

    Smoothed tetrahedra beside them, where they are among the `elements`. P2 is not tried where P1
    has lost equilibrium: its search for the same limit would take minutes and end at a smaller
    load.

    Args:
        problem: The case's.
        progress: Called with one line for each thing done.
        stored: A set whose truth is taken with its bars, if it has one.
        wanted: Of a motion, what checks ask for: "same_mesh", "truth".
        elements: Elements of the states on the same mesh.
        request: Bars asked of the truth, and of which metrics; of all where None. Its time is at
            most SECONDS.
        has_stress: Whether P2 on the case's mesh is solved for its stresses, which graded meshes
            do not give; without them P2 is not tried there either where those have none.
        strains: Strain measures that are solved.
        unknowns: Most unknowns of the largest mesh of a static truth.
        known: States of a static problem that are not solved again.
        has_truth: Whether a static problem's truth is solved at all.
    """
    if problem.time is not None:
        from palpate.validation.references.motions import solve_motion_set

        return solve_motion_set(
            problem, progress, wanted=wanted, stored=stored, elements=elements, strains=strains
        )
    asked = request or _whole(problem)
    asked = dataclasses.replace(
        asked, seconds=min(asked.seconds, SECONDS), unknowns=unknowns, parts={}
    )
    run = _LiveRun(problem, progress, asked, dict(known or {}))
    is_graded = stored is None and 2.0 * unknowns_of(problem) <= unknowns
    for strain in strains:
        if not run.has_equilibrium(strain):
            continue
        if not has_truth:
            continue
        if is_graded:
            run.grade(strain, has_stress=has_stress)
        is_tried = any((TRUTH, strain) in made for made in (run.states, run.failures))
        if has_stress or not is_tried:
            run.solve(strain, 2)
    if Element.SMOOTHED in elements:
        for strain in strains:
            run.solve(strain, 1, Element.SMOOTHED)
    names = ["P1", *(["smoothed tetrahedra"] if Element.SMOOTHED in elements else [])]
    here = (
        " and ".join(filter(None, [", ".join(names), "P2" if has_truth else ""])) + " solved here"
    )
    provenance: dict[str, Any] = {
        "versions": next((dict(s.versions) for s in run.states.values()), {})
    }
    if stored is not None:
        labels = {TRUTH, *(OF_ELEMENT[e] for e in Element if e not in elements)}
        states = {k: s for k, s in stored.states.items() if k[0] in labels} | run.states
        provenance["stored"] = dict(stored.provenance)
        provenance |= {k: stored.provenance.get(k, {}) for k in (PARTS, GEOMETRY, ADAPTIVE)}
        origin = f"{here}; the truth and its error bar stored (P2, finer meshes)"
        return ReferenceSet(states, dict(stored.bars), origin, run.failures, provenance)
    bars = estimate_bars(problem, run.states) | run.graded_bars
    provenance[PARTS] = _parts_of(bars)
    if run.records:
        provenance[ADAPTIVE] = run.records
    origin = f"{here}; {run.says_of_bars()}" if has_truth else here
    remarks = (*run.remarks, *run.coarse_meshes())
    return ReferenceSet(run.states, bars, origin, run.failures, provenance, remarks=remarks)


def unknowns_of(problem: Problem) -> int:
    """Number of unknowns of P2 on the case's mesh: three at each point and edge."""
    mesh = problem.mesh
    pairs = np.sort(mesh.cells[:, EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    num_edges = len(np.unique(pairs[:, 0] * mesh.num_points + pairs[:, 1]))
    return 3 * (mesh.num_points + num_edges)


@dataclass(eq=False)
class _LiveRun:
    """States as they come, and why one did not."""

    problem: Problem
    progress: Progress
    asked: TruthRequest
    states: dict[StateKey, State]
    failures: dict[StateKey, str] = field(default_factory=dict)
    records: dict[str, Any] = field(default_factory=dict)
    graded_bars: Bars = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def has_equilibrium(self, strain: Strain) -> bool:
        """Solve P1; False where it lost equilibrium, and P2 need not be tried."""
        error = self.solve(strain, 1)
        if not isinstance(error, ReferenceNotConvergedError):
            return True
        self.failures[QUADRATIC, strain] = (
            f"{QUADRATIC}: not tried, because {SAME_MESH} lost equilibrium at "
            f"{error.load_factor:.3f} of {error.of} ({error.reason}); {error.remedy}"
        )
        return False

    def solve(
        self, strain: Strain, degree: int, element: Element = Element.LINEAR
    ) -> ReferenceFailedError | None:
        """One state on the case's mesh, or why there is none, which is recorded."""
        key = (OF_ELEMENT[element] if degree == 1 else QUADRATIC, strain)
        if key in self.states:
            return None
        try:
            self.states[key] = solve_state(
                self.problem, strain, degree, self.progress, element=element, start=self.asked.start
            )
        except ReferenceUnavailableError:
            raise
        except ReferenceFailedError as error:
            self.failures[key] = f"{key[0]}: {error}"
            return error
        return None

    def grade(self, strain: Strain, *, has_stress: bool) -> None:
        """The truth on graded meshes; on the case's alone, it is P2 there.

        P2 on the case's mesh is added where its stresses are asked for.
        """
        with failure_recorded(self.failures, (TRUTH, strain)):
            found = refine_truth(self.problem, strain, self.asked, self.progress)
        if (TRUTH, strain) in self.failures:
            return
        bars = graded_bars(self.problem, strain, found, is_judged=bool(self.asked.judged))
        on_case = found.first if bars else found
        stress: dict[str, Any] = {}
        if on_case is not None:
            stresses = stresses_of(on_case)
            integrals = stress_integrals(self.problem.mesh, stresses, on_case.strain_energy)
            stress = {"stresses": stresses, "integrals": integrals}
        label = TRUTH if bars else QUADRATIC
        # Means over the case's cells, of which nothing is known on graded meshes.
        more = {} if bars else stress
        seconds = float(found.seconds.sum())
        self.states[label, strain] = state_of(
            found, strain, label=label, degree=found.degree, seconds=seconds, **more
        )
        if bars and has_stress and found.first is not None:
            self.states[QUADRATIC, strain] = first_state(found, **stress)
        self.records[strain.value] = record_of(found)
        self.graded_bars |= {(metric, strain): bar for metric, bar in bars.items()}
        self.remarks.append(
            f"Truth, {strain} strain: {len(found.num_cells)} mesh(es), the last of "
            f"{int(found.num_cells[-1])} cells: {found.ended}."
        )

    def says_of_bars(self) -> str:
        """A line on how the bars were found."""
        parts = [f"error bars of {TRUTH}: from graded meshes"] if self.graded_bars else []
        if any((TRUTH, s) not in self.states and (QUADRATIC, s) in self.states for s in Strain):
            parts.append(
                f"error bars of {QUADRATIC}: its differences from P1, where they are below "
                f"{FAR:.0%}"
            )
        return "; ".join(parts) or "no error bars"

    def coarse_meshes(self) -> Iterator[str]:
        """Where linear tetrahedra are of no use on the case's mesh."""
        for strain in Strain:
            linear = self.states.get((SAME_MESH, strain))
            truth = self.states.get((TRUTH, strain)) or self.states.get((QUADRATIC, strain))
            is_one_of_several = load_over_critical(self.records.get(strain.value)) > 1.0
            if linear is None or truth is None or is_one_of_several:
                continue
            apart = measure("displacement_l2", self.problem, linear, truth).value
            if apart > FAR:
                yield (
                    f"P1 and P2 are {apart:.0%} apart in displacement_l2 ({strain} strain): this "
                    "mesh is too coarse for linear tetrahedra; refine it."
                )


def graded_bars(
    problem: Problem, strain: Strain, found: AdaptiveResult, *, is_judged: bool = False
) -> dict[str, float]:
    """Bars of a truth on graded meshes: from three or more as stored ones have, else from two.

    Where solutions are judged, three meshes are near to each other: see `error_bar_of_few`.

    Returns:
        Bars by metric; none where there is one mesh alone.
    """
    from palpate.reference.adaptivity.error_bars import error_bar_of_few
    from palpate.reference.adaptivity.goals import has_point_forces

    is_lost = found.ended.startswith(LOST)
    if len(found.num_cells) < 2 and not is_lost:
        return {}
    if is_lost or len(found.num_cells) > (3 if is_judged else 2):
        return {m: found.bar(m) for m in whole_metrics(problem) if m in found.quantities}
    bars = {
        name: error_bar_of_few(
            found.bar(name), found.differences[1:, k].tolist(), found.estimates[:, k].tolist()
        )
        for k, name in enumerate(found.quantities)
    }
    if not has_point_forces(problem, found):
        return bars
    return {m: bar if has_limit(m, strain) else math.inf for m, bar in bars.items()}


def estimate_bars(problem: Problem, states: Mapping[StateKey, State]) -> Bars:
    """P1 against P2 on the same mesh, for every metric and strain; see `saturated`.

    Single numbers of the two may agree by chance. So the largest displacement has the bar of the
    worst point, and where the displacements are too far apart no number has one.
    """
    bars: Bars = {}
    for strain in Strain:
        coarse, fine = states.get((SAME_MESH, strain)), states.get((QUADRATIC, strain))
        if coarse is None or fine is None:
            continue
        names = whole_metrics(problem)
        apart = {m: saturated(measure(m, problem, coarse, fine).value) for m in names}
        apart["max_displacement"] = apart["displacement_max"]
        if math.isinf(apart["displacement_l2"]):
            apart = dict.fromkeys(apart, math.inf)
        apart = without_limits(problem, strain, apart, fine)
        bars |= {(metric, strain): bar for metric, bar in apart.items()}
    return bars
