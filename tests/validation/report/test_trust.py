"""The first screen says who can be trusted, and what it was held against."""

from __future__ import annotations

import dataclasses
import io
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from rich.console import Console

from palpate.validation.judging.outputs import (
    junit_xml,
    print_results,
    results_json,
    summary_markdown,
)
from palpate.validation.judging.results import CaseResult, Scope, tone_of
from palpate.validation.report.comparisons import comparisons_of
from palpate.validation.report.trust import trust_of, where_wrong
from palpate.validation.states import Verdict


def of(result: CaseResult, *against: str) -> CaseResult:
    """The same result as if only these checks had been asked for."""
    checks = tuple(c for c in result.checks if c.against in against)
    return dataclasses.replace(result, checks=checks)


def test_what_it_was_compared_with_is_in_every_output(
    kidney: CaseResult, block: CaseResult
) -> None:
    assert (kidney.scope, block.scope) == (Scope.TRUTH, Scope.SAME_MESH)
    assert of(kidney, "candidate").scope is Scope.OWN
    cases = json.loads(results_json([kidney, block], "0"))["cases"]
    assert [case["scope"] for case in cases] == ["truth", "same_mesh"]
    suites = ET.fromstring(junit_xml([kidney, block])).findall("testsuite")
    reported = [suite.find("properties/property[@name='scope']") for suite in suites]
    assert [one is not None and one.get("value") for one in reported] == ["truth", "same_mesh"]
    assert "passed, verified on the same mesh only: not compared with the truth" in (
        summary_markdown([block])
    )


def test_a_skipped_check_against_the_truth_makes_no_scope(kidney: CaseResult) -> None:
    checks = tuple(
        dataclasses.replace(c, verdict=Verdict.SKIPPED) if c.against == "truth" else c
        for c in kidney.checks
    )
    assert dataclasses.replace(kidney, checks=checks).scope is Scope.SAME_MESH


def test_a_pass_without_a_truth_is_not_green(block: CaseResult) -> None:
    trust = trust_of(block)
    assert [(band.word, band.css) for band in trust.bands] == [("same mesh only", "narrow")]
    assert "same mesh only" in trust.answer
    assert trust.scale == ()
    assert trust.context.startswith("Verification alone")
    unsaid = trust_of(dataclasses.replace(block, evidence={}))
    assert unsaid.context == "not stated"
    # Nothing asks for the distance from the truth; where it is known it is told.
    away = block.metrics["error.truth.green.displacement_l2"]
    assert away is not None
    assert f"displacement is {100 * away:.2g} % from it" in trust.caveat


def test_a_failure_against_the_truth_says_how_far_it_is_and_what_is_needed(
    kidney: CaseResult,
) -> None:
    trust = trust_of(kidney)
    worst = max(
        (c for c in kidney.checks if c.against == "truth" and c.value is not None),
        key=lambda c: (c.value or 0.0) / c.limit,
    )
    assert trust.bands[0].css == "failed"
    assert f"{100 * (worst.value or 0.0):.2g} %" in trust.answer
    assert f"(allowed: {100 * worst.limit:.2g} %)" in trust.answer
    (group,) = trust.failures
    assert group.startswith(f"{sum(c.verdict != 'passed' for c in kidney.checks)} of")
    first = trust.scale[0]
    assert first.css == "failed"
    assert first.dot > first.needed  # beyond the line
    assert all(row.dot <= row.needed for row in trust.scale if row.css == "passed")


def test_an_error_on_the_same_mesh_outweighs_the_distance_from_the_truth(
    kidney: CaseResult,
) -> None:
    checks = tuple(
        dataclasses.replace(c, verdict=Verdict.FAILED) if c.against == "same_mesh" else c
        for c in kidney.checks
    )
    wrong = dataclasses.replace(kidney, checks=checks)
    assert "does not solve the case's equations" in trust_of(wrong).answer


def test_a_wide_bar_and_a_fit_are_caveats(kidney: CaseResult) -> None:
    assert trust_of(kidney).caveat.endswith("fitted to: Poisson's ratio, force of load 1.")
    unfitted = dataclasses.replace(kidney, evidence={"context_of_use": "planning"})
    assert "verification" in trust_of(unfitted).caveat
    assert trust_of(unfitted).context == "planning"
    checks = tuple(
        dataclasses.replace(c, reference_error=0.5 * c.limit) if c.against == "truth" else c
        for c in kidney.checks
    )
    wide = dataclasses.replace(unfitted, checks=checks)
    assert "50 % of the limit" in trust_of(wide).caveat


@pytest.mark.parametrize("scope", list(Scope))
def test_every_output_takes_its_colour_from_one_place(block: CaseResult, scope: Scope) -> None:
    against = {Scope.TRUTH: "truth", Scope.SAME_MESH: "same_mesh", Scope.OWN: "candidate"}[scope]
    check = dataclasses.replace(block.checks[0], against=against)
    result = dataclasses.replace(block, checks=(check,))
    is_green = scope is Scope.TRUTH
    assert result.tone == trust_of(result).bands[0].css == ("passed" if is_green else "narrow")
    console = Console(record=True, force_terminal=True, color_system="standard", file=io.StringIO())
    print_results([result], console)
    last = console.export_text(styles=True).rstrip().splitlines()[-1]
    assert ("\x1b[32m" in last, "\x1b[36m" in last) == (is_green, not is_green)  # green, cyan


def test_several_cases_are_green_only_where_each_is(block: CaseResult, kidney: CaseResult) -> None:
    green = dataclasses.replace(kidney, verdict=Verdict.PASSED)
    assert (green.tone, block.tone) == ("passed", "narrow")
    assert tone_of([green, green]) == "passed"
    assert tone_of([green, block]) == "narrow"
    assert tone_of([green, block, kidney]) == str(kidney.verdict) == "failed"


def test_where_a_result_is_wrong(block: CaseResult) -> None:
    """Of the block by hand: a tenth too far everywhere, then wrong at its held end alone."""
    pair = comparisons_of(block)[0].pairs[0]
    true, own = block.states[pair[1]], block.states[pair[0]]

    def said(displacement: np.ndarray) -> str:
        wrong = dataclasses.replace(own, displacement=displacement)
        states = tuple(wrong if state is own else state for state in block.states)
        return where_wrong(dataclasses.replace(block, states=states), block.candidates[0])

    assert "is off by about 10 % of how far each moves, most where " in said(
        1.1 * true.displacement
    )
    moved = true.displacement.copy()
    moved[block.problem.supports[0].points[0]] += 0.5
    assert "most at the support" in said(moved)
    assert said(true.displacement) == ""
