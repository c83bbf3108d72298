"""The fixture `palpate_case`, which judges cases from pytest.

    def test_my_simulator(palpate_case):
        palpate_case("block", simulator="python mysim.py {case} {result}")

It is installed with palpate; nothing is imported before the fixture is called.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pytest

if TYPE_CHECKING:
    from palpate.validation.judging.results import CaseResult
    from palpate.validation.solving import ElementsName

JudgeCase: TypeAlias = "Callable[..., CaseResult]"


@pytest.fixture
def palpate_case() -> JudgeCase:
    """Judge one case; fails the test with the checks that did not pass.

    The function takes a built-in name or a path to a .toml file and, as keywords, `simulator`
    (a command line with {case} and {result}; fastsim where None), `result` (an existing result
    file), `element` (of fastsim: linear, smoothed or both), `time_limit` [s] and `live`.
    It returns the judged case.
    """

    def judge(
        case: str | Path,
        *,
        simulator: str | None = None,
        result: str | Path | None = None,
        element: ElementsName | None = None,
        time_limit: float = 600.0,
        live: bool = False,
    ) -> CaseResult:
        from palpate.validation import api
        from palpate.validation.quoting import for_terminal
        from palpate.validation.states import Verdict

        if simulator is not None and result is not None:
            raise ValueError("palpate_case takes a simulator or a result, not both")
        if element is not None and result is not None:
            raise ValueError("palpate_case takes an element of fastsim, not of a result")
        judged = (
            api.judge(case, simulator, element=element, live=live, time_limit=time_limit)
            if result is None
            else api.compare(case, Path(result), live=live)
        )
        if judged.verdict is not Verdict.PASSED:
            bad = [check for check in judged.checks if check.verdict is not Verdict.PASSED]
            lines = [f"  {c.verdict}: {c.name}: {c.message} ({c.reason})" for c in bad]
            lines += [f"  {note}" for note in judged.notes]
            lines = [for_terminal(line) for line in [f"{judged.name}: {judged.verdict}", *lines]]
            pytest.fail("\n".join(lines), pytrace=False)
        return judged

    return judge
