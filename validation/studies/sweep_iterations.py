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
from palpate.validation.studies.sweep_runs import VaryError

ITERATIONS, TIME_STEP = "iterations", "time_step"
CLAIM = "more iterations and shorter steps bring it to the law it states"
# An error that the last move in iterations, or in the step, still made so much smaller may yet
# come down: nothing is concluded.
_STILL_FALLS = 0.5


@dataclass(frozen=True)
class Trial:
    """One answer of the simulator.

    Attributes:
        iterations: That it was told.
        time_step: That it was asked for [s]; None in statics.
        error: From the reference on the same mesh by the same scheme and step, relative in L2 (of
            a motion at the worst time) [-]; None where there is no answer.
        damping: Numerical, where its motion swings long enough.
        seconds: Of the simulator.
        trouble: Why there is no answer.
    """

    iterations: int
    time_step: float | None
    error: float | None
    damping: NumericalDamping | None = None
    seconds: float = 0.0
    trouble: str = ""


def read_moves(vary: Sequence[str]) -> tuple[tuple[int, ...], tuple[float | None, ...]]:
    """Iterations and time steps of words like `iterations=2,8,32` and `time_step=4e-3,2e-3`.

    Returns:
        Iterations, each at least 1; time steps [s], None alone where none are named.

    Raises:
        VaryError: Another key, no iterations, or values that cannot be meant.
    """
    moves: dict[str, tuple[float, ...]] = {}
    for words in vary:
        key, _, text = (part.strip() for part in words.partition("="))
        if key not in (ITERATIONS, TIME_STEP) or key in moves:
            raise VaryError(words, f"a simulator is varied by {ITERATIONS} and {TIME_STEP}, once")
        try:
            values = tuple(float(word) for word in text.split(","))
        except ValueError:
            raise VaryError(words, "write numbers: VALUE,VALUE,...") from None
        is_whole = key != ITERATIONS or all(value.is_integer() for value in values)
        if not is_whole or not all(math.isfinite(v) and v > 0.0 for v in values):
            raise VaryError(words, "needs values above 0, of iterations whole ones")
        if len(set(values)) < len(values):
            raise VaryError(words, "gives a value twice")
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
        ReferenceFailedError: The reference has no answer on the same mesh.
    """
    known: dict[tuple[Steps | None, object], State] = {}
    trials = []
    for step, many in product(time_steps, iterations):
        program = dataclasses.replace(
            simulator, iterations=many, integrator=integrator, time_step=step
        )
        candidate = outside_candidate(program)
        asked = program.stepped(case.problem).time
        stated = None if asked is None else asked.time_step
        try:
            state = candidate.solve(case.problem, case.strain, progress)
        except CandidateFailedError as error:
            trials.append(Trial(many, stated, None, trouble=str(error)))
            continue
        steps = state.steps
        if steps is None and stated is not None:
            steps = Steps(Integrator.CENTRAL_DIFFERENCES, stated)
        if (steps, state.element) not in known:
            known[steps, state.element] = _reference(case, steps, state, progress)
        metric = "displacement_l2" if steps is None else "trajectory_l2"
        error_left = measure(metric, case.problem, state, known[steps, state.element]).value
        trials.append(Trial(many, stated, error_left, _damping(case, state), seconds=state.seconds))
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


def judge(trials: Sequence[Trial], limit: float) -> Finding:
    """Whether it comes to the law it states.

    Args:
        trials: Of every step with every number of iterations.
        limit: What counts as come to it, relative [-].
    """
    answered = [t for t in trials if t.error is not None and math.isfinite(t.error)]
    if not answered:
        why = next((f": {t.trouble}" for t in trials if t.trouble), "")
        return Finding(CLAIM, f"no answer in {len(trials)} runs{why}", Verdict.FAILED)
    best = min(answered, key=_error)
    found = f"least error {_error(best):.2g} ({_place(best)}), limit {limit:g}"
    if _error(best) <= limit:
        return Finding(CLAIM, found, Verdict.PASSED)
    falling = _still_falling(answered)
    if falling:
        return Finding(CLAIM, f"{found}; still falling with {falling}", Verdict.INCONCLUSIVE)
    return Finding(
        CLAIM,
        f"{found}; it does not converge to the law it states: neither the last more iterations nor "
        "the last shorter steps halved what is left",
        Verdict.FAILED,
    )


def _still_falling(answered: Sequence[Trial]) -> str:
    """What still brought the error down, at the most iterations and the shortest step."""
    shortest = min(t.time_step or 0.0 for t in answered)
    at_step = sorted(
        (t for t in answered if (t.time_step or 0.0) == shortest), key=lambda t: t.iterations
    )
    last = at_step[-1]
    at_most = sorted(
        (t for t in answered if t.iterations == last.iterations),
        key=lambda t: -(t.time_step or 0.0),
    )
    words = []
    for what, row in (("more iterations", at_step), ("shorter steps", at_most)):
        if len(row) > 1 and _error(row[-1]) <= _STILL_FALLS * _error(row[-2]):
            words.append(what)
    return " and ".join(words)


def remarks_on(trials: Sequence[Trial]) -> list[str]:
    """For each step, what is left with the most iterations, and whether they are what it wants."""
    lines = []
    for step in dict.fromkeys(t.time_step for t in trials):
        row = [t for t in trials if t.time_step == step and t.error is not None]
        if len(row) < 2:
            continue
        row.sort(key=lambda t: t.iterations)
        last, before = row[-1], row[-2]
        line = f"{_place(last)}: {_error(last):.2g} is left"
        if _error(last) > _STILL_FALLS * _error(before):
            line += (
                f", against {_error(before):.2g} with {before.iterations}: more iterations are not "
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
    return leave(
        folder,
        console,
        name="iterations",
        title=f"{simulator.name} on {case.name}: iterations and steps",
        about=about,
        findings=[judge(trials, limit)],
        page=Page(
            figures={"error": draw(trials, limit, folder)}, tables={"iterations": table(trials)}
        ),
    )


def table(trials: Sequence[Trial]) -> Table:
    """Every trial."""
    return Table(
        "Every run",
        {
            "time step [s]": "g",
            "iterations": "d",
            "error [-]": ".3g",
            "damping ratio by the scheme [-]": ".3g",
            "damping ratio measured [-]": ".3g",
            "seconds": ".3g",
            "no answer because": "",
        },
        [
            (
                t.time_step,
                t.iterations,
                t.error,
                t.damping.formula if t.damping else None,
                t.damping.measured if t.damping else None,
                t.seconds,
                t.trouble,
            )
            for t in trials
        ],
    )


def draw(trials: Sequence[Trial], limit: float, folder: Path) -> Figure:
    """Error over iterations, a line for each step."""
    lines = []
    for step in dict.fromkeys(t.time_step for t in trials):
        row = [t for t in trials if t.time_step == step and t.error]
        row.sort(key=lambda t: t.iterations)
        label = "equilibrium" if step is None else f"steps of {step:g} s"
        if row:
            lines.append(Line([t.iterations for t in row], [_error(t) for t in row], label))
    panel = Panel(lines, x="iterations in a step", y="error [-]", log="xy", levels=(limit,))
    caption = (
        "Distance from the reference on the same mesh by the same scheme and step, each step "
        f"solved, relative in L2, at the worst time. Dotted: {limit:g}."
    )
    return line_figure([[panel]], caption, shares_legend=False, pdf=folder / "error.pdf")


def _error(trial: Trial) -> float:
    assert trial.error is not None
    return trial.error


def _place(trial: Trial) -> str:
    step = "" if trial.time_step is None else f", steps of {trial.time_step:g} s"
    return f"{trial.iterations} iterations{step}"
