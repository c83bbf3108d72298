"""Compares a pose of the live page with the reference, as a program in the background.

python -m palpate.validation.live.verdict CASE.toml POSE.npz: the case is static, POSE holds each
pane's displacement [m], the force on the tool [N], strain measure and element. A pose that is not
at rest is brought to rest first, or is inconclusive. Two questions, one after the other:

- `SAME_MESH`: is it solved right? Each pane against the reference with its own strain measure and
  element on the same mesh: what is left is how far the pose is from rest.
- `TRUTH`: is it what tissue does? Every pane against P2 under Green strain, also those that are
  stepped with linear strain.

After each question, notes for the page go to standard output, a line of JSON each: the report on
every pane, and the length of its error at the surface points. Other lines report progress.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.result import LOST, REMEDY_OF_YIELD, YIELDS
from palpate.validation.case import Case, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.exchange.point_location import locate_points
from palpate.validation.judging.case_references import truth_request
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.judging.results import CheckResult
from palpate.validation.live.poses import PoseOfPane, at_rest, read_pose
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.references.adaptive_truth import ADAPTIVE, whole_metrics
from palpate.validation.references.geometry import with_geometry
from palpate.validation.references.reference_set import OF_ELEMENT, QUADRATIC, ReferenceSet
from palpate.validation.references.reference_set import SAME_MESH as LINEAR
from palpate.validation.references.reference_set import TRUTH as GRADED
from palpate.validation.references.runs import solve_state
from palpate.validation.references.statics import (
    UNKNOWNS,
    estimate_bars,
    solve_live,
    unknowns_of,
)
from palpate.validation.report.answer import amount_of, quantity_of
from palpate.validation.report.viewer import packed
from palpate.validation.states import CandidateFailedError, Progress, State, Verdict, gravest

if TYPE_CHECKING:
    from palpate.reference.adaptivity.goals import JudgedSolution

SAME_MESH, TRUTH = "same mesh", "truth"
ASKED = {SAME_MESH: "is it solved right?", TRUTH: "is it what tissue does?"}
_COLOUR = {
    SAME_MESH: "colour: distance from the reference on the same mesh, in mm",
    TRUTH: "colour: distance from the truth (quadratic tetrahedra, Green strain), in mm",
}
# Time budget of the reference: it ends before the page stops waiting [s].
_SECONDS = 120.0
# Unknowns of the largest mesh of a truth where that of the case is too large for the usual number,
# and how many times as many as on the case's own mesh: room for the three meshes that a bar needs,
# each with 1.6 times the cells of the last one, in one to two minutes.
LARGEST, _ROOM = 200_000.0, 2.5
# Relative residual of its equilibria: far less than its bars of a hundredth.
_RESIDUAL = 1e-6
# Time budget of the bar's geometry part, for bodies that have one [s].
_OF_GEOMETRY = 40.0
# The colours of errors end at this part of the largest displacement or beyond.
_LEAST_COLOUR = 0.01
# An error below this is not worth its digits [-].
_NOTHING = 1e-4
# The limits that end a truth here do not hold there.
_WITHOUT_LIMIT = "build its truth without this limit: palpate reference build {}"
_EQUATIONS = "the same equations on the same mesh: the rest is the way left to equilibrium"
_RIGHT = (
    {"metric": "displacement_l2", "limit": 0.01, "reason": _EQUATIONS},
    {"metric": "tool_force", "limit": 0.02, "reason": "less than the 7 % that a hand can tell"},
)


class PaneVerdict(NamedTuple):
    """The verdict on a pane, its checks in words, and its error's length at each point [m].

    The error is NaN where there is no reference.
    """

    name: str
    verdict: Verdict
    checks: list[str]
    error: Floats


def same_mesh_references(
    case: Case, panes: Sequence[PoseOfPane], progress: Progress
) -> ReferenceSet:
    """Solve the reference on the case's mesh for each strain measure and element of the panes."""
    states: dict[tuple[str, Strain], State] = {}
    failures: dict[tuple[str, Strain], str] = {}
    for pane in (pane for pane in panes if not pane.why):
        strain, element = pane.strain, pane.element
        key = (OF_ELEMENT[element], strain)
        if key in states or key in failures:
            continue
        try:
            states[key] = solve_state(
                case.problem, strain, 1, progress, element=element, start=pane.displacement
            )
        except ReferenceUnavailableError:
            raise
        except ReferenceFailedError as error:
            failures[key] = f"{key[0]}: {error}"
    return ReferenceSet(states, {}, "the same mesh, solved here", failures)


