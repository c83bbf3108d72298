"""Solve, estimate and refine, until the error bars are small enough."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import LocallyRefined, refine_cells
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference import fenicsx
from palpate.reference.adaptivity.duals import (
    GradientRecovery,
    Solved,
    duals_of,
    solve_duals,
    worst_of,
)
from palpate.reference.adaptivity.error_bars import (
    error_bar_of_few,
    error_bars,
    goes_towards_inversion,
)
from palpate.reference.adaptivity.first_mesh import first_mesh
from palpate.reference.adaptivity.goals import (
    Budget,
    Goal,
    JudgedSolution,
    Quantity,
    difference,
    has_limit,
    has_point_forces,
    softens,
)
from palpate.reference.branches import find_stability
from palpate.reference.deformed_state import least_moduli, least_modulus
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.reference.result import (
    LOST,
    REMEDY_OF_YIELD,
    YIELDS,
    AdaptiveResult,
    Formulation,
    ReferenceResult,
)
from palpate.reference.statics import Equilibrium, find_equilibrium
from palpate.reference.tasks import Progress, say_nothing


class History:
    """Sizes, estimates and error bars of each mesh.

    Attributes:
        meshes: For each mesh the fields of `AdaptiveResult` that have a row for it.
        stability: Of the first mesh, by `find_stability`.
    """

    def __init__(self, goals: Sequence[Goal]) -> None:
        self._goals = tuple(goals)
        self._names = tuple(goal.called for goal in goals)
        self._last: ReferenceResult | None = None
        self._is_singular = False
        self.stability = math.nan, math.nan
        self.meshes: list[dict[str, Any]] = []

    def add(
        self,
        problem: Problem,
        found: Equilibrium,
        state: ReferenceResult,
        errors: dict[Goal, Floats],
        began: float,
    ) -> None:
        """Store a mesh's estimates, its differences from the mesh before, and its bars.

        `state` is the result on the mesh of `problem`, the case's; `errors` are those of each goal
        by cells; the solve on this mesh began at a time [s].
        """
        mesh: dict[str, Any] = {
            "num_cells": found.problem.mesh.num_cells,
            "smallest_det_fs": found.smallest_det_f,
            "num_unknowns": int(fenicsx.total(found.discrete.num_dofs)),
            "estimates": [float(errors[goal].sum()) for goal in self._goals],
            "differences": [
                difference(goal, problem.mesh, state, self._last) if self._last else math.inf
                for goal in self._goals
            ],
        }
        self.meshes.append(mesh)
        self._last = state
        self._is_singular = has_point_forces(problem, state)
        # The first mesh has no difference.
        series = {
            name: (
                [of["differences"][k] for of in self.meshes[1:]],
                [of["estimates"][k] for of in self.meshes],
            )
            for k, name in enumerate(self._names)
        }
        bars = error_bars(series)
        is_softening = softens(problem, state.strain) and goes_towards_inversion(
            [of["smallest_det_fs"] for of in self.meshes]
        )
        mesh["bars"] = [
            bars[goal.called]
            if has_limit(goal.quantity, state.strain, has_point_forces=self._is_singular)
            and not (is_softening and goal.quantity.is_of_points)
            else math.inf
            for goal in self._goals
        ]
        mesh["seconds"] = time.perf_counter() - began

    @property
    def least_part(self) -> float:
        """The least part of all cells that is cut next, see LEAST_GROWTH."""
        cells = [mesh["num_cells"] for mesh in self.meshes]
        is_slow = any(b < LEAST_GROWTH * a for a, b in itertools.pairwise(cells))
        return LEAST_PART if is_slow else 0.0

    def mark(self, errors: Floats) -> NDArray[np.bool_]:
        """Cells to be cut: the bulk of the error, and at least `least_part` of all cells."""
        return mark_bulk(errors, BULK, least=int(self.least_part * len(errors)))

    def next_cells(self, budget: Budget) -> tuple[float, float]:
        """Fewest and most cells of the next mesh, with which there are enough meshes for a rate."""
        last, left = self.meshes[-1], _MESHES_OF_A_RATE - len(self.meshes)
        if left < 1:
            return 0.0, math.inf
        growth = (budget.unknowns / last["num_unknowns"]) ** (1.0 / left)
        return min(LEAST_GROWTH, growth) * last["num_cells"], growth * last["num_cells"]

    def lose_limit(self) -> None:
        """Set all bars to infinity, because a finer mesh has no equilibrium."""
        self.meshes[-1]["bars"] = [math.inf] * len(self._goals)

    def needs(self) -> list[float]:
        """Ratio of each goal's bar to its tolerance.

        A goal without a finite bar has the larger of its estimate and its difference instead.
        """
        keys = ("bars", "estimates", "differences")
        rows = zip(self._goals, *(self.meshes[-1][key] for key in keys), strict=True)
        needs = [
            (bar if math.isfinite(bar) else max(e, d) if math.isfinite(d) else e) / goal.tolerance
            for goal, bar, e, d in rows
        ]
        return needs if any(need > 0.0 for need in needs) else [1.0] * len(needs)

    def met(self) -> str:
        """A message if every bar is small enough, else an empty text."""
        pairs = zip(self.meshes[-1]["bars"], self._goals, strict=True)
        return "every bar is met" if all(bar <= goal.tolerance for bar, goal in pairs) else ""

    def decides(self, judged: Sequence[JudgedSolution], mesh: TetMesh) -> str:
        """A message if no finer mesh would change on which side of its limits anybody is.

        Bars of few meshes are those that such a truth has, `error_bar_of_few`.
        """
        last = self.meshes[-1]
        if not judged or self._last is None or len(self.meshes) < 2:
            return ""
        bars = {goal.quantity: last["bars"][k] for k, goal in enumerate(self._goals)}
        if not self._is_singular:
            bars = {
                goal.quantity: error_bar_of_few(
                    last["bars"][k],
                    [of["differences"][k] for of in self.meshes[1:]],
                    [of["estimates"][k] for of in self.meshes],
                )
                for k, goal in enumerate(self._goals)
            }
        is_decided = all(one.is_decided(mesh, self._last, bars) for one in judged)
        return "every verdict is certain" if is_decided else ""

    def line(self) -> str:
        """A line of progress for the last mesh."""
        mesh = self.meshes[-1]
        bars = zip(self._names, mesh["bars"], strict=True)
        return (
            f"mesh {len(self.meshes)}: {mesh['num_cells']} cells, {mesh['num_unknowns']} unknowns, "
            f"{mesh['seconds']:.1f} s; bars: {', '.join(f'{name} {bar:.2g}' for name, bar in bars)}"
        )

    def result(
        self, state: ReferenceResult, end: str, first: ReferenceResult | None
    ) -> AdaptiveResult:
        """The last state with the history of meshes, why it ended, and the first state."""
        fields = {f.name: getattr(state, f.name) for f in dataclasses.fields(ReferenceResult)}
        by_mesh: dict[str, Any] = {
            key: np.array([mesh[key] for mesh in self.meshes]) for key in self.meshes[0]
        }
        return AdaptiveResult(
            **fields,
            **by_mesh,
            quantities=self._names,
            tolerances=tuple(goal.tolerance for goal in self._goals),
            lowest_eigenvalue=self.stability[0],
            load_over_critical=self.stability[1],
            ended=end,
            first=first,
        )


# Fraction of the estimated error in the cells that are cut next (W. Doerfler, SIAM J. Numer. Anal.
# 33, 1996). Less gives better meshes in more steps; more gives a rate that is easier to see.
BULK = 0.6
# Once a mesh has less than this times the cells of the one before, at least this part of all cells
# is cut each time: where the error is that of one edge, differences and estimates would not fall
# enough for a bar (`error_bars`).
LEAST_GROWTH, LEAST_PART = 1.5, 0.1
# Cells below this stiffness over that at rest, see `least_moduli`, are not cut; the next value is
# taken where a mesh has no equilibrium. At a clamp strains grow by 2^(1/2) as cells are halved:
# in confined compression 0.3 becomes 0, and strains of softened cells grow by more.
SOFTENED = (0.35, 0.6, 0.8)
# Bars of fewer meshes show no rate (`error_bars`).
_MESHES_OF_A_RATE = 3
# How near to the fewest cells is enough, and how often that is tried.
_NEARLY, _MOST_TRIALS = 0.95, 8
# A mesh of c times the cells takes at most about c^1.3 times as long.
_GROWTH_OF_TIME = 1.3


def solve_adaptively(
    problem: Problem,
    goals: Sequence[Goal],
    *,
    budget: Budget | None = None,
    strain: Strain = Strain.GREEN,
    degree: int = 2,
    formulation: Formulation = Formulation.DISPLACEMENT,
    relative_tolerance: float = 1e-10,
    start: Points | None = None,
    judged: Sequence[JudgedSolution] = (),
    progress: Progress | None = None,
) -> AdaptiveResult:
    """Find equilibrium on meshes that are refined where the goals' error comes from.

    Cells are marked by the product of the gradient errors of the displacement and of the goals'
    duals (`duals`). Each mesh starts from the equilibrium on the last one.

    With Green strain cells that have softened to less than SOFTENED, and their neighbours, are not
    cut further: at the compressed side of a clamp strains grow without bound as cells shrink, and
    Saint-Venant-Kirchhoff loses its resistance at a stretch of about 0.6, so that the finer mesh
    would have no equilibrium. The error of those cells remains in the estimates, and through them
    in the bars. Where a mesh has no equilibrium all the same, fewer cells are cut.

    Args:
        problem: A problem on the case's mesh: the body that is solved is this polyhedron.
        goals: Quantities, each once, with the largest bars that are allowed.
        budget: Limits of time, memory and unknowns; half an hour and 8 GB where None.
        strain: Strain measure.
        degree: Polynomial degree of the displacement, 2 or 3.
        formulation: See `solve_static`.
        relative_tolerance: See `solve_static`.
        start: See `solve_static`; at the case's points. If given, the first mesh is fine enough for
            the tools where their paths end, and for the springs: see `first_mesh`.
        judged: Other solutions: no finer mesh is solved where bars decide on all of them, and no
            other one is tried where the next has no equilibrium and the law has lost its resistance
            in a cell of the last. The budget of unknowns is shared among the three meshes that
            bars need, each with LEAST_GROWTH times the cells of the one before where there is room;
            and the first of them is already refined for the error along the change from `start`, as
            later ones are for that since the mesh before.
        progress: Called with one line of text now and then.

    Returns:
        The state on the last mesh, at the points and in the cells of the case's, with the bars of
        the goals, the history of meshes, and the reason for its end; and the state on the case's
        mesh.

    Raises:
        InputError: No goals, a goal given twice, the force on tools without tools, or a problem
            that cannot be used.
        ReferenceNotConvergedError: No equilibrium under the full load on the first mesh.

    Note:
        Bars are for the continuum limit of this polyhedron, without the geometric error of a curved
        body. They are infinite where there is no limit, see `has_limit`, and where a finer mesh has
        no equilibrium near that of the coarser one.
    """
    if degree not in (2, 3):
        raise InputError(f"degree = {degree}: the adaptive truth needs 2 or 3")
    if not goals or len({goal.called for goal in goals}) < len(goals):
        raise InputError("the adaptive truth needs goals, each quantity or name once")
    if not problem.tools and any(goal.quantity is Quantity.TOOL_FORCE for goal in goals):
        raise InputError("tool_force: the problem has no tool; leave this goal out")
    allowed = budget or Budget()
    tell = progress or say_nothing
    begin, base = time.perf_counter(), _memory()
    case_cell = np.arange(problem.mesh.num_cells)
    current = problem
    before = start if judged else None
    if start is not None:
        current, start, case_cell = first_mesh(problem, start)
    history = History(goals)
    last: Equilibrium | None = None
    state: ReferenceResult | None = None
    first: ReferenceResult | None = None
    refined: LocallyRefined | None = None
    wrong, tries = np.zeros(0), 0
    while True:
        began = time.perf_counter()
        try:
            found = find_equilibrium(
                current,
                strain=strain,
                degree=degree,
                relative_tolerance=relative_tolerance,
                formulation=formulation,
                guess=_guess_from(last, refined),
                start=start if last is None else None,
                progress=tell,
            )
        except ReferenceNotConvergedError as error:
            if last is None or state is None or refined is None:
                raise
            tell(f"no equilibrium on {current.mesh.num_cells} cells: {error.reason}")
            if judged and (why := _yields(last)):
                history.lose_limit()
                return history.result(state, why, first)
            tries += 1
            if strain is Strain.LINEAR or tries == len(SOFTENED):
                history.lose_limit()
                end = f"{LOST}, {current.mesh.num_cells} cells: {error}"
                return history.result(state, end, first)
            rest = _left_to_cut(last, wrong, SOFTENED[tries])
            marked = history.mark(rest)
            refined = refine_cells(last.problem, marked)
            current = refined.problem
            continue
        case_cell = case_cell if refined is None else case_cell[refined.given_cell]
        last, before = found, before if state is None else state.displacement
        state = _on_case(found.result(), problem, current, case_cell)
        errors = _cell_errors(Solved(found, state, before, problem.mesh, case_cell), goals)
        if first is None and current is problem:
            first = state
        if not history.meshes:
            history.stability = find_stability(found)
        history.add(problem, found, state, errors, began)
        tell(history.line())
        end = history.met() or history.decides(judged, problem.mesh)
        if not end:
            wrong = _together(errors, history.needs())
            rest = _left_to_cut(last, wrong, SOFTENED[tries])
            marked = history.mark(rest)
            between = history.next_cells(allowed) if judged else (0.0, math.inf)
            refined = _refined(current, marked, rest, *between)
            end = (
                _too_much(history, refined, allowed, time.perf_counter() - begin, base)
                if marked.any()
                else "what is left of the error is in cells that have softened"
            )
        # The next mesh starts from the displacement and needs no matrix.
        last.destroy()
        gc.collect()
        if end:
            return history.result(state, end, first)
        assert refined is not None
        current = refined.problem


def _left_to_cut(found: Equilibrium, wrong: Floats, least_modulus: float) -> Floats:
    """Errors of the cells, 0 in those that have softened and in their neighbours."""
    # Other laws stiffen in compression.
    law = found.problem.material.law
    if found.discrete.strain is not Strain.GREEN or not law.is_linear_in_strain:
        return wrong
    cells = found.problem.mesh.cells
    is_soft = np.zeros(found.problem.mesh.num_points, dtype=bool)
    is_soft[cells[least_moduli(found.discrete, found.displacement) < least_modulus]] = True
    return np.where(is_soft[cells].any(axis=1), 0.0, wrong)


def _refined(
    problem: Problem, marked: NDArray[np.bool_], errors: Floats, fewest: float, most: float
) -> LocallyRefined:
    """Cut the marked cells, or so many of the worst that the number of cells is between bounds."""
    refined = refine_cells(problem, marked)
    worst, given = np.argsort(-errors, kind="stable"), problem.mesh.num_cells
    count, largest = int(marked.sum()), int((errors > 0.0).sum())
    for _ in range(_MOST_TRIALS):
        made = refined.problem.mesh.num_cells
        if _NEARLY * fewest <= made <= most or made == given:
            break
        # Aimed below the most, which neighbours that are cut too would exceed.
        aim = fewest if made < fewest else 0.5 * (1.0 + _NEARLY) * most
        wanted = int(count * max(0.0, aim - given) / (made - given))
        count = min(max(wanted, 1), largest)
        marked = np.zeros_like(marked)
        marked[worst[:count]] = True
        refined = refine_cells(problem, marked)
    return refined


def _yields(found: Equilibrium) -> str:
    """Why an equilibrium exists by its mesh alone; empty where that is not known."""
    least = least_modulus(found.discrete, found.displacement)
    if least > 0.0:
        return ""
    return (
        f"{YIELDS}: its least modulus in the body is {least:.2g} of that at rest, and a finer mesh "
        f"gives way there; {REMEDY_OF_YIELD}"
    )


def mark_bulk(errors: Floats, part: float, *, least: int = 1) -> NDArray[np.bool_]:
    """The fewest cells, but at least a number, that have a part, (0, 1], of all errors >= 0."""
    order = np.argsort(-errors, kind="stable")
    sums = np.cumsum(errors[order])
    marked = np.zeros(len(errors), dtype=bool)
    count = max(int(np.searchsorted(sums, part * sums[-1])) + 1, least)
    marked[order[:count]] = errors[order[:count]] > 0.0
    return marked


def _guess_from(
    last: Equilibrium | None, refined: LocallyRefined | None
) -> Callable[[DiscreteProblem], Floats] | None:
    if last is None or refined is None:
        return None

    def guess(finer: DiscreteProblem) -> Floats:
        for contact, coarser in zip(finer.contacts, last.discrete.contacts, strict=True):
            contact.go_on_from(coarser)
        return finer.carried(last.discrete, last.displacement, refined.given_cell)

    return guess


def _on_case(
    state: ReferenceResult, problem: Problem, current: Problem, case_cell: Indices
) -> ReferenceResult:
    """Values of a state on a finer mesh at the points and in the cells of the case's mesh."""
    mesh = current.mesh
    volumes = signed_volumes(mesh.points, mesh.cells)
    num_cells = problem.mesh.num_cells
    sums = np.bincount(case_cell, volumes, num_cells)

    def mean(tensors: Floats) -> Floats:
        whole = np.zeros((num_cells, 3, 3))
        np.add.at(whole, case_cell, volumes[:, None, None] * tensors)
        return whole / sums[:, None, None]

    return dataclasses.replace(
        state,
        displacement=state.displacement[: problem.mesh.num_points],
        second_piola_kirchhoff_stress=mean(state.second_piola_kirchhoff_stress),
        cauchy_stress=mean(state.cauchy_stress),
        first_piola_kirchhoff_stress=mean(state.first_piola_kirchhoff_stress),
    )


