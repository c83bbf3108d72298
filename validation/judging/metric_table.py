"""Which metric sees which fault: every metric alone, on cases of each kind.

A case is judged by one metric only, for each metric of the catalogue, and the candidate's answer
is spoiled by every fault that can show there. A metric that no realistic fault turns red would be
an ornament.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.candidates.candidate import Candidate
from palpate.validation.candidates.faults import Fault, on_own_mesh, with_fault
from palpate.validation.case import Case, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.case_judge import CaseJudge
from palpate.validation.judging.judge import find_references
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics import CATALOGUE
from palpate.validation.states import CandidateFailedError, Progress, State, Verdict, in_silence

# Kind of a case, the built-in one, and whether the answer comes on a mesh of its own.
KINDS = (
    ("statics", "block", False),
    ("motion", "block-motion", False),
    ("pressed tool", "press", False),
    ("moving tool", "slide", False),
    ("own mesh", "block", True),
)
# Cases whose published numbers are checked alone, each metric at the first that has it.
PUBLISHED_CASES = (
    ("statics", "stretch"),
    ("motion", "wave"),
    ("statics", "turned"),
    ("pressed tool", "drag"),
)
# Of the same equations on the same mesh; fits to a motion are as good as their samples.
_SAME_MESH, _FITTED = 1e-6, 1e-3
# Of a mesh cut in eight, against the truth: what bends easily is a third off on the case's own.
_OWN_MESH = 0.35
# Of every case above, metres or millimetres.
_EVERYWHERE = {"half_space": {"point": (-1e6, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)}}
# Found when the answer is read, whatever is checked.
_NOT_TELLING = (Fault.NONE, Fault.NAN)


@dataclass(frozen=True)
class Row:
    """One metric on one kind of case.

    Attributes:
        metric: Its name.
        kind: Statics, motion, a tool, or an answer on a mesh of its own.
        healthy: Verdict of the unspoiled answer with this metric alone.
        seen: Faults that turn it red.
        unseen: Faults that it lets pass.
    """

    metric: str
    kind: str
    healthy: Verdict
    seen: tuple[Fault, ...]
    unseen: tuple[Fault, ...]


def metric_table(candidate: Candidate, progress: Progress) -> list[Row]:
    """Every metric alone against every fault, on a case of each kind."""
    rows: list[Row] = []
    for kind, name, is_own in KINDS:
        progress(f"metrics alone, {kind}: {name}")
        given = on_own_mesh(candidate) if is_own else candidate
        rows += _rows(kind, load_case(name), given, is_own=is_own)
    for kind, name in PUBLISHED_CASES:
        progress(f"metrics alone, published numbers: {name}")
        told = {row.metric for row in rows}
        rows += _published_rows(kind, load_case(name), candidate, told)
    return rows


def _rows(kind: str, case: Case, candidate: Candidate, *, is_own: bool) -> list[Row]:
    specs = list(_specs(case, is_own=is_own))
    return _judge(kind, case, candidate, specs)


def _published_rows(kind: str, case: Case, candidate: Candidate, told: set[str]) -> list[Row]:
    firsts: dict[str, CheckSpec] = {}
    for spec in case.checks:
        if spec.about.is_published and spec.against == "candidate" and spec.metric not in told:
            firsts.setdefault(spec.metric, spec)
    return _judge(kind, case, candidate, list(firsts.values()))


def _judge(kind: str, case: Case, candidate: Candidate, specs: list[CheckSpec]) -> list[Row]:
    references = find_references(case, live=False, progress=in_silence)
    judge = CaseJudge(case, references.of_element(candidate.element))
    answers = {
        strain: {
            fault: _answer(case, candidate, fault, strain)
            for fault in Fault
            if fault is not Fault.NAN
        }
        for strain in dict.fromkeys(spec.strain or case.strain for spec in specs)
    }
    rows = []
    for spec in specs:
        of_fault = answers[spec.strain or case.strain]
        try:
            judge.check(spec, of_fault[Fault.NONE][0])
        except InputError:
            continue  # the reference itself does not swing there
        verdicts = {
            fault: judge.check(spec, answer, failure).verdict
            for fault, (answer, failure) in of_fault.items()
            if answer is not None or failure
        }
        tried = [fault for fault in verdicts if fault not in _NOT_TELLING]
        seen = tuple(fault for fault in tried if verdicts[fault] is Verdict.FAILED)
        unseen = tuple(fault for fault in tried if fault not in seen)
        rows.append(Row(spec.metric, kind, verdicts[Fault.NONE], seen, unseen))
    return rows


def _answer(
    case: Case, candidate: Candidate, fault: Fault, strain: Strain
) -> tuple[State | None, str]:
    """The spoiled answer; nothing where the fault cannot show, or its answer is refused."""
    try:
        return with_fault(candidate, fault).solve(case.problem, strain, in_silence), ""
    except InputError:
        return None, ""
    except CandidateFailedError as error:
        return None, str(error)


def _specs(case: Case, *, is_own: bool) -> Iterator[CheckSpec]:
    """Each metric that such a case can be asked for, alone."""
    problem = case.problem
    for metric in CATALOGUE.values():
        if metric.is_published:
            continue
        if (metric.needs_time and not problem.time) or (metric.needs_tools and not problem.tools):
            continue
        if metric.is_own:
            yield _spec(metric.name, "candidate", 0.0)
        elif not is_own:
            yield _spec(metric.name, "same_mesh", _FITTED if metric.is_fitted else _SAME_MESH)
        elif not metric.needs_same_mesh and (not problem.time or metric.has_moving_truth):
            yield _spec(metric.name, "truth", _OWN_MESH)


def _spec(metric: str, against: str, limit: float) -> CheckSpec:
    told = {"metric": metric, "against": against, "limit": limit, "reason": "this metric alone"}
    about = CATALOGUE[metric]
    if about.is_of_surface:
        told["support"] = 1
    elif about.of_part is not None:
        told["region"] = _EVERYWHERE
    return CheckSpec.model_validate(told)


def row_check(row: Row) -> CheckResult:
    """A row as a trial: passed where a fault is seen and the healthy answer is not red."""
    is_good = bool(row.seen) and row.healthy is not Verdict.FAILED
    named = ", ".join(row.seen[:3]) or "nothing"
    tried = len(row.seen) + len(row.unseen)
    return trial_check(
        f"{row.metric} alone, {row.kind}",
        load_case(KINDS[0][1]).strain,
        is_good,
        f"healthy: {row.healthy}; red with {len(row.seen)} of {tried}: {named}",
        reason="each metric must be able to go red alone",
    )


def table_lines(rows: list[Row]) -> list[str]:
    """The table metric by fault in fixed columns, with a legend."""
    if not rows:
        return []
    faults = [fault for fault in Fault if fault not in _NOT_TELLING]
    marks = [chr(ord("a") + place) for place in range(len(faults))]
    width = max(len(f"{row.metric}, {row.kind}") for row in rows)
    lines = ["Which metric alone sees which fault (x: red, .: let pass, blank: cannot show there):"]
    lines += [f"  {m}  {fault}: {fault.meaning}" for m, fault in zip(marks, faults, strict=True)]
    lines.append(" " * (width + 2) + " ".join(marks))
    for row in rows:
        cells = ["x" if f in row.seen else "." if f in row.unseen else " " for f in faults]
        lines.append(f"{row.metric}, {row.kind}".ljust(width + 2) + " ".join(cells))
    return lines


def trial_check(
    name: str, strain: Strain, is_good: bool, message: str, *, reason: str
) -> CheckResult:
    """Passed where the gate did what it should; it has no number and no limit."""
    return CheckResult(
        metric=name,
        against="self-test",
        strain=strain,
        verdict=Verdict.PASSED if is_good else Verdict.FAILED,
        reason=reason,
        message=message,
    )
