"""The reference of a static case solved on the spot, with error bars that theory stands behind.

The truth is P2 on a few graded meshes (`adaptive_truth`), within a budget that is the same on every
machine unless it is slow; its bars are those of stored truths. Where no second mesh can be had it
is P2 on the case's mesh, and the bar is its difference from P1:

    |u2 - u| <= beta |u1 - u|   gives   |u2 - u| <= beta / (1 - beta) |u2 - u1|

(R. E. Bank, R. K. Smith, SIAM J. Numer. Anal. 30, 1993), which is |u2 - u1| for beta = 1/2: half of
the error must go when the degree is raised. Where the two are more than half apart that cannot be
relied on, linear tetrahedra tell nothing there, and the bar is infinite.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import EDGES
from palpate.reference.errors import (
    ReferenceFailedError,
    ReferenceNotConvergedError,
    ReferenceUnavailableError,
)
from palpate.reference.result import LOST, AdaptiveResult
from palpate.validation.metrics import COMPARISONS, measure, stress_integrals
from palpate.validation.references.adaptive_truth import (
    ADAPTIVE,
    TruthRequest,
    record_of,
    refine_truth,
    whole_metrics,
)
from palpate.validation.references.bar_parts import GEOMETRY, PARTS
from palpate.validation.references.limits import has_limit, without_limits
from palpate.validation.references.sets import (
    BOTH,
    OF_ELEMENT,
    QUADRATIC,
    SAME_MESH,
    TRUTH,
    Bars,
    ReferenceSet,
    parts_of_statics,
    solve_state,
)
from palpate.validation.references.static_states import first_state, state_of, stresses_of
from palpate.validation.states import Progress, State

# Of the largest graded mesh, and time for all of one strain measure [s]: with it a case of 5 000
# cells has three meshes within about half a minute of one core.
UNKNOWNS = 80_000.0
SECONDS = 120.0
# P1 and P2 farther apart than this tell nothing of how far P2 is from the limit.
FAR = 0.5

Place = tuple[str, Strain]


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
    known: Mapping[Place, State] | None = None,
) -> ReferenceSet:
    """Solve P1 on the case's mesh and the truth; of a motion what is `wanted`.

    Smoothed tetrahedra beside them, where they are among the `elements`. P2 is not tried where P1
    has lost equilibrium: its search for the same limit would take minutes and end at a smaller
    load.

    Args:
        problem: The case's.
        progress: Called with one line for each thing done.
        stored: Where it has a truth, that is taken with its bars.
        wanted: Of a motion, what checks ask for: "same_mesh", "truth".
        elements: On the same mesh.
        request: Bars asked of the truth, and of which metrics; of all where None. Its time is at
            most SECONDS.
        has_stress: Whether P2 on the case's mesh is solved for its stresses, which graded meshes
            do not tell; without them P2 is not tried there either where those have none.
        strains: Of which.
        unknowns: Of the largest mesh of a static truth.
        known: States of a static problem that are not solved again.
    """
    if problem.time is not None:
        from palpate.validation.references.motions import solve_motion_set

        return solve_motion_set(
            problem, progress, wanted=wanted, stored=stored, elements=elements, strains=strains
        )
    asked = request or TruthRequest(metrics=dict.fromkeys(Strain, whole_metrics(problem)))
    asked = dataclasses.replace(
        asked, seconds=min(asked.seconds, SECONDS), unknowns=unknowns, parts={}
    )
    run = _Run(problem, progress, asked, known or {})
    is_graded = stored is None and 2.0 * unknowns_of(problem) <= unknowns
    for strain in strains:
        if not run.has_equilibrium(strain):
            continue
        if is_graded:
            run.grade(strain, has_stress=has_stress)
        if (QUADRATIC, strain) in run.states:
            continue
        is_tried = (TRUTH, strain) in run.states or (TRUTH, strain) in run.failures
        if has_stress or not is_tried:
            run.solve(strain, 2)
    if Element.SMOOTHED in elements:
        for strain in strains:
            run.solve(strain, 1, Element.SMOOTHED)
    versions = next((dict(s.versions) for s in run.states.values()), {})
    names = ["P1", *(["smoothed tetrahedra"] if Element.SMOOTHED in elements else [])]
    if stored is not None:
        kept = {TRUTH, *(OF_ELEMENT[e] for e in Element if e not in elements)}
        held = {p: s for p, s in stored.states.items() if p[0] in kept and p not in run.states}
        return ReferenceSet(
            run.states | held,
            stored.bars,
            f"{', '.join(names)} and P2 solved here; the truth and its error bar stored (P2, finer "
            "meshes)",
            run.failures,
            {
                "versions": versions,
                "stored": dict(stored.provenance),
                **{k: stored.provenance.get(k, {}) for k in (PARTS, GEOMETRY)},
            },
        )
    told = {ADAPTIVE: run.records} if run.records else {}
    bars = run.every_bar()
    return ReferenceSet(
        run.states,
        bars,
        f"{', '.join(names)} and P2 solved here; {run.says_of_bars()}",
        run.failures,
        {"versions": versions, **told, PARTS: parts_of_statics(bars)},
        remarks=tuple(run.remarks()),
    )


def unknowns_of(problem: Problem) -> int:
    """Of P2 on the case's mesh: three at each point and edge."""
    mesh = problem.mesh
    pairs = np.sort(mesh.cells[:, EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    num_edges = len(np.unique(pairs[:, 0] * mesh.num_points + pairs[:, 1]))
    return 3 * (mesh.num_points + num_edges)


class _Run:
    """States as they come, and why one did not."""

    def __init__(
        self,
        problem: Problem,
        progress: Progress,
        asked: TruthRequest,
        known: Mapping[Place, State],
    ) -> None:
        self.problem, self.progress, self.asked = problem, progress, asked
        self.states: dict[Place, State] = dict(known)
        self.failures: dict[Place, str] = {}
        self.records: dict[str, Any] = {}
        self._graded: Bars = {}
        self._said: list[str] = []

    def has_equilibrium(self, strain: Strain) -> bool:
        """Solve P1; False where it lost equilibrium, and P2 need not be tried."""
        error = self.solve(strain, 1)
        if not isinstance(error, ReferenceNotConvergedError):
            return True
        self.failures[QUADRATIC, strain] = (
            f"{QUADRATIC}: not tried, because {SAME_MESH} lost equilibrium at "
            f"{error.load_factor:.3f} of the load ({error.reason}); lower the load"
        )
        return False

    def solve(
        self, strain: Strain, degree: int, element: Element = Element.LINEAR
    ) -> ReferenceFailedError | None:
        """One state on the case's mesh, or why there is none, which is kept."""
        label = OF_ELEMENT[element] if degree == 1 else QUADRATIC
        if (label, strain) in self.states:
            return None
        try:
            state = solve_state(
                self.problem,
                strain,
                degree,
                self.progress,
                element=element,
                start=self.asked.start,
            )
        except ReferenceUnavailableError:
            raise
        except ReferenceFailedError as error:
            self.failures[label, strain] = f"{label}: {error}"
            return error
        self.states[label, strain] = state
        return None

    def grade(self, strain: Strain, *, has_stress: bool) -> None:
        """The truth on graded meshes; on the case's alone, it is P2 there.

        P2 on the case's mesh is kept besides where its stresses are asked for.
        """
        problem = self.problem
        try:
            found = refine_truth(problem, strain, self.asked, self.progress, label=TRUTH)
        except ReferenceUnavailableError:
            raise
        except ReferenceFailedError as error:
            self.failures[TRUTH, strain] = f"{TRUTH}: {error}"
            return
        bars = graded_bars(problem, strain, found)
        label = TRUTH if bars else QUADRATIC
        seconds = float(found.seconds.sum())
        stresses = stresses_of(found)
        # Means over the case's cells, of which nothing is known on graded meshes.
        told: dict[str, Any] = {} if bars else {"stresses": stresses}
        if not bars:
            told["integrals"] = stress_integrals(problem.mesh, stresses, found.strain_energy)
        self.states[label, strain] = state_of(
            found, strain, label=label, degree=found.degree, seconds=seconds, **told
        )
        if bars and has_stress and found.first is not None:
            stresses = stresses_of(found.first)
            self.states[QUADRATIC, strain] = first_state(
                found,
                QUADRATIC,
                stresses=stresses,
                integrals=stress_integrals(problem.mesh, stresses, found.first.strain_energy),
            )
        self.records[strain.value] = record_of(found)
        self._graded |= {(metric, strain): bar for metric, bar in bars.items()}
        self._said.append(
            f"Truth, {strain} strain: {len(found.num_cells)} mesh(es), the last of "
            f"{int(found.num_cells[-1])} cells: {found.ended}."
        )

    def every_bar(self) -> Bars:
        """Of graded meshes where there are any, of P1 and P2 otherwise."""
        return estimate_bars(self.problem, self.states) | self._graded

    def says_of_bars(self) -> str:
        """Where the bars come from."""
        graded, both = (
            f"error bars of {TRUTH}: from graded meshes",
            f"error bars of {QUADRATIC}: its differences from P1, where they are below {FAR:.0%}",
        )
        parts = [graded] if self._graded else []
        if any((TRUTH, s) not in self.states and (QUADRATIC, s) in self.states for s in Strain):
            parts.append(both)
        return "; ".join(parts) or "no error bars"

    def remarks(self) -> list[str]:
        """How the graded meshes ended, and where linear tetrahedra tell nothing."""
        said = list(self._said)
        for strain in Strain:
            linear = self.states.get((SAME_MESH, strain))
            truth = self.states.get((TRUTH, strain)) or self.states.get((QUADRATIC, strain))
            if linear is None or truth is None:
                continue
            apart = COMPARISONS["displacement_l2"](self.problem.mesh, linear, truth).value
            if apart > FAR:
                said.append(
                    f"P1 and P2 are {apart:.0%} apart in displacement_l2 ({strain} strain): this "
                    "mesh is too coarse for linear tetrahedra; refine it."
                )
        return said


def graded_bars(problem: Problem, strain: Strain, found: AdaptiveResult) -> dict[str, float]:
    """Bars of a truth on graded meshes: of three or more as stored ones have, else of two.

    Returns:
        By metric; none of one mesh alone.
    """
    from palpate.reference.adaptivity.error_bars import error_bar_of_two
    from palpate.reference.adaptivity.goals import has_point_forces

    if len(found.num_cells) < 2 and not found.ended.startswith(LOST):
        return {}
    if len(found.num_cells) != 2 or found.ended.startswith(LOST):
        return {metric: found.bar(metric) for metric in whole_metrics(problem)}
    bars = {
        name: error_bar_of_two(float(found.differences[-1, k]), found.estimates[:, k].tolist())
        for k, name in enumerate(found.quantities)
    }
    if not has_point_forces(problem, found):
        return bars
    return {m: bar if has_limit(m, strain) else math.inf for m, bar in bars.items()}


def estimate_bars(problem: Problem, states: Mapping[Place, State]) -> Bars:
    """P1 against P2 on the same mesh, for every metric and strain; the formula stands above.

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
        told = without_limits(problem, strain, apart, fine)
        bars |= {(metric, strain): bar for metric, bar in told.items()}
    return bars


def saturated(apart: float) -> float:
    """Bar of P2 by its relative difference from P1 [-]; infinite where they are too far apart."""
    return apart if apart <= FAR else math.inf