def _cell_errors(solved: Solved, goals: Sequence[Goal]) -> dict[Goal, Floats]:
    """Contributions of the cells to each goal's error, relative to the goal's scale [-]."""
    found, discrete = solved.found, solved.discrete
    inside = [
        solved.here(goal.part.is_inside(solved.case_mesh))
        for goal in goals
        if goal.part is not None and goal.quantity is Quantity.STRESS_L2
    ]
    recovery = GradientRecovery(discrete, inside)
    (rough,) = recovery.cell_errors([discrete.of_displacement(found.displacement)])
    keys = {goal: duals_of(goal, solved, rough) for goal in goals}
    duals = solve_duals(solved, list(dict.fromkeys(key for own in keys.values() for key in own)))
    weights = dict(zip(duals, recovery.cell_errors(list(duals.values())), strict=True))
    return {goal: worst_of([rough * weights[key] for key in own]) for goal, own in keys.items()}


def _together(errors: dict[Goal, Floats], needs: Sequence[float]) -> Floats:
    """Each cell's part of all goals' errors, weighted by the ratios of their bars to tolerances."""
    return sum(
        (
            need * parts / (parts.sum() or 1.0)
            for parts, need in zip(errors.values(), needs, strict=True)
        ),
        np.zeros(1),
    )


