"""An outside simulator with more iterations and shorter steps: what is left, and of what.

Position-based and block-descent simulators stop after so many iterations. Compared with the
reference by their own scheme at their own step, each step solved, what is left is what iterations
did not do; where neither more of them nor shorter steps bring it down, the simulator does not
solve the law it states.

A simulator that ignores what it is asked for would be taken for one that has converged. So results
that are the same though asked for otherwise show nothing: neither a least error nor a fall of it is
read from them. One that is shown to ignore, or states other steps than it was asked for, fails.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.equations import differences
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import Case
from palpate.validation.case.variants import VaryError, read_values
from palpate.validation.metrics import measure
from palpate.validation.metrics.motion import NumericalDamping, measure_numerical_damping
from palpate.validation.quoting import in_quotes
from palpate.validation.references.runs import solve_by_steps, solve_state
from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, leave
from palpate.validation.states import CandidateFailedError, Precision, Progress, State, Verdict

ITERATIONS, TIME_STEP = "iterations", "time_step"
CLAIM = "more iterations and shorter steps bring it to the law it states"
TAKEN = "it takes the iterations and the steps that it is asked for"
# Results show no convergence that differ by less than this part of the limit; and they are the
# same one, computed once, where they differ by the rounding of doubles.
_SAME, _IDENTICAL = 1e-3, 1e-12
# Beyond this part of their size two motions are not the same, whatever rounded them.
_OTHER = 1e-6
# An error that the last move in iterations, or in the step, still made so much smaller may yet
# come down: nothing is concluded.
_STILL_FALLS = 0.5


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of the simulator.

    Attributes:
        iterations: Number that it was given.
        time_step: Step that it was asked for [s]; None in statics.
        error: From the reference on the same mesh by the same scheme and step, relative in L2 (of
            a motion at the worst time) [-]; infinite where there is no result.
        damping: Numerical, where its motion swings long enough.
        bar: What the comparison itself may be off by: states that are read between steps [-].
        seconds: Of the simulator.
        trouble: Why there is no result.
        stated: What its result states otherwise than it was asked for.
        motion: Its displacements [m], (num_times, num_points, 3).
        reference: Those of the reference that it is compared with.
    """

    iterations: int
    time_step: float | None
    error: float = math.inf
    damping: NumericalDamping | None = None
    bar: float = 0.0
    seconds: float = 0.0
    trouble: str = ""
    stated: str = ""
    motion: NDArray[np.float64] | None = None
    reference: NDArray[np.float64] | None = None

    def __str__(self) -> str:
        step = "" if self.time_step is None else f", steps of {self.time_step:g} s"
        return f"{self.iterations} iterations{step}"


def read_moves(vary: Sequence[str]) -> tuple[tuple[int, ...], tuple[float | None, ...]]:
    """Iterations and time steps of words like `iterations=2,8,32` and `time_step=4e-3,2e-3`.

    Returns:
        Iterations, each at least 1; time steps [s], None alone where none are named.

    Raises:
        VaryError: Another key, no iterations, or values that cannot be meant.
    """
    moves: dict[str, tuple[float, ...]] = {}
    for words in vary:
        key = words.partition("=")[0].strip()
        if key not in (ITERATIONS, TIME_STEP) or key in moves:
            raise VaryError(words, f"a simulator is varied by {ITERATIONS} and {TIME_STEP}, once")
        values = read_values(words)
        is_whole = key != ITERATIONS or all(value.is_integer() for value in values)
        if not is_whole or min(values) <= 0.0:
            raise VaryError(words, "needs values above 0, of iterations whole ones")
        moves[key] = values
    if ITERATIONS not in moves:
        raise InputError("say how many iterations: --vary iterations=2,8,32")
    return tuple(int(value) for value in moves[ITERATIONS]), moves.get(TIME_STEP, (None,))


