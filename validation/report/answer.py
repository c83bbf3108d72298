"""The first sentence of a report, its numbers in words, and what to do next with its command."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.meshes.problem import Element
from palpate.validation.judging.checks import STATED
from palpate.validation.judging.results import (
    MEASUREMENT,
    CaseResult,
    CheckResult,
    Judged,
    Scope,
)
from palpate.validation.metrics import OWN_MESH_REMEDY
from palpate.validation.report.comparisons import STRAIN_NAMES
from palpate.validation.report.linear_strain import linear_strain_of
from palpate.validation.states import Verdict

# Names of quantities for a reader; files and terminals have the metrics' names.
_QUANTITIES = {
    "displacement_l2": "displacement",
    "displacement_max": "displacement at the worst point",
    "max_displacement": "largest displacement",
    "stress_l2": "stress",
    "trajectory_l2": "displacement over time",
    "tool_force": "force on the tool",
    "traction_resultant": "force through a cut",
    "volume": "change of volume",
    "surface_area": "change of surface area",
    "smallest_det_f": "smallest det F",
}
_SMOOTHED = "palpate gate {} --element smoothed"
# Where nothing was compared with the truth, this replaces "passed".
_NARROW = {Scope.SAME_MESH: "same mesh only", Scope.OWN: "no reference"}
_OF_LINEAR = {
    Verdict.PASSED: "linear strain: will do",
    Verdict.FAILED: "linear strain: will not do",
    Verdict.INCONCLUSIVE: "linear strain: undecided",
}


@dataclass(frozen=True)
class Band:
    """What was found of one candidate, or of linear strain: colour, a few words, and a sentence."""

    css: str
    word: str
    says: str


@dataclass(frozen=True)
class Step:
    """What to do next, in a sentence, and the command lines that do it."""

    says: str
    commands: tuple[str, ...] = ()


def quantity_of(check: CheckResult) -> str:
    """The quantity of a check, in words."""
    if check.against == MEASUREMENT:
        what = "frequency" if check.unit == "Hz" else "worst value"
        return f"{what} beside {check.metric.replace('measured ', 'the measured ')}"
    return metric_in_words(check.metric)


def metric_in_words(name: str) -> str:
    """The quantity of a metric, in words."""
    return _QUANTITIES.get(name, name.replace("_", " "))


def check_in_words(check: CheckResult) -> str:
    """The name of a check for a reader, as "displacement (same mesh, Green strain)"."""
    words = check.name
    if check.against != MEASUREMENT:
        words = metric_in_words(check.metric) + words.removeprefix(check.metric)
    for strain, shown in STRAIN_NAMES.items():
        words = re.sub(rf", {strain}\b", f", {shown}", words)
    return words


def key_in_words(key: str) -> str:
    """A key of the case file for a reader: "load[0].force" is the force of load 1."""
    table, _, name = key.rpartition(".")
    found = re.fullmatch(r"(\w+)\[(\d+)\]", table)
    words = name.replace("_", " ").replace("youngs", "Young's").replace("poissons", "Poisson's")
    return f"{words} of {found[1]} {int(found[2]) + 1}" if found else words


def amount_of(check: CheckResult) -> str:
    """The error beside what is allowed, as "11 % (allowed: 10 %)".

    The truth's own bar stands there where it is why nothing can be decided, to its second digit, or
    where it is more than a third of the error: else "5.3 % ± 0.3 %" would look as if it were above
    5 %.
    """
    scale, unit = (100.0, "%") if check.unit == "-" else (1.0, check.unit)
    value, bar = scale * (check.value or 0.0), scale * check.reference_error
    allowed = f"(allowed: {scale * check.limit:.2g} {unit})"
    if not math.isfinite(bar):
        return f"{value:.2g} {unit} ± an unknown error of the truth {allowed}"
    is_small = 3.0 * bar <= value and check.verdict is not Verdict.INCONCLUSIVE
    if is_small or bar <= 0.0:
        return f"{value:.2g} {unit} {allowed}"
    digits = max(0, 1 - math.floor(math.log10(bar)))
    return f"{value:.{digits}f} {unit} ± {bar:.{digits}f} {unit} {allowed}"


def used_of(check: CheckResult) -> float:
    """Error and bar as a fraction of the limit."""
    used = ((check.value or 0.0) + check.reference_error) / check.limit
    return used if math.isfinite(used) else math.inf


def bands_of(result: CaseResult, far: Sequence[CheckResult]) -> tuple[Band, ...]:
    """A verdict for each candidate, what passed first, and one for linear strain.

    `far` are the checks against the truth, the worst first.
    """
    if result.tone == "narrow":
        return (Band("narrow", _NARROW[result.scope], f"{result.scope.caution.capitalize()}."),)
    judged = sorted(result.candidates, key=lambda one: one.verdict is not Verdict.PASSED)
    bands = [_band(result, one, far) for one in judged]
    if linear := linear_strain_of(result, far):
        bands.append(Band(str(linear.verdict), _OF_LINEAR[linear.verdict], linear.says))
    return tuple(bands)


def _band(result: CaseResult, judged: Judged, far: Sequence[CheckResult]) -> Band:
    verdict = _verdict_of(result, judged)
    says = _of_one(result, judged, far)
    scopes = {c.scope for c in _checks_of(result, judged) if c.verdict is not Verdict.SKIPPED}
    if verdict is Verdict.PASSED and Scope.TRUTH not in scopes:
        scope = Scope.SAME_MESH if Scope.SAME_MESH in scopes else Scope.OWN
        return Band("narrow", f"{judged.name}: {_NARROW[scope]}", says)
    return Band(str(verdict), f"{judged.name}: {verdict}", says)


def _of_one(result: CaseResult, judged: Judged, far: Sequence[CheckResult]) -> str:
    """Whether one candidate is good enough, by the number that decides it."""
    who, verdict = judged.name, _verdict_of(result, judged)
    own = [check for check in far if check.element is judged.element]
    if verdict is Verdict.PASSED:
        if not own:
            return f"{who} passed every check, none of them against the truth."
        return f"{who} is good enough: its {_off(own[0])}."
    wrong = [c for c in _checks_of(result, judged) if c.verdict is verdict]
    if verdict is Verdict.INCONCLUSIVE:
        first = next((c for c in own if c in wrong), None)
        if first is not None:
            return f"It cannot be said whether {who} is good enough: its {_off(first)}."
        why = wrong[0].message if wrong else "what was checked does not support a verdict"
        return f"It cannot be said whether {who} is good enough: {why.rstrip('.')}."
    same = [c for c in wrong if c.against == "same_mesh" and c.value is not None]
    stated = next((c for c in wrong if c.metric == STATED), None)
    if same:
        worst = max(same, key=used_of)
        off = f"its {quantity_of(worst)} is {100.0 * (worst.value or 0.0):.2g} % off"
        return f"{who} does not solve the case's equations: on the same mesh already, {off}."
    first = next((c for c in own if c in wrong), None)
    if first is not None:
        return f"{who} is not good enough: its {_off(first)}."
    if stated is not None:
        return f"{who} says that it solved other equations: {stated.message}."
    why = f": {wrong[0].message.rstrip('.')}" if wrong else ""
    return f"{who} is not good enough: a check of the result itself failed{why}."


def _off(check: CheckResult) -> str:
    return f"{quantity_of(check)} is off by {amount_of(check)}"


def next_steps(result: CaseResult, far: Sequence[CheckResult], mistake: str) -> tuple[Step, ...]:
    """What to do next: to use it, to correct it, or to make it decidable.

    `mistake` is what the diagnosis found in place of the case's equations, "" for nothing.
    """
    called = shlex.quote(str(result.provenance.get("called") or result.name))
    # What passed without a truth is not recommended.
    good = [
        j
        for j in result.candidates
        if _verdict_of(result, j) is Verdict.PASSED and math.isfinite(_farthest(far, j))
    ]
    if result.tone == "narrow":
        words = (
            "Nothing was compared with the truth: add a check against it to the case, with what "
            "the use allows; where none is stored yet, build it, then judge again."
        )
        return (Step(words, (f"palpate reference build {called}", f"palpate gate {called}")),)
    if good:
        best = min(good, key=lambda one: _farthest(far, one))
        words = (
            f"Use {best.name} for this and no more; judge it again whenever it or the case changes."
        )
        return (Step(words, _again(result, best, called)),)
    if result.verdict is Verdict.INCONCLUSIVE:
        return (_decide_it(result, far, called),)
    judged = next(
        (j for j in result.candidates if _verdict_of(result, j) is Verdict.FAILED),
        result.candidates[0],
    )
    failed = [c for c in _checks_of(result, judged) if c.verdict is Verdict.FAILED]
    if mistake:
        words = f"Correct this first: {mistake}. Then judge it again."
        return (Step(words, _again(result, judged, called)),)
    if any(c.metric == STATED for c in failed):
        words = (
            "Let it solve what the case asks for, or ask for what it solves; then judge it again."
        )
        return (Step(words, _again(result, judged, called)),)
    if failed and all(c.against == MEASUREMENT for c in failed):
        words = (
            "Its equations are solved well enough; the model is not the body that was measured: "
            "fit its inputs, and see what is predicted of a measurement that is held out."
        )
        modulus = "--parameter material.youngs_modulus"
        return (Step(words, (f"palpate fit {called} {modulus} -o out/fit",)),)
    if not any(c in far for c in failed) or any(c.against == "same_mesh" for c in failed):
        words = (
            "Find the equation that it does not satisfy: measure its result against each of them."
        )
        return (Step(words, (f"palpate audit {called} RESULT",)),)
    is_ours = _is_ours(result, judged)
    # Smoothed tetrahedra alone are 23 % off in `press`, which allows 5 %.
    if is_ours and result.problem.tools and not result.provenance.get("near_tool"):
        words = (
            "The mesh is too coarse under the tool: judge smoothed tetrahedra, small ones there."
        )
        return (Step(words, (f"{_SMOOTHED.format(called)} --near-tool",)),)
    if is_ours and all(one.element is Element.LINEAR for one in result.candidates):
        words = (
            "Its mesh is too coarse for linear tetrahedra: judge smoothed ones on the same mesh."
        )
        near = " --near-tool" if result.provenance.get("near_tool") else ""
        return (Step(words, (f"{_SMOOTHED.format(called)}{near}",)),)
    words = (
        "The mesh is too coarse for this use: halve its edges in the case, see what that costs, "
        "and judge it again."
    )
    return (Step(words, (f"palpate check {called}", *_again(result, judged, called))),)


def _decide_it(result: CaseResult, far: Sequence[CheckResult], called: str) -> Step:
    """What would turn an inconclusive case into one that is decided."""
    left = [c for c in result.checks if c.verdict is Verdict.INCONCLUSIVE]
    anew = (f"palpate reference build {called}", f"palpate reference accept {called} --reason TEXT")
    if not left:
        return Step(f"{_last_note(result)} Then judge it again.", (f"palpate gate {called}",))
    check = next((c for c in far if c in left), left[0])
    if check.against == MEASUREMENT:
        words = (
            "What was measured is not known well enough to decide: measure more runs, or state "
            "inputs more exactly; which part is largest, the check says."
        )
        return Step(words, (f"palpate gate {called}",))
    if OWN_MESH_REMEDY in check.message:
        return Step(f"{_sentence(OWN_MESH_REMEDY)}; then judge it again.", anew)
    if check.value is None or not math.isfinite(check.reference_error):
        words = "There is no reference that could decide it: build it where FEniCSx is installed"
        return Step(f"{words}, accept it, and judge it again.", (*anew, f"palpate gate {called}"))
    room, limit = 100.0 * abs(check.value - check.limit), 100.0 * check.limit
    words = (
        f"The truth is not known well enough to decide: build one whose error bar on "
        f"{quantity_of(check)} is below {room:.2g} % (the case's section on the truth asks for "
        f"it), take a finer mesh, or state with its reason another need than {limit:.2g} %."
    )
    return Step(words, anew)


def _again(result: CaseResult, judged: Judged, called: str) -> tuple[str, ...]:
    """The command that judges one candidate again: the one that was given, if it was one."""
    if _is_ours(result, judged):
        if result.provenance.get("near_tool"):
            called += " --near-tool"
        is_linear = judged.element is Element.LINEAR
        return (f"palpate gate {called}" if is_linear else _SMOOTHED.format(called),)
    given = str(result.provenance.get("command", ""))
    is_one = given.startswith(("palpate gate ", "palpate report ", "palpate compare "))
    return (given,) if is_one else ()


def _is_ours(result: CaseResult, judged: Judged) -> bool:
    simulators = {s.simulator for s in result.states if s.label == judged.name}
    return simulators == {"fastsim"}


def _verdict_of(result: CaseResult, judged: Judged) -> Verdict:
    """A candidate's verdict; of one alone that of the case, which counts notes too."""
    return judged.verdict if len(result.candidates) > 1 else result.verdict


def _checks_of(result: CaseResult, judged: Judged) -> list[CheckResult]:
    """The checks of one candidate; those of its element, as results say no more."""
    several = len(result.candidates) > 1
    return [c for c in result.checks if not several or c.element is judged.element]


def _farthest(far: Sequence[CheckResult], judged: Judged) -> float:
    own = [used_of(c) for c in far if c.scope is Scope.TRUTH and c.element is judged.element]
    return max(own, default=math.inf)


def _last_note(result: CaseResult) -> str:
    """Why nothing that was checked says anything; the judge's last note tells it."""
    return _sentence(result.notes[-1].removeprefix("Inconclusive: ")) if result.notes else ""


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]
