"""Two results.json side by side: what is better, worse, new and gone; odd files are refused."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import FileFormatError
from palpate.validation.case import load_case
from palpate.validation.cli import app
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import results_json
from palpate.validation.judging.run_comparison import RunComparison, compare_runs, read_run
from palpate.validation.states import ExitCode

ODD: list[Any] = [None, True, "text", -1, 1e300, [], {}, [1, 2], {"a": {"b": []}}]


def check(metric: str, value: float | None, verdict: str, **others: Any) -> dict[str, Any]:
    about = {"metric": metric, "against": "truth", "strain": "green", "limit": 0.05}
    return {**about, "value": value, "verdict": verdict, "reference_error": 0.003, **others}


RUN = {
    "palpate": "0",
    "schema": 1,
    "cases": [
        {
            "name": "liver",
            "provenance": {"case_key": "k"},
            "metrics": {"fastsim.green.volume": 2.0, "error.truth.green.volume": 1e-12},
            "checks": [
                check("displacement_l2", 0.02, "passed"),
                check("volume", 0.03, "passed"),
                check("volume", 0.04, "passed", element="smoothed"),
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
    case["checks"][0].update(value=0.021)
    case["checks"][1].update(value=0.09, verdict="failed")


def test_the_same_run_twice_is_the_same(tmp_path: Path) -> None:
    found = compared(tmp_path)
    assert set(changes(found).values()) == {"same"}
    assert len(found.pairs) == 3  # the two volumes are told apart by their element
    assert found.exit_code is ExitCode.PASSED
    assert found.remarks == ("3 of 3 checks found the same.",)


def test_a_verdict_that_got_worse_fails_and_stands_first(tmp_path: Path) -> None:
    found = compared(tmp_path, make_worse)
    assert changes(found) == {
        "volume (truth, green)": "worse",
        "displacement_l2 (truth, green)": "larger error",
        "volume (truth, green, smoothed)": "same",
    }
    assert found.exit_code is ExitCode.FAILED
    rows = found.markdown("old", "new").splitlines()
    assert rows[0] == "| case | check | old | new | change |"
    assert rows[2].startswith("| liver | volume (truth, green) | 0.03 ± 0.003, passed | 0.09")


def test_a_check_that_is_gone_is_worse_and_a_new_one_is_not(tmp_path: Path) -> None:
    found = compared(tmp_path, lambda case: case["checks"].pop())
    assert changes(found)["volume (truth, green, smoothed)"] == "gone"
    assert found.exit_code is ExitCode.FAILED
    other_way = compare_runs(tmp_path / "b.json", tmp_path / "a.json")
    assert set(changes(other_way).values()) == {"same", "new"}
    assert other_way.exit_code is ExitCode.PASSED


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        (lambda case: case["provenance"].update(case_key="other"), "liver is another problem"),
        (lambda case: case["checks"][0].update(limit=0.5), "limit 0.05, then 0.5 (looser)"),
        (lambda case: case["checks"][0].update(limit=0.04), "limit 0.05, then 0.04 (tighter)"),
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


def test_the_limit_of_smallest_det_f_is_looser_where_it_is_lower(tmp_path: Path) -> None:
    for name, limit in (("a.json", 0.2), ("b.json", 0.1)):
        about = check("smallest_det_f", 0.5, "passed", against="candidate", limit=limit)
        written(tmp_path, name, lambda case, about=about: case.update(checks=[about]))
    (_, line) = compare_runs(tmp_path / "a.json", tmp_path / "b.json").remarks
    assert line.endswith("(looser).")


def test_an_answer_that_lost_its_number_is_told(tmp_path: Path) -> None:
    found = compared(tmp_path, lambda case: case["checks"][0].update(value=None))
    assert changes(found)["displacement_l2 (truth, green)"] == "changed"


def test_the_command_writes_the_table_and_ends_as_it_found(tmp_path: Path) -> None:
    first, second = written(tmp_path, "a.json"), written(tmp_path, "b.json", make_worse)
    table = tmp_path / "table.md"
    words = ["compare-runs", str(first), str(second), "--summary", str(table)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == ExitCode.FAILED, done.output
    assert "worse" in done.output
    assert "worse" in table.read_text("utf-8")
    assert CliRunner().invoke(app, ["compare-runs", str(first), str(first)]).exit_code == 0


@pytest.fixture(scope="module")
def judged() -> str:
    """The results.json of a case that was judged."""
    return results_json([judge_case(load_case("block"))], "1")


def places(value: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every place of a document, at any depth."""
    yield place
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(inner, (*place, key))


def changed(document: Any, place: tuple[str | int, ...], value: Any) -> Any:
    """With another value at a place; without it where the value is `places`."""
    if not place:
        return value
    copied = copy.deepcopy(document)
    holder = copied
    for key in place[:-1]:
        holder = holder[key]
    if value is places:
        del holder[place[-1]]
    else:
        holder[place[-1]] = value
    return copied


def test_any_key_missing_or_of_any_other_kind_is_told_or_harmless(
    tmp_path: Path, judged: str
) -> None:
    document = json.loads(judged)
    path, refused = tmp_path / "other.json", 0
    (tmp_path / "whole.json").write_text(judged, encoding="utf-8")
    for place in places(document):
        for value in [places, *ODD] if place else ODD:
            path.write_text(json.dumps(changed(document, place, value)), encoding="utf-8")
            try:
                compare_runs(tmp_path / "whole.json", path).markdown("a", "b")
            except FileFormatError:
                refused += 1
    assert refused > 100


@pytest.mark.parametrize(
    ("place", "value"),
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
        (("cases", 0, "checks", 0, "limit"), places),
        (("cases", 0, "checks"), places),
        (("cases", 0, "name"), places),
    ],
)
def test_the_place_of_what_is_wrong_is_told(
    tmp_path: Path, judged: str, place: tuple[str | int, ...], value: Any
) -> None:
    document = json.loads(judged)
    path = tmp_path / "run.json"
    path.write_text(json.dumps(changed(document, place, value)), encoding="utf-8")
    with pytest.raises(FileFormatError, match=str(place[-1])):
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
