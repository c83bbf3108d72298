"""Two results.json side by side: what is better, worse, new and gone; odd files are refused."""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from judged import case_of, judge

from palpate.meshes.errors import FileFormatError
from palpate.validation.judging.outputs import results_json
from palpate.validation.judging.run_comparison import RunComparison, compare_runs, read_run
from palpate.validation.states import ExitCode


def check(metric: str, value: float | None, verdict: str, **others: Any) -> dict[str, Any]:
    about = {"metric": metric, "against": "truth", "strain": "green", "limit": 0.05}
    return {**about, "value": value, "verdict": verdict, "reference_error": 0.003, **others}


RUN = {
    "palpate": "0",
    "schema": 1,
    "cases": [
        {
            "name": "liver",
            "verdict": "passed",
            "provenance": {"case_key": "k"},
            "metrics": {"fastsim.green.volume": 2.0, "error.truth.green.volume": 1e-12},
            "checks": [
                check("displacement_l2", 0.02, "passed"),
                check("volume", 0.03, "passed"),
                check("volume", 0.04, "passed", element="smoothed"),
                check("smallest_det_f", 0.5, "passed", against="candidate", limit=0.2),
            ],
        }
    ],
}


def written(folder: Path, name: str, change: Any = None) -> Path:
    run = copy.deepcopy(RUN)
    if change is not None:
        change(run["cases"][0])
    path = folder / name
    path.write_text(json.dumps(run), "utf-8")
    return path


def compared(folder: Path, change: Any = None) -> RunComparison:
    return compare_runs(written(folder, "a.json"), written(folder, "b.json", change))


def changes(found: RunComparison) -> dict[str, str]:
    return {pair.check: pair.change for pair in found.pairs}


def make_worse(case: Any) -> None:
    case["checks"][0].update(value=0.0201)
    case["checks"][1].update(value=0.09, verdict="failed")
    case.update(verdict="failed")


def test_the_same_run_twice_is_the_same(tmp_path: Path) -> None:
    found = compared(tmp_path)
    assert set(changes(found).values()) == {"same"}
    assert len(found.pairs) == 4  # the two volumes differ by their element
    assert found.exit_code is ExitCode.PASSED
    assert found.remarks == ("4 of 4 checks found the same.",)


def test_a_verdict_that_got_worse_fails_and_stands_first(tmp_path: Path) -> None:
    found = compared(tmp_path, make_worse)
    assert changes(found) == {
        "volume (truth, green)": "worse",
        "displacement_l2 (truth, green)": "slightly larger error",
        "volume (truth, green, smoothed)": "same",
        "smallest_det_f (own, green)": "same",
    }
    assert found.exit_code is ExitCode.FAILED
    rows = found.markdown("old", "new").splitlines()
    assert rows[0] == "| case | check | old | new | change |"
    assert rows[2].startswith("| liver | volume (truth, green) | 0.03 ± 0.003, passed | 0.09")


def test_a_check_that_is_gone_is_worse_and_a_new_one_is_not(tmp_path: Path) -> None:
    found = compared(tmp_path, lambda case: case["checks"].pop(2))
    assert changes(found)["volume (truth, green, smoothed)"] == "gone"
    assert found.exit_code is ExitCode.FAILED
    other_way = compare_runs(tmp_path / "b.json", tmp_path / "a.json")
    assert set(changes(other_way).values()) == {"same", "new"}
    assert other_way.exit_code is ExitCode.PASSED


def failed(case: Any, number: int, **fields: Any) -> None:
    case["checks"][number].update(verdict="failed", **fields)
    case.update(verdict="failed")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        # 0.02 of 0.05 was passed, and so is 0.04.
        (lambda case: case["checks"][0].update(value=0.04), "larger error"),
        (lambda case: case["checks"][0].update(limit=0.5), "looser limit"),
        # The limit of smallest_det_f is the least that it may be, and so a loss is a smaller one.
        (lambda case: case["checks"][3].update(limit=0.1), "looser limit"),
        (lambda case: case["checks"][3].update(value=0.3), "larger error"),
        (lambda case: failed(case, 0, value=None), "worse"),
        (lambda case: case["checks"].append(check("reaction", 1.0, "passed", limit=2.0)), None),
        (
            lambda case: (
                case["checks"].append(check("reaction", 3.0, "failed", limit=2.0)),
                case.update(verdict="failed"),
            ),
            "new and not passed",
        ),
    ],
)
def test_numbers_limits_and_checks_decide_and_not_only_words(
    tmp_path: Path, change: Any, word: str | None
) -> None:
    found = compared(tmp_path, change)
    assert found.exit_code is (ExitCode.PASSED if word is None else ExitCode.FAILED)
    assert (word or "new") in changes(found).values()


