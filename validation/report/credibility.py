"""What a report contributes to a credibility file, factor by factor, and what it leaves open.

Factors after ASME V&V 40-2018 (13 of them). palpate gives verification; validation against
measurements and the relevance to a device are the user's, and the table says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.states import Verdict

_CODE, _CALCULATION = "verification: code", "verification: calculation"
_MODEL, _COMPARATOR = "validation: model", "validation: comparator"
_ASSESSMENT, _APPLICABILITY = "validation: assessment", "applicability"
_STATES = {"given": "given", "in part": "partly", "yours": "open"}


@dataclass(frozen=True)
class Factor:
    """One credibility factor: what there is, and whose turn it is."""

    group: str
    name: str
    evidence: str
    state: str

    @property
    def css(self) -> str:
        """Class of the state's cell."""
        return _STATES[self.state]


@dataclass(frozen=True)
class Credibility:
    """The frame of a credibility file as far as the case states it."""

    question: str
    context_of_use: str
    risk: str
    comparator: str
    factors: tuple[Factor, ...]


def credibility(result: CaseResult) -> Credibility:
    """Collect the evidence of a judged case."""
    said = result.evidence
    influence, consequence = said.get("model_influence"), said.get("decision_consequence")
    risk = (
        f"Influence of the model on the decision: {influence}; consequence of a wrong decision: "
        f"{consequence}."
        if influence and consequence
        else "Not stated: the case has no model_influence and decision_consequence in [evidence]."
    )
    return Credibility(
        question=said.get("question")
        or f"Does {result.candidate} solve this case as the continuum model prescribes, and how "
        "far is it from that model's true answer?",
        context_of_use=said.get("context_of_use")
        or "Not stated: the case has no context_of_use in [evidence].",
        risk=risk,
        comparator=_comparator(result.provenance.get("reference", {})),
        factors=tuple(_factors(result)),
    )


def _comparator(reference: Mapping[str, Any]) -> str:
    versions = reference.get("versions") or {}
    shown = ", ".join(f"{name} {version}" for name, version in versions.items())
    return (
        "Another simulator, not an experiment: a UFL solve in FEniCSx that shares no mechanics "
        f"code with the candidate ({reference.get('origin', 'origin unknown')}"
        + (f"; {shown})." if shown else ").")
    )


def _factors(result: CaseResult) -> list[Factor]:
    same = [c for c in result.checks if c.against == "same_mesh"]
    truth = [c for c in result.checks if c.against == "truth"]
    key = str(result.provenance.get("case_key", ""))[:12]
    said = result.evidence
    quantities = ", ".join(sorted({c.metric for c in result.checks}))
    return [
        Factor(
            _CODE,
            "software quality assurance",
            f"palpate {result.provenance.get('palpate')}; every run states versions, command and "
            f"the hash of its inputs ({key}); its own gates are shown to go red on seeded faults. "
            f"The quality system around {result.candidate} is not seen here.",
            "in part",
        ),
        Factor(_CODE, "numerical code verification", _counted(same, "the same mesh"), _state(same)),
        Factor(
            _CALCULATION,
            "discretisation error",
            _counted(truth, "the truth") + _bars(truth),
            _state(truth),
        ),
        Factor(
            _CALCULATION,
            "numerical solver error",
            _largest(same, "what is left on the same mesh, where only the solver differs"),
            _state(same),
        ),
        Factor(
            _CALCULATION,
            "use error",
            "The case file is the whole input and is printed below; unknown keys, empty regions, "
            "floating bodies and stale references are refused.",
            "in part",
        ),
        Factor(
            _MODEL,
            "model form",
            "Linear and Green strain side by side show what the strain measure is worth; whether "
            "a solid of this law is the tissue is not tested.",
            "in part",
        ),
        Factor(_MODEL, "model inputs", _inputs(result), "yours"),
        Factor(_COMPARATOR, "test samples", "No experiment in this report.", "yours"),
        Factor(_COMPARATOR, "test conditions", "No experiment in this report.", "yours"),
        Factor(
            _ASSESSMENT,
            "equivalency of input parameters",
            "Candidate and reference are given the same arrays: mesh, material, supports, loads.",
            "given",
        ),
        Factor(
            _ASSESSMENT,
            "output comparison",
            f"{len(result.checks)} checks of {quantities}, each with scale, limit, reason and the "
            "reference's own error; against a solver, not against measurements.",
            "in part",
        ),
        Factor(
            _APPLICABILITY,
            "relevance of the quantities of interest",
            _or_open(said.get("quantities_of_interest")),
            "given" if said.get("quantities_of_interest") else "yours",
        ),
        Factor(
            _APPLICABILITY,
            "relevance of the validation activities to the context of use",
            _or_open(said.get("applicability")),
            "given" if said.get("applicability") else "yours",
        ),
    ]


def _or_open(text: object) -> str:
    return str(text) if text else "Not stated in [evidence] of the case."


def _inputs(result: CaseResult) -> str:
    fitted = result.evidence.get("fitted")
    sentence = (
        f"Fitted, as [evidence] says: {', '.join(fitted)}."
        if fitted
        else "[evidence] of the case names none that was fitted."
    )
    return (
        f"Taken from the case file as they are; no uncertainty of inputs is propagated. {sentence}"
    )


def _counted(checks: list[CheckResult], against: str) -> str:
    passed = sum(check.verdict is Verdict.PASSED for check in checks)
    return f"{passed} of {len(checks)} checks against {against} passed."


def _bars(checks: list[CheckResult]) -> str:
    bars = [c.reference_error for c in checks if 0.0 < c.reference_error < float("inf")]
    return f" The truth's own error bar is {max(bars):.2g} at most." if bars else ""


def _largest(checks: list[CheckResult], what: str) -> str:
    values = [check.value for check in checks if check.value is not None]
    return f"At most {max(values):.2g}: {what}." if values else "No such check in this case."


def _state(checks: list[CheckResult]) -> str:
    if not checks:
        return "yours"
    return "given" if all(c.verdict is Verdict.PASSED for c in checks) else "in part"
