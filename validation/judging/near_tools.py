"""A case with small cells near its tools, judged by the truth that is stored for the case itself.

Bisection leaves the body as it is, and so its truth. That is known at the points of the case's
mesh, which are the first of the finer one: there a candidate on small cells is compared with it.
On the same mesh it is compared with the reference solved here, where FEniCSx is installed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference import availability
from palpate.validation.cached_results import text_hash
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.results import CaseResult
from palpate.validation.states import (
    CandidateFailedError,
    Progress,
    State,
    Trajectory,
    gravest,
)

# Of a case by its stored references, or those solved here, for some candidates.
JudgeOne: TypeAlias = Callable[[Case, Sequence[Candidate], bool], CaseResult]
_Solutions: TypeAlias = dict[Strain, State | CandidateFailedError]

_NOT_HERE = (
    "Not judged: the reference on the small cells is not stored, and solving it needs FEniCSx "
    "(see README): {}."
)


def judge_near_tools(
    case: Case, candidates: Sequence[Candidate], judge_one: JudgeOne
) -> CaseResult:
    """Judge candidates on small cells near the tools of a case that has a stored truth.

    Args:
        case: With `near_tool`, and no law or contact that is not the file's.
        candidates: They solve on the small cells, once with each strain measure.
        judge_one: Judges a case, its references stored or, where the last argument is true, solved
            here.

    Raises:
        InputError: As `judge_case` does; also where no truth is stored.
    """
    case = _with_step(case)
    finer, solved = case.problem, [_Solutions() for _ in candidates]
    about_mesh = [spec for spec in case.checks if spec.against in ("same_mesh", "candidate")]
    about_truth = [spec for spec in case.checks if spec not in about_mesh]
    found: list[CaseResult] = []
    if about_truth:
        plain = _with_checks(replace(case, near_tool=None), about_truth)
        at_points = [
            _at_points(one, finer, known) for one, known in zip(candidates, solved, strict=True)
        ]
        found.append(judge_one(plain, at_points, False))
    # Where nothing else is judged, what is missing is an error.
    if about_mesh and (availability.is_available() or not found):
        again = [_again(one, known) for one, known in zip(candidates, solved, strict=True)]
        found.append(judge_one(_with_checks(case, about_mesh), again, True))
    elif about_mesh:
        left_out = ", ".join(f"{spec.metric} ({spec.against})" for spec in about_mesh)
        note = _NOT_HERE.format(left_out)
        found[0] = replace(found[0], notes=(*found[0].notes, note))
    first, *others = found
    candidates_then = zip(*(each.candidates for each in found), strict=True)
    return replace(
        first,
        name=case.name,
        verdict=gravest([each.verdict for each in found]),
        candidates=tuple(
            replace(each[0], verdict=gravest([one.verdict for one in each]))
            for each in candidates_then
        ),
        checks=tuple(check for each in found for check in each.checks),
        notes=tuple(dict.fromkeys(note for each in found for note in each.notes)),
        provenance={
            **first.provenance,
            "mesh": found[-1].provenance["mesh"],
            "near_tool": True,
            # Each covers its own checks.
            "input_key": text_hash(*(str(each.provenance["input_key"]) for each in found)),
        },
        unseen=(),
        diagnoses=tuple(one for each in others for one in each.diagnoses),
    )


def _with_step(case: Case) -> Case:
    """A motion in the steps that fastsim's linear tetrahedra bear: the same mesh has the same."""
    if case.problem.time is None or case.near_tool is None:
        return case
    from palpate.fastsim.explicit_body import ExplicitBody

    step = ExplicitBody(case.problem).time_step
    return replace(case, near_tool=replace(case.near_tool, time_step=step))


def _with_checks(case: Case, checks: Sequence[CheckSpec]) -> Case:
    return replace(case, spec=case.spec.model_copy(update={"check": tuple(checks)}))


def _solve(
    candidate: Candidate, problem: Problem, strain: Strain, progress: Progress, known: _Solutions
) -> State:
    """The candidate's state; it solves once, or fails once."""
    if strain not in known:
        try:
            known[strain] = candidate.solve(problem, strain, progress)
        except CandidateFailedError as error:
            known[strain] = error
    found = known[strain]
    if isinstance(found, CandidateFailedError):
        raise found
    return found


def _again(candidate: Candidate, known: _Solutions) -> Candidate:
    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        return _solve(candidate, problem, strain, progress, known)

    return replace(candidate, solve=solve)


def _at_points(candidate: Candidate, finer: Problem, known: _Solutions) -> Candidate:
    """The candidate on the finer mesh, read at the points of the case's."""

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        state = _solve(candidate, finer, strain, progress, known)
        return _cut(state, problem.mesh, finer.mesh)

    note = (
        f"Solved on {finer.mesh.num_cells} cells, small near the tools; compared with the truth "
        "at the points of the case's mesh."
    )
    return replace(candidate, solve=solve, notes=(*candidate.notes, note))


def _cut(state: State, mesh: TetMesh, finer: TetMesh) -> State:
    """A state at the points of the case's mesh; its volume, area and det F are the finer mesh's."""
    count = mesh.num_points

    def cut(motion: Trajectory | None) -> Trajectory | None:
        if motion is None:
            return None
        return replace(motion, displacements=motion.displacements[:, :count], problem=None)

    other = state.other_reading
    return replace(
        state,
        displacement=state.displacement[:count],
        volume=mesh.volume + (state.volume - finer.volume),
        surface_area=mesh.surface_area + (state.surface_area - finer.surface_area),
        trajectory=cut(state.trajectory),
        sent=cut(state.sent),
        other_reading=None if other is None else _cut(other, mesh, finer),
        stresses=None,
        sent_stress=None,
        problem=None,
    )