def true_references(
    case: Case, panes: Sequence[PoseOfPane], known: ReferenceSet, progress: Progress
) -> ReferenceSet:
    """Solve the truth under Green strain from the last such pose; it joins the known references.

    Raises:
        ReferenceFailedError: There is none, the tool never touches its body, the law yields, or
            the body is too large for it.
    """
    _require_small(case)
    _require_resistance(case, panes)
    request = truth_request(case)
    resting = [pane for pane in panes if pane.strain is Strain.GREEN and not pane.why]
    if not resting:
        raise ReferenceFailedError("no body under Green strain is at rest, from which it starts")
    start = resting[-1].displacement
    found = solve_live(
        case.problem,
        progress,
        request=replace(
            request,
            seconds=min(request.seconds, _SECONDS),
            start=start,
            residual=_RESIDUAL,
            judged=tuple(_judged(case, pane) for pane in panes if not pane.why),
            has_others=False,
        ),
        has_stress=False,
        strains=(Strain.GREEN,),
        unknowns=max(UNKNOWNS, min(_ROOM * unknowns_of(case.problem), LARGEST)),
        known=known.states,
    )
    truth = found.truth(Strain.GREEN)
    if truth is None:
        why = (
            found.failures.get((GRADED, Strain.GREEN))
            or found.failure("truth", Strain.GREEN)
            or "the reference found no equilibrium"
        )
        raise ReferenceFailedError(why)
    record = found.provenance.get(ADAPTIVE, {}).get(Strain.GREEN.value, {})
    if record.get("ended", "").startswith(YIELDS):
        raise ReferenceFailedError(record["ended"])
    if case.problem.tools and not np.any(truth.displacement):
        raise ReferenceFailedError(
            "nothing of its mesh reaches the tool (P2 touches with the middles of edges); take a "
            "finer mesh or a larger tool"
        )
    found = with_bars_of_two(case.problem, found)
    return with_geometry(
        case, found, progress, strains=(Strain.GREEN,), request=request, seconds=_OF_GEOMETRY
    )


def without_grades(
    case: Case, panes: Sequence[PoseOfPane]
) -> tuple[Case, list[PoseOfPane], Callable[[Floats], Floats]]:
    """The case and the poses on the mesh before it was graded, where the graded one is too large.

    The body is the same, and the points are the first of the graded mesh. A truth that begins
    there is refined where its own error comes from, and has room for more than one mesh.

    Returns:
        The case, the poses, and what reads numbers at its points at those of the graded mesh,
        linearly between them.
    """
    if not case.spec.mesh.grade or 2.0 * unknowns_of(case.problem) <= UNKNOWNS:
        return case, list(panes), lambda numbers: numbers
    mesh = case.mesh.mesh
    spec = case.spec.model_copy(update={"mesh": case.spec.mesh.model_copy(update={"grade": ()})})
    plain = replace(case, spec=spec)
    given, count = plain.mesh.mesh, plain.mesh.mesh.num_points
    if not np.array_equal(given.points, mesh.points[:count]):
        return case, list(panes), lambda numbers: numbers
    at = locate_points(given, mesh)

    def read(numbers: Floats) -> Floats:
        found: Floats = at.read(given.cells, numbers)
        return found

    return plain, [pane._replace(displacement=pane.displacement[:count]) for pane in panes], read


def _require_small(case: Case) -> None:
    """Refuse a body on whose mesh there is no room for a finer one, which a truth needs."""
    count, cells = unknowns_of(case.problem), case.mesh.mesh.num_cells
    if 2.0 * count > LARGEST:
        raise ReferenceFailedError(
            f"the body is too large for a live verdict: quadratic tetrahedra on its {cells} cells "
            f"have {count} unknowns, and of all meshes of a truth the largest may have "
            f"{LARGEST:.0f}, twice as many at least; take a mesh of at most "
            f"{int(cells * LARGEST / 2.0 / count)} cells, or {_WITHOUT_LIMIT.format(case.called)}"
        )


