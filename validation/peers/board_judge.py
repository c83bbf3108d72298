"""Distance of a result from the truth of its own law, and the parts of this error.

The parts concern the point that moves most in the truth (of those that are not fixed): its
displacement along the truth's, over that displacement; with signs they add up to its error:

    law      the law that the result follows instead of the one that the simulator states
    mesh     the reference on the same mesh, linear or quadratic, less the truth
    solver   the result less the equilibrium of its own law on its own mesh
    step     of motions, at the time when that is: the reference on the same mesh by the scheme and
             step that the simulator states, less that in the case's steps; where it states none,
             what steps and solver add together. Where the case has no steps, in mesh
    contact  in the place of solver, of a simulator whose contact with tools is its own, taken
             elsewhere than the case says: what this way, the steps and the solver add together

The difference between the simulator's law and the case's own is no error here; it is reported
separately (`law_apart`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem
from palpate.validation.case import Case
from palpate.validation.diagnosis.result_hypotheses import distance
from palpate.validation.judging.case_references import are_the_cases
from palpate.validation.judging.checks import decide
from palpate.validation.metrics import measure
from palpate.validation.peers.board_references import NOT_A_LAW, OwnSteps, Truth, followed_law
from palpate.validation.peers.board_runs import Run, Status
from palpate.validation.peers.registry import Peer
from palpate.validation.references.reference_set import QUADRATIC
from palpate.validation.states import State, Verdict

LAW, MESH, STEP, SOLVER, CONTACT = CAUSES = ("law", "mesh", "step", "solver", "contact")


@dataclass(frozen=True, eq=False)
class Score:
    """A run, judged.

    Attributes:
        run: What was judged.
        law: Law of the truth it is compared with.
        metric: The metric of `distance`.
        distance: Relative distance from the truth; None where there is no result or no truth.
        bar: Error bar of the distance.
        limit: What a user of the case needs; None where the case does not state it.
        verdict: The verdict by these; skipped where there is none.
        same_mesh: Largest distance of a point from the reference on the same mesh, over the
            largest displacement.
        causes: Parts of the error by name, signed, over the truth's largest displacement.
        follows: The law that the result follows, where it is not `law`.
        law_apart: Distance of the truths of `law` and of the case's own law.
        why: The reason where there is no distance.
        smallest_det_f: Smallest det F of the result [-].
        tool_force: Largest error of the force on a tool, over the truth's; None without tools, and
            infinite where the simulator does not state them.
    """

    run: Run
    law: Law
    metric: str = "displacement_l2"
    distance: float | None = None
    bar: float | None = None
    limit: float | None = None
    verdict: Verdict = Verdict.SKIPPED
    same_mesh: float | None = None
    causes: Mapping[str, float] = field(default_factory=dict)
    follows: str = ""
    law_apart: float | None = None
    why: str = ""
    smallest_det_f: float | None = None
    tool_force: float | None = None


def judge_run(
    run: Run, entry: Peer, truth: Truth, of_case: Truth, own_steps: OwnSteps | None = None
) -> Score:
    """Compare a run with the truth of its law.

    Args:
        run: The run and its result.
        entry: The simulator.
        truth: Truth of the case under the simulator's law.
        of_case: Truth of the case under its own law.
        own_steps: References of motions by the simulator's own steps; None leaves these out.
    """
    case = truth.case
    metric = _metric(case.problem)
    asked = (
        check.limit
        for check in case.checks
        if (check.metric, check.against) == (metric, "truth")
        and (check.strain or case.strain) is case.strain
    )
    score = Score(run, truth.law, metric, limit=next(asked, None))
    if run.status is Status.FAILED:
        return dataclasses.replace(score, verdict=Verdict.FAILED, why=run.why)
    if run.state is None:
        return dataclasses.replace(score, why=run.why)
    state, references = run.state, truth.references
    score = dataclasses.replace(score, smallest_det_f=state.smallest_det_f)
    if references is None:
        return dataclasses.replace(score, why=f"no truth under this law: {truth.why}")
    references = references.of_element(state.element)
    best = references.truth(case.strain)
    same = references.same_mesh(case.strain)
    if entry.is_quadratic:
        same = references.states.get((QUADRATIC, case.strain))
    if same is not None:
        apart = distance(state.displacements, same.displacements)
        score = dataclasses.replace(score, same_mesh=apart)
    if best is None:
        return dataclasses.replace(score, why=f"no truth: {truth.why or 'none is stored'}")
    found = measure(metric, case.problem, state, best)
    if case.problem.tools:
        force = float(measure("tool_force", case.problem, state, best).value)
        score = dataclasses.replace(score, tool_force=force)
    bar = references.bars.get((metric, case.strain), np.inf) + found.uncertainty
    causes, follows = _causes(case, entry, state, best, same, own_steps)
    return dataclasses.replace(
        score,
        distance=float(found.value),
        bar=float(bar),
        verdict=Verdict.SKIPPED if score.limit is None else decide(found.value, bar, score.limit),
        causes=causes,
        follows=follows,
        law_apart=_law_apart(truth, of_case),
        why="" if np.isfinite(bar) else "the truth of this case has no error bar",
    )


def _metric(problem: Problem) -> str:
    """The metric of the distance from the truth."""
    return "displacement_l2" if problem.time is None else "trajectory_l2"


def _causes(
    case: Case,
    entry: Peer,
    state: State,
    truth: State,
    same: State | None,
    own_steps: OwnSteps | None,
) -> tuple[dict[str, float], str]:
    """Parts of a result's error where the truth moves most, and another law that it follows."""
    problem, strain = case.problem, case.strain
    lengths = np.linalg.norm(truth.displacements, axis=2)
    if problem.time is None:
        free = _is_free(problem)
        lengths = np.where(free, lengths, 0.0) if lengths[:, free].any() else lengths
    most = np.unravel_index(int(lengths.argmax()), lengths.shape)
    direction = truth.displacements[most]
    scale = float(direction @ direction)
    if not scale > 0.0:
        return {}, ""

    def at(of: State | Points) -> float:
        displacements = of.displacements if isinstance(of, State) else of[None]
        return float(displacements[most] @ direction) / scale

    if problem.time is not None:
        causes, follows = _causes_of_motion(problem, at, state, truth, same, own_steps)
        if _has_own_contact(problem, entry, state):
            causes[CONTACT] = causes.pop(STEP, 0.0) + causes.pop(SOLVER, 0.0)
        return causes, follows
    if same is None:
        return {}, ""
    own, follows = same.displacement, ""
    is_plain = state.element is Element.LINEAR and not entry.is_quadratic and not problem.tools
    if is_plain and distance(state.displacement, own) > NOT_A_LAW:
        found = followed_law(problem, strain, state.displacement, own)
        if found is not None:
            follows, own = found
    return {
        LAW: at(own) - at(same),
        MESH: at(same) - at(truth),
        CONTACT if _has_own_contact(problem, entry, state) else SOLVER: at(state) - at(own),
    }, follows


