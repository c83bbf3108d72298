"""What the built-in gates are expected to say of fastsim, element by element.

Limits come from what the user of a case needs, so that an element may honestly fail. The file
beside the stored references says which checks do not pass and which do: a change either way is
news. It also stores a regression bound for each error against the truth. A bound says that an
element has become worse than it was; it is no limit, and no part of a verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Strain
from palpate.meshes.untrusted import UntrustedTextError, parse_toml, read_text
from palpate.validation.judging.results import (
    MEASUREMENT,
    CaseResult,
    CheckResult,
    Judged,
    error_name,
)
from palpate.validation.metrics import CATALOGUE
from palpate.validation.states import Verdict

FILE = Path(__file__).parents[1] / "references" / "expected.toml"
# A bound is what was measured and 2 % of it, the least mistake that every gate must see; of what
# is exact, what solvers and rounding may leave.
_SLACK = 1.02
_LEAST = 1e-6
_HEAD = """\
# What the built-in gates are expected to say of fastsim, candidate by candidate: which checks fail
# or are inconclusive; all others pass. `palpate gate --all --element both --expected` exits 1 when
# one changes, either way, and `--record-expected` in its place writes this file.
#
# A regression bound is what the error against the truth was, and 2 % of it. It is no limit: who is
# within it has not become worse, and has passed nothing by it. Limits, from need, are in the cases.
"""


class Expectation(BaseModel):
    """What is expected of one candidate on one case.

    Attributes:
        verdict: Verdict on the case.
        failed: Names of the checks that fail.
        inconclusive: Names of those that are inconclusive.
        regression_bound: By name of a check or metric: its value when recorded, and a little more.
    """

    model_config = ConfigDict(extra="forbid")

    verdict: Verdict
    failed: list[str] = []
    inconclusive: list[str] = []
    regression_bound: dict[str, float] = {}


Expected = Mapping[str, Mapping[str, Expectation]]
_FORM = TypeAdapter(dict[str, dict[str, Expectation]])


def read_expected(path: Path = FILE) -> Expected:
    """Read what is expected of each candidate on each case.

    Raises:
        FileFormatError: Missing, no TOML, or a key that is not known.
    """
    try:
        return _FORM.validate_python(parse_toml(read_text(path)))
    except (UntrustedTextError, ValidationError) as error:
        raise FileFormatError(path, f"no table of expected verdicts ({error})") from error


def unexpected(results: Sequence[CaseResult], expected: Expected) -> list[str]:
    """List what is not as expected, a line each; empty where all is."""
    lines = []
    for result in results:
        for judged in result.candidates:
            known = expected.get(result.name, {}).get(judged.name)
            name = f"{result.name}, {judged.name}"
            if known is None:
                lines.append(f"{name}: nothing is known of it; --record-expected keeps what it is")
                continue
            lines += [f"{name}: {line}" for line in _changes(known, _found(result, judged))]
            lines += [
                f"{name}: {what} is {value:.4g}, above its regression bound {bound:.4g}: worse "
                "than it was"
                for what, bound in known.regression_bound.items()
                if not (value := errors_of(result, judged).get(what, math.inf)) <= bound
            ]
    return lines


def with_results(expected: Expected, results: Sequence[CaseResult]) -> Expected:
    """The new expectations: these results as they are, and of other cases those there were."""
    found = {name: dict(candidates) for name, candidates in expected.items()}
    for result in results:
        for judged in result.candidates:
            bounds = {
                name: float(f"{max(_SLACK * value, _LEAST):.3g}")
                for name, value in errors_of(result, judged).items()
            }
            found_now = _found(result, judged).model_copy(update={"regression_bound": bounds})
            found.setdefault(result.name, {})[judged.name] = found_now
    return found


def expected_toml(expected: Expected) -> str:
    """The file of these expectations."""
    return _HEAD + "".join(
        line
        for name, candidates in sorted(expected.items())
        for candidate, each in sorted(candidates.items())
        for line in _table(f'{name}."{candidate}"', each)
    )


def _table(key: str, each: Expectation) -> Iterator[str]:
    yield f'\n[{key}]\nverdict = "{each.verdict}"\n'
    for word, names in (("failed", each.failed), ("inconclusive", each.inconclusive)):
        if names:
            yield "".join([f"{word} = [\n", *(f'  "{name}",\n' for name in names), "]\n"])
    if each.regression_bound:
        yield f"\n[{key}.regression_bound]\n"
        yield from (f'"{name}" = {bound:.3g}\n' for name, bound in each.regression_bound.items())


def _changes(known: Expectation, found: Expectation) -> Iterator[str]:
    if known.verdict is not found.verdict:
        yield f"{known.verdict} was expected, {found.verdict} was found"
    for word in ("failed", "inconclusive"):
        before, now = set(getattr(known, word)), set(getattr(found, word))
        yield from (f"{name} is {word}, which was not expected" for name in sorted(now - before))
        yield from (f"{name} is no longer {word}" for name in sorted(before - now))


def _found(result: CaseResult, judged: Judged) -> Expectation:
    names = {
        verdict: [name for name, check in named_checks(result, judged) if check.verdict is verdict]
        for verdict in (Verdict.FAILED, Verdict.INCONCLUSIVE)
    }
    return Expectation(
        verdict=judged.verdict,
        failed=names[Verdict.FAILED],
        inconclusive=names[Verdict.INCONCLUSIVE],
    )


def named_checks(result: CaseResult, judged: Judged) -> Iterator[tuple[str, CheckResult]]:
    """A candidate's checks, and those of the truth itself, by names that are all different."""
    seen: dict[str, int] = {}
    for check in result.checks:
        if check.element is judged.element or check.is_of_truth_alone:
            name = check.name
            seen[name] = seen.get(name, 0) + 1
            yield name if seen[name] == 1 else f"{name} {seen[name]}", check


def _is_compared(check: CheckResult) -> bool:
    if check.against == MEASUREMENT:
        return True
    metric = CATALOGUE[check.metric]
    return metric.is_compared or metric.is_published


def errors_of(result: CaseResult, judged: Judged) -> dict[str, float]:
    """Errors against the truth and published numbers; of statics with a truth always one."""
    found = {
        name: math.inf if check.value is None else check.value
        for name, check in named_checks(result, judged)
        if check.against != "same_mesh" and _is_compared(check) and not check.is_of_truth_alone
    }
    is_static = result.problem.time is None
    if is_static and not any(name.startswith("displacement_l2 (truth") for name in found):
        key = error_name("truth", Strain.GREEN, judged.element, "displacement_l2")
        value = result.metrics.get(key)
        found |= {} if value is None else {key: value}
    return found
