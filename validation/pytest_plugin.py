"""The fixture `palpate_case`, which judges cases from pytest.

    def test_my_simulator(palpate_case):
        palpate_case("block", simulator="python mysim.py {case} {result}")

It is installed with palpate; nothing is imported before the fixture is called.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import pytest

if TYPE_CHECKING:
    from palpate.validation.judging.results import CaseResult

JudgeCase: TypeAlias = "Callable[..., CaseResult]"


@pytest.fixture
def palpate_case() -> JudgeCase:
    """Judge one case; fails the test with the checks that did not pass.

    The function takes a built-in name or a path to a .toml file and, as keywords, `simulator`
    (a command line with {case} and {result}; fastsim where None), `result` (an existing result
    file), and what `palpate.judge` and `palpate.compare` take: `element`, `integrator`,
    `time_step`, `law`, `precision`, `contact`, `time_limit` and `live`. It returns the judged case.
    """

    def judge(
        case: str | Path,
        *,
        simulator: str | None = None,
        result: str | Path | None = None,
        **asked: Any,
    ) -> CaseResult:
        from palpate.validation import api
        from palpate.validation.states import Verdict

        if simulator is not None and result is not None:
            raise ValueError("palpate_case takes a simulator or a result, not both")
        if result is None:
            judged = api.judge(case, simulator, **asked)
        else:
            judged = api.compare(case, Path(result), **asked)
        if judged.verdict is not Verdict.PASSED:
            pytest.fail(str(judged), pytrace=False)
        return judged

    return judge