def _has_own_contact(problem: Problem, entry: Peer, state: State) -> bool:
    """Whether a simulator of others does not state that contact is where the case says."""
    rules = {tool.contact for tool in problem.tools}
    return entry.is_outside and any(state.says.get("contact") != rule for rule in rules)


def _is_free(problem: Problem) -> NDArray[np.bool_]:
    """Whether a point is not fixed in all components, (num_points,)."""
    free = np.ones(problem.mesh.num_points, dtype=bool)
    for support in problem.supports:
        if support.normal is None and all(support.components):
            free[support.points] = False
    return free


def _causes_of_motion(
    problem: Problem,
    at: Callable[[State], float],
    state: State,
    truth: State,
    same: State | None,
    own_steps: OwnSteps | None,
) -> tuple[dict[str, float], str]:
    stepped = own_steps.of(problem, state) if own_steps else None
    if same is None:  # the case has no steps: those of the simulator count as mesh
        if stepped is None:
            return {}, ""
        return {MESH: at(stepped) - at(truth), SOLVER: at(state) - at(stepped)}, ""
    in_steps = stepped or same
    found = own_steps.followed(problem, state, in_steps) if own_steps else None
    follows, own = found or ("", in_steps)
    causes = {} if found is None else {LAW: at(own) - at(in_steps)}
    causes[MESH] = at(same) - at(truth)
    is_known = state.steps is not None and are_the_cases(problem, state.steps)
    if stepped is None and not is_known:
        return {**causes, STEP: at(state) - at(own)}, follows
    return {**causes, STEP: at(in_steps) - at(same), SOLVER: at(state) - at(own)}, follows


def _law_apart(truth: Truth, of_case: Truth) -> float | None:
    """The distance between the truths of this law and of the case's own."""
    if truth.case.other_law is None or truth.references is None or of_case.references is None:
        return None
    problem, strain = truth.case.problem, truth.case.strain
    mine, asked = truth.references.truth(strain), of_case.references.truth(strain)
    if mine is None or asked is None:
        return None
    return float(measure(_metric(problem), problem, mine, asked).value)
