"""An outside simulator with more iterations and shorter steps: what is left, and of what.

Position-based and block-descent simulators stop after so many iterations. Held against the
reference by their own scheme at their own step, each step solved, what is left is what iterations
did not do; where neither more of them nor shorter steps bring it down, the simulator does not
solve the law it states.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import Case
from palpate.validation.metrics import measure
from palpate.validation.metrics.motion import NumericalDamping, measure_numerical_damping
from palpate.validation.references.runs import solve_by_steps, solve_state
from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, leave
from palpate.validation.states import CandidateFailedError, Progress, State, Verdict
from palpate.validation.studies.sweep_runs import VaryError, read_values

ITERATIONS, TIME_STEP = "iterations", "time_step"
CLAIM = "more iterations and shorter steps bring it to the law it states"
# An error that the last move in iterations, or in the step, still made so much smaller may yet
# come down: nothing is concluded.
_STILL_FALLS = 0.5


@dataclass(frozen=True)
class Trial:
    """One run of the simulator.

    Attributes:
        iterations: Number that it was given.
        time_step: Step that it was asked for [s]; None in statics.
        error: From the reference on the same mesh by the same scheme and step, relative in L2 (of
            a motion at the worst time) [-]; infinite where there is no result.
        damping: Numerical, where its motion swings long enough.
        seconds: Of the simulator.
        trouble: Why there is no result.
    """

    iterations: int
    time_step: float | None
    error: float = math.inf
    damping: NumericalDamping | None = None
    seconds: float = 0.0
    trouble: str = ""

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
        simulator: With a place for the iterations.
        iterations: Each at least 1.
        time_steps: [s]; None is the case's own, or statics.
        progress: Called with one line for each run.
        integrator: Of the simulator, where its result does not say.

    Raises:
        InputError: A step that the outputs are not whole numbers of apart, or a command, case or
            scheme that cannot be used.
        ReferenceFailedError: The reference has no result on the same mesh.
    """
    known: dict[tuple[Steps | None, object], State] = {}
    trials = []
    for step, many in product(time_steps, iterations):
        program = dataclasses.replace(
            simulator, iterations=many, integrator=integrator, time_step=step
        )
        asked = program.stepped(case.problem).time
        stated = None if asked is None else asked.time_step
        candidate = outside_candidate(program)
        try:
            state = candidate.solve(case.problem, case.strain, progress)
        except CandidateFailedError as error:
            trials.append(Trial(many, stated, trouble=str(error)))
            continue
        steps = state.steps
        if steps is None and stated is not None:
            steps = Steps(Integrator.CENTRAL_DIFFERENCES, stated)
        if (steps, state.element) not in known:
            known[steps, state.element] = _reference(case, steps, state, progress)
        metric = "displacement_l2" if steps is None else "trajectory_l2"
        left = measure(metric, case.problem, state, known[steps, state.element]).value
        error_left = left if math.isfinite(left) else math.inf
        trials.append(Trial(many, stated, error_left, _damping(case, state), state.seconds))
    return trials


def _reference(case: Case, steps: Steps | None, state: State, progress: Progress) -> State:
    if case.problem.time is None:
        return solve_state(case.problem, case.strain, 1, progress, element=state.element)
    if steps is None:
        raise InputError(
            "the simulator states no time step, and nor does the case: vary time_step, or give "
            "`time_step` in `about`"
        )
    return solve_by_steps(case.problem, case.strain, steps, progress, element=state.element)


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


def judge(trials: Sequence[Trial], limit: float) -> Finding:
    """Whether it comes to the law it states.

    Args:
        trials: Of every step with every number of iterations.
        limit: What counts as come to it, relative [-].
    """
    best = min(trials, key=lambda t: t.error)
    if not math.isfinite(best.error):
        why = next((f": {t.trouble}" for t in trials if t.trouble), "")
        return Finding(CLAIM, f"no answer in {len(trials)} runs{why}", Verdict.FAILED)
    found = f"least error {best.error:.2g} ({best}), limit {limit:g}"
    if best.error <= limit:
        return Finding(CLAIM, found, Verdict.PASSED)
    # At the shortest step and the most iterations.
    rows = {step or 0.0: row for step, row in _by_step(trials).items() if row}
    more = rows[min(rows)]
    ordered = (rows[step] for step in sorted(rows, reverse=True))
    shorter = [t for row in ordered for t in row if t.iterations == more[-1].iterations]
    falling = [
        words
        for words, row in (("more iterations", more), ("shorter steps", shorter))
        if len(row) > 1 and row[-1].error <= _STILL_FALLS * row[-2].error
    ]
    if falling:
        found += f"; still falling with {' and '.join(falling)}"
        return Finding(CLAIM, found, Verdict.INCONCLUSIVE)
    found += (
        "; it does not converge to the law it states: neither the last more iterations nor the "
        "last shorter steps halved what is left"
    )
    return Finding(CLAIM, found, Verdict.FAILED)


def remarks_on(trials: Sequence[Trial]) -> list[str]:
    """For each step, what is left with the most iterations, and whether they are what it wants."""
    lines = []
    for row in _by_step(trials).values():
        if len(row) < 2:
            continue
        before, last = row[-2:]
        line = f"{last}: {last.error:.2g} is left"
        if last.error > _STILL_FALLS * before.error:
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
        0 where it comes to the law it states, 1 where it does not, 3 where its error still falls.

    Raises:
        InputError: See `run_trials`.
    """
    try:
        trials = run_trials(
            case, simulator, iterations, time_steps, progress, integrator=integrator
        )
    except ReferenceFailedError as error:
        raise InputError(
            f"{case.name}: no reference to hold {simulator.name} against: {error}"
        ) from error
    about = [
        f"{case.title}. `{simulator.command}`, {case.strain} strain; held against the reference on "
        "the same mesh by its own scheme at its own step, each step solved to 1e-10.",
        *remarks_on(trials),
    ]
    figures, tables = {"error": _draw(trials, limit, folder)}, {"iterations": table(trials)}
    return leave(
        folder,
        console,
        name="iterations",
        title=f"{simulator.name} on {case.name}: iterations and steps",
        about=about,
        findings=[judge(trials, limit)],
        page=Page(figures=figures, tables=tables),
    )


def table(trials: Sequence[Trial]) -> Table:
    """Every trial."""
    columns = {"time step [s]": "g", "iterations": "d", "error [-]": ".3g"}
    columns |= {f"damping ratio {how} [-]": ".3g" for how in ("by the scheme", "measured")}
    columns |= {"seconds": ".3g", "no answer because": ""}
    rows = []
    for t in trials:
        damping = (t.damping.formula, t.damping.measured) if t.damping else (None, None)
        error = None if t.trouble else t.error
        rows.append((t.time_step, t.iterations, error, *damping, t.seconds, t.trouble))
    return Table("Every run", columns, rows)


def _draw(trials: Sequence[Trial], limit: float, folder: Path) -> Figure:
    """Error over iterations, a line for each step."""
    lines = []
    for step, row in _by_step(trials).items():
        label = "equilibrium" if step is None else f"steps of {step:g} s"
        if row:
            lines.append(Line([t.iterations for t in row], [t.error for t in row], label))
    panel = Panel(lines, x="iterations in a step", y="error [-]", log="xy", levels=(limit,))
    caption = (
        "Distance from the reference on the same mesh by the same scheme and step, each step "
        f"solved, relative in L2, at the worst time. Dotted: {limit:g}."
    )
    return line_figure([[panel]], caption, shares_legend=False, pdf=folder / "error.pdf")