def _require_resistance(case: Case, panes: Sequence[PoseOfPane]) -> None:
    """Refuse a pose in which the law itself gives way: P2 would find that after a minute."""
    for pane in panes:
        if pane.why or pane.strain is not Strain.GREEN or pane.element is not Element.LINEAR:
            continue
        least = float(Body(case.problem, pane.strain).least_moduli(pane.displacement).min())
        if least <= 0.0:
            raise ReferenceFailedError(
                f"{YIELDS}: its least modulus in this pose is {least:.2g} of that at rest, and a "
                f"finer mesh gives way there; {REMEDY_OF_YIELD}"
            )


def _judged(case: Case, pane: PoseOfPane) -> JudgedSolution:
    """A pane with the limits of the case's checks against the truth."""
    from palpate.reference.adaptivity.goals import JudgedSolution, Quantity

    own = [spec for spec in case.checks if spec.against == "truth"]
    limits = {Quantity(s.metric): s.limit for s in own if s.metric in whole_metrics(case.problem)}
    return JudgedSolution(pane.displacement, pane.force[None], limits)


def with_bars_of_two(problem: Problem, found: ReferenceSet) -> ReferenceSet:
    """Bars of a truth on two meshes, which show no rate: its difference from P1 on the case's mesh.

    These are the bars of P2 on that mesh alone (`references.statics`), than which the truth is no
    worse. With three meshes, or where a limit was lost, an infinite bar stays infinite.
    """
    record = found.provenance.get(ADAPTIVE, {}).get(Strain.GREEN.value)
    truth, linear = (found.states.get((of, Strain.GREEN)) for of in (GRADED, LINEAR))
    if record is None or truth is None or linear is None:
        return found
    if len(record["cells"]) != 2 or record["ended"].startswith(LOST):
        return found
    positions = {(LINEAR, Strain.GREEN): linear, (QUADRATIC, Strain.GREEN): truth}
    rough = estimate_bars(problem, positions)
    finite = {position: bar for position, bar in found.bars.items() if math.isfinite(bar)}
    return replace(found, bars={**found.bars, **rough, **finite})


def judge_panes(
    question: str, case: Case, panes: Sequence[PoseOfPane], references: ReferenceSet
) -> list[PaneVerdict]:
    """Compare the panes with the references of a question."""
    found = []
    for pane in panes:
        if pane.why:
            nowhere = np.full(case.mesh.mesh.num_points, np.nan)
            found.append(PaneVerdict(pane.name, Verdict.INCONCLUSIVE, [pane.why], nowhere))
            continue
        strain = pane.strain if question == SAME_MESH else Strain.GREEN
        own = references.of_element(pane.element)
        judge = CaseJudge(case, own)
        state, why = _usable_state(pane, case.problem, strain)
        checks = [judge.check(spec, state, why) for spec in _checks(question, case, strain)]
        words = [why] if why else [text for check in checks if (text := _in_words(check))]
        reference = own.same_mesh(strain) if question == SAME_MESH else own.truth(strain)
        error = np.full(case.mesh.mesh.num_points, np.nan)
        if reference is not None:
            error = np.linalg.norm(pane.displacement - reference.displacement, axis=1)
        verdict = gravest([check.verdict for check in checks])
        if question == TRUTH and verdict is Verdict.INCONCLUSIVE and not why:
            words += _why_no_further(case, own)
        found.append(PaneVerdict(pane.name, verdict, words, error))
    return found


def _why_no_further(case: Case, references: ReferenceSet) -> list[str]:
    """What ended a truth whose bars decide nothing: most often a limit of time or unknowns."""
    record = references.provenance.get(ADAPTIVE, {}).get(Strain.GREEN.value, {})
    ended = record.get("ended", "")
    if not ended:
        return []
    is_limit = "budget" in ended
    remedy = f"; take a coarser mesh, or {_WITHOUT_LIMIT.format(case.called)}" if is_limit else ""
    return [f"the truth ended before it could decide: {ended}{remedy}"]


