"""Fig. 5 and Table I: the kidney, original, with linear and with Green strain."""

from __future__ import annotations

import json

from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import results_json
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.study_page import Finding, Page
from palpate.validation.states import Progress, Verdict

TITLE = "The kidney"

# A case of the paper as a study: its checks are the findings, its report is the page.


def judge_live(name: str, progress: Progress) -> CaseResult:
    """Judge a built-in case, its reference solved here where FEniCSx is."""
    return judge_case(load_case(name), live=True, progress=progress)


def findings_of(result: CaseResult) -> list[Finding]:
    """The case, then each of its checks."""
    passed = sum(check.verdict is Verdict.PASSED for check in result.checks)
    whole = f"{passed} of {len(result.checks)} checks passed"
    return [
        Finding(f"case {result.name}", whole, result.verdict),
        *(Finding(c.name, c.message, c.verdict) for c in result.checks),
    ]


def page_of(result: CaseResult) -> Page:
    """The case's report, and its results by the schema of every other verb."""
    text = results_json([result], str(result.provenance["palpate"]))
    return Page(numbers=json.loads(text), case=result)


def compute(progress: Progress) -> CaseResult:
    """Judge the case."""
    return judge_live("kidney", progress)


judge, present = findings_of, page_of
