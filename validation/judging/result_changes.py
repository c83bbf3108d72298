"""What changed since the accepted result: check by check, and the number that changed most.

The accepted result is a results.json that somebody looked at and kept.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element
from palpate.meshes.untrusted_text import parse_json, read_text
from palpate.validation.case.body_schema import Number
from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.metrics import CATALOGUE

# Changes smaller than this are rounding and solver noise.
QUIET = 1e-6


class AcceptedCheck(BaseModel):
    """What is compared of a check."""

    metric: str
    against: str
    strain: str
    element: str = Element.LINEAR.value
    verdict: str
    limit: Number
    value: Number | None
    reference_error: Number | None = 0.0


class AcceptedCase(BaseModel):
    """What is compared of a case."""

    name: str
    checks: list[AcceptedCheck]
    metrics: dict[str, Number | None] = {}
    provenance: dict[str, Any] = {}


class _AcceptedResults(BaseModel):
    """What is compared of a results.json; other keys are left alone."""

    cases: list[AcceptedCase]


def read_accepted(path: str | Path) -> dict[str, AcceptedCase]:
    """The cases of an accepted results.json, by name.

    Raises:
        FileFormatError: Missing, or not a results.json of this schema.
    """
    try:
        document = parse_json(read_text(path))
        if not isinstance(document, dict) or type(document.get("schema")) is not int:
            raise ValueError("no schema")
        if document["schema"] != 1:
            raise ValueError(f"schema {document['schema']} is not known here (1 is)")
        accepted = _AcceptedResults.model_validate(document)
        return {case.name: case for case in accepted.cases}
    except FileFormatError as error:
        remedy = "; keep an accepted results.json there"
        raise FileFormatError(path, str(error).removeprefix(f"{path}: ") + remedy) from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(path, f"not a results.json ({place}: {first['msg']})") from error
    except ValueError as error:
        raise FileFormatError(path, f"not a results.json ({error})") from error


def describe_since(
    results: Sequence[CaseResult], accepted: dict[str, AcceptedCase]
) -> dict[str, list[str]]:
    """Lines on what changed, for each case by name; an empty list where nothing did."""
    return {result.name: _of_case(result, accepted.get(result.name)) for result in results}


def with_changes(
    results: Sequence[CaseResult], accepted: dict[str, AcceptedCase]
) -> list[CaseResult]:
    """The results with a note on each change; verdicts stay what they are."""
    changes = describe_since(results, accepted)
    changed = []
    for result in results:
        lines = changes[result.name] or ["nothing"]
        notes = tuple(f"Since the accepted result: {line}." for line in lines)
        changed.append(dataclasses.replace(result, notes=(*result.notes, *notes)))
    return changed


def _of_case(result: CaseResult, accepted: AcceptedCase | None) -> list[str]:
    if accepted is None:
        return ["new: the accepted result does not have this case"]
    lines = []
    if accepted.provenance.get("case_key") != result.provenance.get("case_key"):
        lines.append("the problem itself has changed: mesh, material, supports or loads")
    # A metric may be asked for at several points: its checks are matched in their order.
    before: dict[tuple[str, ...], list[AcceptedCheck]] = {}
    for known in accepted.checks:
        key = (known.metric, known.against, known.strain, known.element)
        before.setdefault(key, []).append(known)
    for check in result.checks:
        old = before.get((check.metric, check.against, str(check.strain), str(check.element)))
        lines += _of_check(check, old.pop(0) if old else None)
    lines += [f"gone: check {' '.join(key)}" for key, left in before.items() for _ in left]
    lines += _largest_change(result, accepted.metrics)
    return lines


def _of_check(check: CheckResult, old: AcceptedCheck | None) -> list[str]:
    name = check_name(check)
    if old is None:
        return [f"new: check {name}"]
    lines = []
    if old.verdict != check.verdict:
        lines.append(f"{name}: was {old.verdict}, now {check.verdict}")
    if old.limit != check.limit:
        known = CATALOGUE.get(check.metric)
        is_lower = known is not None and known.is_lower_limit
        word = "looser" if (check.limit > old.limit) != is_lower else "tighter"
        lines.append(f"{name}: limit {old.limit:g}, now {check.limit:g} ({word})")
    before, now = old.value, check.value
    if before is not None and now is not None and abs(now - before) > QUIET * check.limit:
        lines.append(f"{name}: {before:.4g}, now {now:.4g}")
    elif (before is None) != (now is None):
        lines.append(f"{name}: {_shown(before)}, now {_shown(now)}")
    return lines


def _largest_change(result: CaseResult, accepted: Mapping[str, float | None]) -> list[str]:
    """The metric that changed most, in parts of what it was."""
    worst, name = 0.0, ""
    for metric, now in result.metrics.items():
        before = accepted.get(metric)
        # Errors of 1e-12 change by themselves: only what is a number of the body counts.
        if metric.startswith("error.") or before is None or now is None:
            continue
        change = abs(now - before) / abs(before) if before else math.inf * (now != before)
        if change > max(worst, QUIET):
            worst, name = change, metric
    if not name:
        return []
    old, new = accepted[name], result.metrics[name]
    return [f"changed most: {name}, {old:.6g}, now {new:.6g} ({100.0 * worst:.3g} %)"]


def _shown(value: float | None) -> str:
    return "no value" if value is None else f"{value:.4g}"