def run_trials(
    case: Case,
    simulator: OutsideSimulator,
    iterations: Sequence[int],
    time_steps: Sequence[float | None],
    progress: Progress,
    *,
    integrator: Integrator | None = None,
) -> list[Trial]:
    """Every step with every number of iterations.

    Args:
        case: Its strain measure is asked for.
        simulator: With `{iterations}` in its command.
        iterations: Each at least 1.
        time_steps: [s]; None is the case's own, or statics.
        progress: Called with one line for each run.
        integrator: Of the simulator; central differences where None.

    Raises:
        InputError: A motion without a time step, or a command, case or scheme that cannot be used.
        ReferenceFailedError: The reference has no result on the same mesh.
    """
    scheme = integrator or Integrator.CENTRAL_DIFFERENCES
    known: dict[tuple[Steps | None, object], State] = {}
    trials = []
    for step, many in product(time_steps, iterations):
        program = dataclasses.replace(
            simulator, iterations=many, integrator=integrator, time_step=step
        )
        span = program.stepped(case.problem).time
        asked = None if span is None else span.time_step
        if span is not None and asked is None:
            raise InputError(f"{case.name} states no time step: vary time_step")
        steps = None if asked is None else Steps(scheme, asked)
        try:
            state = outside_candidate(program).solve(case.problem, case.strain, progress)
        except CandidateFailedError as error:
            trials.append(Trial(many, asked, trouble=str(error)))
            continue
        if (steps, state.element) not in known:
            known[steps, state.element] = _reference(case, steps, state, progress)
        reference = known[steps, state.element]
        metric = "displacement_l2" if steps is None else "trajectory_l2"
        found = measure(metric, case.problem, state, reference)
        left = found.value
        trials.append(
            Trial(
                many,
                asked,
                left if math.isfinite(left) else math.inf,
                _damping(case, state),
                found.uncertainty,
                state.seconds,
                stated=stated_otherwise(case.problem, state, program),
                motion=state.displacements,
                reference=reference.displacements,
            )
        )
    return trials


def _reference(case: Case, steps: Steps | None, state: State, progress: Progress) -> State:
    if steps is None:
        return solve_state(case.problem, case.strain, 1, progress, element=state.element)
    return solve_by_steps(case.problem, case.strain, steps, progress, element=state.element)


def stated_otherwise(problem: Problem, state: State, program: OutsideSimulator) -> str:
    """What a result states that is not what was asked for; "" where nothing is."""
    counts = (state.says.get(key) for key in ("iterations", "iterations_per_step"))
    found = [
        f"{in_quotes(str(count))} iterations"
        for count in counts
        if count is not None and count != program.iterations
    ]
    more = differences(
        problem,
        state,
        element=state.element,
        steps=program.asked,
        is_stepped=True,
        precision=Precision.SINGLE,
    )
    return ", ".join([*found, *(f"{each.stated} (asked was {each.asked})" for each in more)])


def _damping(case: Case, state: State) -> NumericalDamping | None:
    try:
        return measure_numerical_damping(case.problem, state)
    except InputError:
        return None


def _by_step(trials: Sequence[Trial]) -> dict[float | None, list[Trial]]:
    """Those that have a result, by time step, from the fewest iterations on."""
    solved = sorted((t for t in trials if math.isfinite(t.error)), key=lambda t: t.iterations)
    steps = dict.fromkeys(t.time_step for t in trials)
    return {step: [t for t in solved if t.time_step == step] for step in steps}