def test_a_failed_check_that_passes_by_a_looser_limit_is_worse(tmp_path: Path) -> None:
    first = written(tmp_path, "a.json", lambda case: failed(case, 0, value=0.2))
    second = written(tmp_path, "b.json", lambda case: case["checks"][0].update(value=0.2, limit=1))
    found = compare_runs(first, second)
    assert changes(found)["displacement_l2 (truth, green)"] == "looser limit"
    assert found.exit_code is ExitCode.FAILED


def test_a_value_that_is_gone_is_worse_whatever_the_verdict(tmp_path: Path) -> None:
    first = written(tmp_path, "a.json", lambda case: failed(case, 0, value=0.2))
    second = written(tmp_path, "b.json", lambda case: failed(case, 0, value=None))
    assert compare_runs(first, second).exit_code is ExitCode.FAILED
    assert compare_runs(second, first).exit_code is ExitCode.PASSED


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        # Inconclusive though every check passed: they are all vacuous, say.
        (lambda case: case.update(verdict="inconclusive"), "was passed and is inconclusive"),
        (lambda case: case["provenance"].update(case_key="other"), "is another problem"),
        (lambda case: case.update(name="kidney"), "liver is gone"),
    ],
)
def test_whole_cases_decide_too(tmp_path: Path, change: Any, remark: str) -> None:
    found = compared(tmp_path, change)
    assert found.exit_code is ExitCode.FAILED
    assert any(remark in line for line in found.remarks)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda run: run.update(cases=[]), "nothing was judged"),
        (lambda run: run["cases"][0].update(checks=[]), "nothing was judged"),
        (lambda run: run["cases"].append(run["cases"][0]), "two cases are called 'liver'"),
        (lambda run: run["cases"][0]["checks"][0].update(value=0.5), "said to have passed"),
        (lambda run: run["cases"][0]["checks"][0].update(value=None), "said to have passed"),
        (lambda run: run["cases"][0]["checks"][0].update(reference_error=None), "said to have"),
        (lambda run: run["cases"][0]["checks"][3].update(value=0.1), "said to have passed"),
        (lambda run: run["cases"][0]["checks"][1].update(verdict="failed"), "said to be passed"),
        (lambda run: run["cases"][0]["checks"][1].update(verdict="fine"), "verdict"),
    ],
)
def test_a_run_that_is_empty_or_contradicts_itself_is_refused(
    tmp_path: Path, palpate_run: Any, change: Any, words: str
) -> None:
    run = copy.deepcopy(RUN)
    change(run)
    path = tmp_path / "b.json"
    path.write_text(json.dumps(run), "utf-8")
    done = palpate_run("compare-runs", written(tmp_path, "a.json"), path)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        (lambda case: case["provenance"].update(case_key="other"), "liver is another problem"),
        (lambda case: case["checks"][0].update(limit=0.5), "limit 0.05, then 0.5 (looser)"),
        (lambda case: case["checks"][0].update(limit=0.04), "limit 0.05, then 0.04 (tighter)"),
        # The limit of smallest_det_f is the least that it may be.
        (lambda case: case["checks"][3].update(limit=0.1), "limit 0.2, then 0.1 (looser)"),
        (
            lambda case: case["metrics"].update(
                {"fastsim.green.volume": 2.1, "error.truth.green.volume": 1.0}
            ),
            "liver changed most in fastsim.green.volume: 2, then 2.1 (5 %)",
        ),
    ],
)
def test_limits_problems_and_numbers_that_changed_are_named(
    tmp_path: Path, change: Any, remark: str
) -> None:
    found = compared(tmp_path, change)
    assert any(remark in line for line in found.remarks)
    assert remark in found.markdown("a", "b")


