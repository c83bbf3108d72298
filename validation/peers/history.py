"""How far off released versions of a simulator are on small cases, and between which this changed.

Each version runs the registry's adapter in an environment of its own. A version to which an adapter
does not fit, or that has no wheels for this Python, is skipped with a word and has no number.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from palpate.meshes.errors import InputError
from palpate.reference.availability import require_available
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import Case
from palpate.validation.judging.case_references import is_to_be_solved
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.peers.registry import ADAPTERS, Peer, read_peers
from palpate.validation.peers.released import (
    Installed,
    NotInstalledError,
    in_range,
    installed,
)
from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table
from palpate.validation.states import Progress, Verdict, in_silence

# Errors that differ by more than this part of the larger one are different.
DIFFERENT = 0.01
_BYTES = 1_000_000_000
# Field of an adapter's result file.
_RESULT = "{result}"


@dataclass(frozen=True)
class Judgement:
    """A version on a case.

    Attributes:
        version: The version.
        case: The case's name.
        verdict: The gate's; failed where the simulator ends without a result, and skipped where
            it cannot be installed, the case not be posed to it, or no check holds.
        error: Distance from the reference on the same mesh over the largest displacement [-];
            None where there is no result.
        words: The diagnosis, or why there is no result.
        scatter: Error below which a result agrees, and two are the same; see `Peer`.
    """

    version: str
    case: str
    verdict: Verdict
    error: float | None = None
    words: str = ""
    scatter: float = 1e-5

    @property
    def outcome(self) -> str:
        """A number, "ended" without a result, or "skipped"."""
        if self.error is not None:
            return "number"
        return "ended" if self.verdict is Verdict.FAILED else "skipped"


@dataclass(frozen=True)
class Change:
    """Two versions beside one another in a history that are not equally far off on a case."""

    case: str
    before: Judgement
    after: Judgement


@dataclass
class History:
    """What was judged, oldest version first within each case.

    Attributes:
        peer: The simulator.
        judgements: Every version on every case.
        environments: What was installed.
        not_tried: Versions between that a bisection left out.
    """

    peer: Peer
    judgements: list[Judgement] = field(default_factory=list)
    environments: list[Installed] = field(default_factory=list)
    not_tried: list[str] = field(default_factory=list)

    @property
    def cases(self) -> list[str]:
        """Names of the cases, in their order."""
        return list(dict.fromkeys(j.case for j in self.judgements))

    def of_case(self, case: str) -> list[Judgement]:
        """Every version on a case, oldest first."""
        return [j for j in self.judgements if j.case == case]

    @property
    def changes(self) -> list[Change]:
        """Where neighbouring versions that were judged differ."""
        found = []
        for case in self.cases:
            judged = [j for j in self.of_case(case) if j.outcome != "skipped"]
            pairs = itertools.pairwise(judged)
            found += [Change(case, a, b) for a, b in pairs if differ(a, b)]
        return found


def differ(a: Judgement, b: Judgement) -> bool:
    """Whether two versions are not equally far off, or one ends without a result alone."""
    if a.error is None or b.error is None:
        return sorted((a.outcome, b.outcome)) == ["ended", "number"]
    most = max(a.error, b.error)
    least = max(a.scatter, DIFFERENT * most)
    return most > a.scatter and abs(a.error - b.error) > least


def peer_of(name: str) -> tuple[Peer, str]:
    """The registry's row of this name, package or module, and the package it is released as.

    Raises:
        InputError: There is none, or it comes from no package index.
    """
    released = [p for p in read_peers() if p.adapter and p.packages and not p.program]
    for peer in released:
        if name in (peer.name, peer.packages[0], peer.module):
            return peer, peer.packages[0]
    known = ", ".join(dict.fromkeys(p.packages[0] for p in released))
    raise InputError(f"no released simulator {name!r}; there are {known}")


def with_options(peer: Peer, words: Sequence[str]) -> Peer:
    """A simulator whose adapter is given further options, NAME=VALUE each.

    Raises:
        InputError: A word is none.
    """
    options = dict(peer.options)
    for word in words:
        name, equals, value = word.partition("=")
        if not (name.isidentifier() and equals):
            raise InputError(f"--option {word!r}: needs NAME=VALUE, as the adapter takes it")
        options[name] = value
    return peer.model_copy(update={"options": options})


def of_its_law(peer: Peer, cases: Sequence[Case]) -> list[Case]:
    """Cases under the law that a simulator solves.

    Raises:
        InputError: A case of linear strain, which knows no other law.
        ReferenceUnavailableError: One has another law, and its reference cannot be solved here.
    """
    if all(case.problem.material.law is peer.law for case in cases):
        return list(cases)
    require_available()
    same = [case.problem.material.law is peer.law for case in cases]
    return [case if its else case.under(peer.law) for case, its in zip(cases, same, strict=True)]


def trace(
    peer: Peer,
    package: str,
    versions: Sequence[str],
    cases: Sequence[Case],
    *,
    gigabytes: float,
    bisects: bool = False,
    time_limit: float = 120.0,
    progress: Progress = in_silence,
) -> History:
    """Judge versions on cases, one after the other.

    Args:
        peer: The simulator.
        package: The package it is released as.
        versions: Its versions, oldest first.
        cases: Small cases, under the simulator's own law; see `of_its_law`.
        gigabytes: What all new environments may take together [1e9 bytes].
        bisects: Whether only the first and last are judged, and between two that differ the middle.
        time_limit: Time limit of one run [s].
        progress: Called with a line for each version.

    Raises:
        InputError: A case cannot be used.
    """
    history = History(peer)
    left = gigabytes * _BYTES
    found: dict[str, list[Judgement]] = {}

    def judged(version: str) -> list[Judgement]:
        nonlocal left
        if version in found:
            return found[version]
        try:
            if peer.works_with and not _is_in(version, peer.works_with):
                raise NotInstalledError(f"the adapter is written for {peer.works_with} alone")
            environment = installed(package, version, beside(peer, version), int(left))
        except NotInstalledError as error:
            progress(f"{package} {version}: skipped, {error}")
            found[version] = [
                Judgement(version, c.name, Verdict.SKIPPED, words=str(error)) for c in cases
            ]
            return found[version]
        if environment.is_new:
            left -= environment.size
        history.environments.append(environment)
        found[version] = [_judge(peer, environment, case, time_limit) for case in cases]
        for each in found[version]:
            off = "no result" if each.error is None else f"{each.error:.2g} off"
            progress(f"{package} {version}, {each.case}: {off}; {each.words}")
        return found[version]

    if bisects:
        _bisect(versions, judged)
    else:
        for version in versions:
            judged(version)
    order = {version: number for number, version in enumerate(versions)}
    history.judgements = [
        found[v][k] for k in range(len(cases)) for v in sorted(found, key=order.__getitem__)
    ]
    history.not_tried = [v for v in versions if v not in found]
    return history


def beside(peer: Peer, version: str) -> tuple[str, ...]:
    """What is installed beside a version of a simulator."""
    found = (others for asked, others in peer.beside.items() if _is_in(version, asked))
    return next(found, peer.packages[1:])


def _is_in(version: str, asked: str) -> bool:
    try:
        return bool(in_range([version], asked))
    except InputError:
        return False


def _bisect(versions: Sequence[str], judged: Callable[[str], list[Judgement]]) -> None:
    """Judge the ends, and the middle of each stretch whose ends differ."""
    stretches = [(0, len(versions) - 1)]
    while stretches:
        low, high = stretches.pop()
        first, last = judged(versions[low]), judged(versions[high])
        # Between a version with a number and one without the first with a number is looked for;
        # between two without nothing is.
        known = [any(j.error is not None for j in of) for of in (first, last)]
        differs = known[0] != known[1] or any(map(differ, first, last))
        if high - low > 1 and differs:
            middle = (low + high) // 2
            stretches += [(low, middle), (middle, high)]


def _judge(peer: Peer, environment: Installed, case: Case, time_limit: float) -> Judgement:
    adapter = str(ADAPTERS / f"{peer.adapter}.py")
    options = [f"{name}={value}" for name, value in peer.options.items()]
    words = [shlex.quote(str(environment.python)), shlex.quote(adapter), "{case}", _RESULT]
    command = OutsideSimulator(" ".join([*words, *options]), time_limit)
    try:
        candidate = outside_candidate(command, element=peer.element)
        result = judge_case(case, live=is_to_be_solved(case), candidate=candidate)
    except InputError as error:
        return Judgement(environment.version, case.name, Verdict.SKIPPED, words=str(error))
    return _judgement(environment.version, case, result, peer.scatter)


def _judgement(version: str, case: Case, result: CaseResult, scatter: float) -> Judgement:
    errors = [
        check.value
        for check in result.checks
        if check.against == "same_mesh" and check.value is not None
    ]
    if not errors:
        failed = [check.message for check in result.checks if check.verdict is Verdict.FAILED]
        if failed:
            return Judgement(version, case.name, Verdict.FAILED, words=failed[0])
        why = next((check.message for check in result.checks if check.message), "no check holds")
        return Judgement(version, case.name, Verdict.SKIPPED, words=f"not judged: {why}")
    first = result.diagnoses[0].first if result.diagnoses else None
    words = first.name if first is not None else "no diagnosis"
    if max(errors) <= scatter:
        words = "agrees"
    return Judgement(version, case.name, result.verdict, float(max(errors)), words, scatter)


def page_of(history: History) -> tuple[list[Finding], Page]:
    """What was found, and the page's figure and tables."""
    findings = []
    for case in history.cases:
        changes = [c for c in history.changes if c.case == case]
        for c in changes:
            claim = f"{case}: changed between {c.before.version} and {c.after.version}"
            found = f"before: {_said(c.before)}; after: {_said(c.after)}"
            findings.append(Finding(claim, found, Verdict.FAILED))
        judged = [j for j in history.of_case(case) if j.error is not None]
        if not judged:
            findings.append(Finding(case, "no version has a result", Verdict.INCONCLUSIVE))
        elif not changes:
            off = (judged[-1].error or 0.0) > judged[-1].scatter
            said = _said(judged[-1]) if off else f"all {len(judged)} that were judged agree"
            found = f"{judged[0].version} to {judged[-1].version}: {said}"
            verdict = Verdict.FAILED if off else Verdict.PASSED
            findings.append(Finding(f"{case}: no change", found, verdict))
    rows = [(j.version, j.case, j.verdict.value, j.error, j.words) for j in history.judgements]
    columns = {"version": "", "case": "", "verdict": "", "error": ".3g", "what explains it": ""}
    settings = [(s.what, s.source) for s in history.peer.settings]
    given = ", ".join(f"{name}={value}" for name, value in history.peer.options.items())
    settings += (
        [(f"Options of the adapter: {given}", "this call, or the registry")] if given else []
    )
    wheels = [(e.version, name, h) for e in history.environments for name, h in e.wheels.items()]
    tables = {
        "history": Table("Versions", columns, rows),
        "settings": Table("Settings", {"setting": "", "source": ""}, settings),
        "wheels": Table(
            "Installed wheels", {"version": "", "wheel": "", "SHA-256": ""}, wheels, is_shown=False
        ),
    }
    figures = (
        {"versions": _figure(history)}
        if any(j.error is not None for j in history.judgements)
        else {}
    )
    remarks = []
    if history.not_tried:
        remarks.append("Not tried by the bisection: " + ", ".join(history.not_tried) + ".")
    return findings, Page(figures, tables, remarks)


def _said(judgement: Judgement) -> str:
    if judgement.error is None:
        return f"no result, {judgement.words}"
    if (judgement.error or 0.0) <= judgement.scatter:
        return "agrees"
    return f"{judgement.error:.2%} off, {judgement.words}"


def _figure(history: History) -> Figure:
    versions = list(dict.fromkeys(j.version for j in history.judgements))
    lines = []
    for case in history.cases:
        judged = [j for j in history.of_case(case) if j.error is not None]
        x = [float(versions.index(j.version)) for j in judged]
        lines.append(Line(x, [max(j.error or 0.0, 1e-16) for j in judged], case))
    ticks = {float(number): version for number, version in enumerate(versions)}
    panel = Panel(lines, "version", "error on the same mesh", log="y", ticks=ticks)
    return line_figure(
        [[panel]], "Distance from the reference on the same mesh.", shares_legend=True
    )