def _apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Distance of two motions, over the larger one."""
    size = max(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
    return float(np.linalg.norm(one - other)) / (size or 1.0)


def _pairs_within(trials: Sequence[Trial], tolerance: float) -> list[tuple[Trial, Trial]]:
    """Trials that were asked for otherwise and have the same result to a tolerance."""
    solved = sorted((t for t in trials if t.motion is not None), key=lambda t: t.iterations)
    return [
        (one, other)
        for one, other in combinations(solved, 2)
        if one.motion is not None and other.motion is not None
        and _apart(one.motion, other.motion) <= tolerance
    ]  # fmt: skip


def repeated(trials: Sequence[Trial], limit: float) -> dict[Trial, Trial]:
    """Trials that show nothing, each with another one that has the same result."""
    found: dict[Trial, Trial] = {}
    for one, other in _pairs_within(trials, _SAME * limit):
        found.setdefault(other, one)
        found.setdefault(one, other)
    return found


def _is_ignored(one: Trial, other: Trial, trials: Sequence[Trial]) -> bool:
    """Whether an identical result cannot be that of both: of two steps, or before a later one."""
    if one.time_step != other.time_step:
        assert one.reference is not None
        assert other.reference is not None
        return _apart(one.reference, other.reference) > _OTHER
    assert other.motion is not None
    return any(
        _apart(t.motion, other.motion) > _OTHER
        for t in trials
        if t.motion is not None and t.time_step == other.time_step
        and t.iterations > other.iterations
    )  # fmt: skip


def judge_taken(trials: Sequence[Trial], limit: float) -> Finding:
    """Whether it takes the iterations and the steps that it is asked for.

    Args:
        trials: Of every step with every number of iterations.
        limit: See `judge`; results that differ by a thousandth of it are the same.
    """
    stated = [f"{t}: states {t.stated}" for t in trials if t.stated]
    if stated:
        return Finding(TAKEN, _few(stated), Verdict.FAILED)
    identical = _pairs_within(trials, _IDENTICAL)
    ignored = [pair for pair in identical if _is_ignored(*pair, trials)]
    if ignored:
        words = "it ignores what it is asked for: the same result with "
        return Finding(TAKEN, words + _few([f"{a} and {b}" for a, b in ignored]), Verdict.FAILED)
    pairs = _pairs_within(trials, _SAME * limit)
    if pairs:
        found = (
            f"the same result to {_SAME * limit:g} with {_few([f'{a} and {b}' for a, b in pairs])}:"
            " it ignores them, or had come to its result before; vary fewer iterations, and steps "
            "that change the motion"
        )
        return Finding(TAKEN, found, Verdict.INCONCLUSIVE)
    count = sum(math.isfinite(t.error) for t in trials)
    if count < 2:
        found = f"{count} of {len(trials)} runs have a result: two are needed to see it"
        return Finding(TAKEN, found, Verdict.INCONCLUSIVE)
    return Finding(TAKEN, f"{count} results, no two the same", Verdict.PASSED)


def _few(words: Sequence[str]) -> str:
    more = f", and {len(words) - 3} more" if len(words) > 3 else ""
    return "; ".join(words[:3]) + more


def judge(trials: Sequence[Trial], limit: float) -> Finding:
    """Whether it comes to the law it states, by the results that differ from all others.

    Args:
        trials: Of every step with every number of iterations.
        limit: What counts as come to it, relative [-].
    """
    solved = [t for t in trials if math.isfinite(t.error)]
    if not solved:
        why = next((f": {t.trouble}" for t in trials if t.trouble), "")
        return Finding(CLAIM, f"no result in {len(trials)} runs{why}", Verdict.FAILED)
    nothing = repeated(trials, limit)
    telling = [t for t in solved if t not in nothing and not t.stated]
    best = min(telling, key=lambda t: t.error, default=None)
    if best is not None and best.error + best.bar <= limit:
        found = f"least error {best.error:.2g} ({best}), limit {limit:g}"
        return Finding(CLAIM, found, Verdict.PASSED)
    if best is not None and best.error - best.bar <= limit:
        found = (
            f"least error {best.error:.2g} +- {best.bar:.2g} ({best}), limit {limit:g}: outputs "
            "lie between steps; have the simulator send every step, or vary steps that divide them"
        )
        return Finding(CLAIM, found, Verdict.INCONCLUSIVE)
    if any(t.error <= limit for t in solved):
        found = (
            "what is within the limit shows no convergence: the same result was sent where other "
            "iterations or steps were asked for, or others are stated than were asked for"
        )
        return Finding(CLAIM, found, Verdict.INCONCLUSIVE)
    found = f"least error {best.error:.2g} ({best}), limit {limit:g}" if best else (
        f"no result is within the limit {limit:g}, and none differs from all others"
    )  # fmt: skip
    # At the shortest step and the most iterations.
    rows = {step or 0.0: row for step, row in _by_step(telling).items() if row}
    falling = []
    if rows:
        more = rows[min(rows)]
        ordered = (rows[step] for step in sorted(rows, reverse=True))
        shorter = [t for row in ordered for t in row if t.iterations == more[-1].iterations]
        falling = [
            words
            for words, row in (("more iterations", more), ("shorter steps", shorter))
            if len(row) > 1 and row[-1].error <= _STILL_FALLS * row[-2].error
            and not any(t in nothing and t.iterations >= row[-1].iterations for t in solved)
        ]  # fmt: skip
    if falling:
        found += f"; still falling with {' and '.join(falling)}"
        return Finding(CLAIM, found, Verdict.INCONCLUSIVE)
    found += (
        "; it does not converge to the law it states: neither the last more iterations nor the "
        "last shorter steps halved what is left"
    )
    return Finding(CLAIM, found, Verdict.FAILED)


def remarks_on(trials: Sequence[Trial], limit: float) -> list[str]:
    """For each step, what is left with the most iterations, and whether they are what it wants."""
    lines, nothing = [], repeated(trials, limit)
    for row in _by_step(trials).values():
        if len(row) < 2:
            continue
        before, last = row[-2:]
        line = f"{last}: {last.error:.2g} is left"
        if last in nothing or last.stated:
            other = last.stated and f"it states {last.stated}"
            line += f", which shows nothing: {other or f'the same result as {nothing[last]}'}"
        elif last.error > _STILL_FALLS * before.error:
            line += (
                f", against {before.error:.2g} with {before.iterations}: more iterations are not "
                "what it wants for"
            )
        if last.damping is not None:
            line += f"; {last.damping}"
        lines.append(f"{line}.")
    return lines


def sweep_iterations(
    case: Case,
    simulator: OutsideSimulator,
    iterations: Sequence[int],
    time_steps: Sequence[float | None],
    folder: Path,
    console: Console,
    *,
    integrator: Integrator | None = None,
    limit: float,
    progress: Progress,
) -> int:
    """Run all, and leave iterations.csv, error.svg and error.pdf, report.html and results.json.

    Returns:
        0 where it comes to the law it states, 1 where it does not, or ignores what it is asked
        for, 3 where its error still falls, or results that are the same show nothing.

    Raises:
        InputError: See `run_trials`.
    """
    try:
        trials = run_trials(
            case, simulator, iterations, time_steps, progress, integrator=integrator
        )
    except ReferenceFailedError as error:
        raise InputError(
            f"{case.name}: no reference to compare {simulator.name} with: {error}"
        ) from error
    about = [
        f"{case.title}. `{simulator.command}`, {case.strain} strain; compared with the reference "
        "on the same mesh by its own scheme at its own step, each step solved to 1e-10.",
        *remarks_on(trials, limit),
    ]
    tables = {"iterations": table(trials, limit)}
    return leave(
        folder,
        console,
        name="iterations",
        title=f"{simulator.name} on {case.name}: iterations and steps",
        about=about,
        findings=[judge(trials, limit), judge_taken(trials, limit)],
        page=Page(figures={"error": _draw(trials, limit, folder)}, tables=tables),
    )


def table(trials: Sequence[Trial], limit: float) -> Table:
    """Every trial; those that show nothing with the reason."""
    nothing = repeated(trials, limit)
    columns = {"time step [s]": "g", "iterations": "d", "error [-]": ".3g"}
    columns |= {f"damping ratio {how} [-]": ".3g" for how in ("by the scheme", "measured")}
    columns |= {"seconds": ".3g", "no result because": "", "shows nothing because": ""}
    rows = []
    for t in trials:
        damping = (t.damping.formula, t.damping.measured) if t.damping else (None, None)
        error = None if t.trouble else t.error
        shows = f"states {t.stated}" if t.stated else ""
        if t in nothing:
            shows = shows or f"the same result as {nothing[t]}"
        rows.append((t.time_step, t.iterations, error, *damping, t.seconds, t.trouble, shows))
    return Table("Every run", columns, rows)


def _draw(trials: Sequence[Trial], limit: float, folder: Path) -> Figure:
    """Error over iterations, a line for each step; what shows nothing as crosses beside them."""
    lines, nothing = [], repeated(trials, limit)
    lost = [t for t in trials if math.isfinite(t.error) and (t.stated or t in nothing)]
    for step, row in _by_step([t for t in trials if t not in lost]).items():
        label = "equilibrium" if step is None else f"steps of {step:g} s"
        if row:
            lines.append(_line(row, label))
    if lost:
        label = "the same result as another, or other steps stated"
        lines.append(_line(lost, label, "x"))
    panel = Panel(
        lines,
        x="iterations in a step",
        y="error [-]",
        log="xy",
        levels=(limit,),
        ticks={t.iterations: f"{t.iterations}" for t in trials},
    )
    caption = (
        "Distance from the reference on the same mesh by the same scheme and step, each step "
        f"solved, relative in L2, at the worst time. Dotted: {limit:g}."
    )
    return line_figure([[panel]], caption, shares_legend=False, pdf=folder / "error.pdf")


def _line(row: Sequence[Trial], label: str, style: str = "-o") -> Line:
    """Errors over iterations; an axis of powers of ten has no 0."""
    least = float(np.finfo(np.float64).eps)
    return Line([t.iterations for t in row], [max(t.error, least) for t in row], label, style)
