"""The study of hard loads: what it tries, and how it counts."""

from __future__ import annotations

import pytest

from palpate.validation.states import Verdict
from palpate.validation.studies.hard_loads import (
    BODIES,
    Trial,
    attempt,
    hard_loads,
    judge,
    present,
    summarise,
)


def trial(reference, plain, *, is_wrong=False, diagnosis=""):
    return Trial("beam", "bend", 1.0, reference, plain, 1.0, diagnosis, is_wrong)


def test_every_kind_of_load_is_tried_harder_and_harder():
    tried: dict[tuple[str, str], list[float]] = {}
    for body, kind, strength, problem in hard_loads():
        tried.setdefault((body, kind), []).append(strength)
        assert len(problem.loads) + len(problem.supports) >= 2
    kinds = {"bend", "twist", "squeeze", "press", "push", "pull"}
    assert set(tried) == {(body, kind) for body in BODIES for kind in kinds}
    assert all(s == sorted(s) and len(s) == 5 for s in tried.values())


TRIALS = [
    trial("converged", ("lost", "converged")),
    trial("converged", ("converged", "converged"), is_wrong=True),
    trial("to 0.500", ("false success", "lost"), diagnosis="not stable"),
]


def test_an_inverted_cell_that_is_called_converged_fails_the_study():
    assert [f.verdict for f in judge(TRIALS)] == [Verdict.FAILED]
    assert [f.verdict for f in judge([TRIALS[0], TRIALS[2]])] == [Verdict.PASSED]


def test_the_table_has_a_row_for_each_trial():
    page = present(TRIALS)
    assert [row[-1] for row in page.tables["hard-loads"].texts] == ["", "", "not stable"]
    assert page.numbers["summary"] == summarise(TRIALS)


def test_counts():
    counted = summarise(TRIALS)
    assert counted["converged"] == 2
    assert counted["honest_ends"] == 1
    assert counted["false_successes"] == 1
    assert counted["plain_in_1_misses"] == 1
    assert counted["plain_in_10_misses"] == 0
    assert counted["plain_in_1_falsely_succeeds"] == 1


@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.slow
def test_a_mild_load_converges_for_all_and_a_hard_one_ends_honestly():
    loads = {(b, k, s): p for b, k, s, p in hard_loads()}
    mild = attempt("beam", "bend", 0.02, loads["beam", "bend", 0.02])
    assert mild.reference == "converged"
    assert mild.plain[1] == "converged"
    hard = attempt("beam", "squeeze", 0.5, loads["beam", "squeeze", 0.5])
    assert hard.reference.startswith("to 0.2")
    assert "smallest stretch" in hard.diagnosis
    assert not mild.is_wrong
    assert not hard.is_wrong