def _usable_state(pane: PoseOfPane, problem: Problem, strain: Strain) -> tuple[State | None, str]:
    try:
        state = pane.state(problem, strain)
    except CandidateFailedError as error:
        return None, str(error)
    why = unmeasurable_state(state) or state_out_of_reach(problem, state)
    return (None, why) if why else (state, "")


def _checks(question: str, case: Case, strain: Strain) -> list[CheckSpec]:
    """The checks of a question; the case's own checks belong to the truth."""
    if question == TRUTH:
        return list(case.checks)
    has_tool = bool(case.problem.tools)
    return [
        CheckSpec.model_validate({**spec, "against": "same_mesh", "strain": strain.value})
        for spec in _RIGHT
        if has_tool or spec["metric"] != "tool_force"
    ]


def _in_words(check: CheckResult) -> str:
    """What a check found; empty for a quantity of the result alone that is as it should be."""
    is_own = check.against == "candidate"
    if check.value is None or (is_own and check.verdict is not Verdict.PASSED):
        return check.message
    if is_own:
        return ""
    if check.unit == "-" and check.value < _NOTHING and check.verdict is Verdict.PASSED:
        return f"{quantity_of(check)} off by less than {100.0 * _NOTHING:g} %"
    return f"{quantity_of(check)} off by {amount_of(check)}"


def say(
    path: Path, question: str, panes: Sequence[PaneVerdict], used: Indices, size: float = 0.0
) -> None:
    """Print the note of a verdict: on each pane, and on the errors at the surface points.

    Args:
        path: The case.
        question: `SAME_MESH` or `TRUTH`.
        panes: Their verdicts.
        used: Points of the surface, shape (n,).
        size: Largest displacement [m]: of what is nearly nothing beside it the colours show none.
    """
    lengths = [1e3 * pane.error[used] for pane in panes]
    there = [of for of in lengths if np.isfinite(of).all()]
    largest = max((float(of.max()) for of in there), default=0.0)
    note = {
        "kind": "judged",
        "text": f"this pose is a case: palpate report {path} -o out/pose writes the whole report",
        "question": ASKED[question],
        "rows": [
            {"name": pane.name, "verdict": pane.verdict, "words": "; ".join(pane.checks)}
            for pane in panes
        ],
        "colour": _COLOUR[question],
        "against": question,
        "more": question == SAME_MESH,
        "verdicts": [pane.verdict for pane in panes],
        "largest": max(largest, _LEAST_COLOUR * 1e3 * size),
        "errors": [packed(of, np.float32) if np.isfinite(of).all() else None for of in lengths],
    }
    print(json.dumps(note, allow_nan=False), flush=True)


def main(words: list[str]) -> int:
    """Run the program; see the module."""
    path, pose = map(Path, words)

    def progress(line: str) -> None:
        print(line, flush=True)

    try:
        case, panes = load_case(path), read_pose(pose)
        used = np.unique(case.problem.mesh.boundary_facets)
        size = max(float(np.linalg.norm(pane.displacement, axis=1).max()) for pane in panes)
        rested = [at_rest(case.problem, pane, progress) for pane in panes]
        panes = [pane for pane, _ in rested]
        for text in (done for _, done in rested if done):
            print(json.dumps({"kind": "note", "text": text}), flush=True)
        known = same_mesh_references(case, panes, progress)
        say(path, SAME_MESH, judge_panes(SAME_MESH, case, panes, known), used, size)
        plain, cut, read = without_grades(case, panes)
        if plain is not case:
            known = same_mesh_references(plain, [], progress)
        found = true_references(plain, cut, known, progress)
        rows = judge_panes(TRUTH, plain, cut, found)
        say(path, TRUTH, [row._replace(error=read(row.error)) for row in rows], used, size)
    except (InputError, ReferenceFailedError, ReferenceUnavailableError) as error:
        # In the units of the page.
        said = Units(length="mm", stress="kPa").in_case_units(str(error))
        print(said, file=sys.stderr, flush=True)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