def test_the_command_writes_the_table_and_ends_as_it_found(
    tmp_path: Path, palpate_run: Any
) -> None:
    first, second = written(tmp_path, "a.json"), written(tmp_path, "b.json", make_worse)
    table = tmp_path / "table.md"
    done = palpate_run("compare-runs", first, second, "--summary", table)
    assert done.returncode == ExitCode.FAILED, done.stderr
    assert "worse" in done.stdout
    assert "worse" in table.read_text("utf-8")
    assert palpate_run("compare-runs", first, first).returncode == 0


# --------------------------------------------------------------------------- files that are none
REMOVED = object()
ODD: list[Any] = [REMOVED, None, True, "text", -1, 1e300, [], {}, [1, 2], {"a": {"b": []}}]
Keys = tuple[str | int, ...]


@pytest.fixture(scope="module")
def judged() -> Any:
    """The results.json of a case that was judged."""
    return json.loads(results_json([judge(case_of("block"))], "1"))


def paths(value: Any, keys: Keys = ()) -> Iterator[Keys]:
    """The keys to every value of a document, at any depth."""
    yield keys
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from paths(inner, (*keys, key))


def changed(document: Any, keys: Keys, value: Any) -> str:
    """The document with another value there, or without it."""
    if not keys:
        return json.dumps(value)
    copied = copy.deepcopy(document)
    holder = copied
    for key in keys[:-1]:
        holder = holder[key]
    if value is REMOVED:
        del holder[keys[-1]]
    else:
        holder[keys[-1]] = value
    return json.dumps(copied)


@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.long
def test_any_key_missing_or_of_any_other_kind_is_refused_or_harmless(
    tmp_path: Path, judged: Any, every: int
) -> None:
    path, refused = tmp_path / "other.json", 0
    (tmp_path / "whole.json").write_text(json.dumps(judged), encoding="utf-8")
    for keys in itertools.islice(paths(judged), 0, None, every):
        for value in ODD if keys else ODD[1:]:
            path.write_text(changed(judged, keys, value), encoding="utf-8")
            try:
                compare_runs(tmp_path / "whole.json", path).markdown("a", "b")
            except FileFormatError:
                refused += 1
    assert refused > 100 / every


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("schema",), True),
        (("schema",), "1"),
        (("cases",), {}),
        (("cases", 0, "provenance"), []),
        (("cases", 0, "metrics"), [1]),
        (("cases", 0, "metrics", "rest.volume"), "1"),
        (("cases", 0, "checks", 0, "limit"), "1e-8"),
        (("cases", 0, "checks", 0, "limit"), True),
        (("cases", 0, "checks", 0, "value"), [1.0]),
        (("cases", 0, "checks", 0, "verdict"), 1),
        (("cases", 0, "checks", 0, "metric"), None),
        (("cases", 0, "checks", 0, "limit"), REMOVED),
        (("cases", 0, "checks"), REMOVED),
        (("cases", 0, "name"), REMOVED),
    ],
)
def test_the_key_of_what_is_wrong_is_named(
    tmp_path: Path, judged: Any, keys: Keys, value: Any
) -> None:
    path = tmp_path / "run.json"
    path.write_text(changed(judged, keys, value), encoding="utf-8")
    with pytest.raises(FileFormatError, match=str(keys[-1])):
        read_run(path)


@pytest.mark.parametrize(
    "text", ["", "[" * 1000, "{" * 5, "null", '{"schema": 1, "cases": [{"a": NaN}]}', "\ufeff{}"]
)
def test_what_is_no_results_file_is_an_input_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text, encoding="utf-8")
    (tmp_path / "loop.json").symlink_to("loop.json")
    for name in ("x.json", "loop.json", "missing.json", "."):
        with pytest.raises(FileFormatError):
            read_run(tmp_path / name)


@pytest.mark.parametrize(
    ("before", "now", "against", "expected"),
    [
        (0.02, 0.02, "truth", "same"),
        (0.02, 0.01, "truth", "smaller error"),
        (0.02, 0.04, "truth", "larger error"),
        (0.02, 0.02007, "truth", "slightly larger error"),
        (0.02, 0.03, "published", "changed"),
    ],
)
def test_the_change_of_a_value_is_reported(tmp_path, before, now, against, expected):
    def of(value):
        def change(case):
            case["checks"][0] |= {"value": value, "against": against}

        return change

    first, second = (written(tmp_path, n, of(v)) for n, v in (("a.json", before), ("b.json", now)))
    (found,) = [p for p in compare_runs(first, second).pairs if p.check.startswith("displacement")]
    assert found.change == expected