def _memory() -> float:
    """Peak memory of this process so far [GB]; 0 where the system (Windows) does not report it."""
    try:
        import resource
    except ImportError:
        return 0.0
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / (1e9 if sys.platform == "darwin" else 1e6)


def _too_much(
    history: History, refined: LocallyRefined, budget: Budget, spent: float, base: float
) -> str:
    """Why the next mesh is not begun, or an empty text. `base`: memory before the first [GB]."""
    last = history.meshes[-1]
    growth = refined.problem.mesh.num_cells / last["num_cells"]
    # The time on the first mesh may include that of the compiler.
    rate = last["seconds"] if len(history.meshes) > 1 else 0.0
    seconds = spent + rate * growth**_GROWTH_OF_TIME
    memory = fenicsx.largest(base + (_memory() - base) * growth)
    # Every rank must decide the same.
    if fenicsx.largest(seconds) > budget.seconds:
        return f"the next mesh would take until {seconds:.0f} s; the budget is {budget.seconds:g} s"
    if memory > budget.memory:
        return f"the next mesh would need {memory:.1f} GB; the budget is {budget.memory:g} GB"
    unknowns = last["num_unknowns"] * growth
    if unknowns > budget.unknowns:
        return (
            f"the next mesh would have {unknowns:.0f} unknowns; the budget is {budget.unknowns:g}"
        )
    return ""
