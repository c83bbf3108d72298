"""Annotations that GitHub shows at the file: workflow commands on standard output.

At most ten of a kind are shown for each step, so the rest is counted.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.quoting import for_workflow, for_workflow_property
from palpate.validation.states import Verdict

_MOST = 10
_KINDS = {Verdict.FAILED: "error", Verdict.INCONCLUSIVE: "warning"}


def github_annotations(results: Sequence[CaseResult]) -> list[str]:
    """One line for each check that did not pass, ten of a kind at most, then a count."""
    lines = []
    for verdict, kind in _KINDS.items():
        found = [(r, c) for r in results for c in r.checks if c.verdict is verdict]
        lines += [_line(kind, result, check) for result, check in found[: _MOST - 1]]
        if len(found) == _MOST:
            lines.append(_line(kind, *found[-1]))
        elif len(found) > _MOST:
            lines.append(f"::{kind} title=palpate::and {len(found) - _MOST + 1} more checks")
    for result in results:
        verdicts = {check.verdict for check in result.checks}
        if result.verdict is Verdict.INCONCLUSIVE and result.verdict not in verdicts:
            text = for_workflow(f"{result.verdict}; {result.notes[-1] if result.notes else ''}")
            lines.append(f"::warning title={for_workflow_property(result.name)}::{text}")
    return lines


def _line(kind: str, result: CaseResult, check: CheckResult) -> str:
    file = str(result.provenance.get("case_file", ""))
    place = f"file={for_workflow_property(file)}," if file else ""
    title = for_workflow_property(f"{result.name}: {check_name(check)}")
    return f"::{kind} {place}title={title}::{for_workflow(f'{check.message}; {check.reason}')}"
