"""An accepted results.json with anything missing or of another kind is an input error."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.errors import FileFormatError
from palpate.validation.case import load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.result_changes import describe_since, read_accepted
from palpate.validation.judging.results import CaseResult

ODD: list[Any] = [None, True, "text", -1, 1e300, [], {}, [1, 2], {"a": {"b": []}}]


@pytest.fixture(scope="module")
def judged() -> CaseResult:
    return judge_case(load_case("block"))


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
    tmp_path: Path, judged: CaseResult
) -> None:
    document = json.loads(outputs.results_json([judged], "1"))
    path, refused = tmp_path / "accepted.json", 0
    for place in places(document):
        for value in [places, *ODD] if place else ODD:
            path.write_text(json.dumps(changed(document, place, value)), encoding="utf-8")
            try:
                accepted = read_accepted(path)
            except FileFormatError:
                refused += 1
                continue
            describe_since([judged], accepted)
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
    tmp_path: Path, judged: CaseResult, place: tuple[str | int, ...], value: Any
) -> None:
    document = json.loads(outputs.results_json([judged], "1"))
    path = tmp_path / "accepted.json"
    path.write_text(json.dumps(changed(document, place, value)), encoding="utf-8")
    with pytest.raises(FileFormatError, match=str(place[-1])):
        read_accepted(path)


@pytest.mark.parametrize(
    "text", ["", "[" * 1000, "{" * 5, "null", '{"schema": 1, "cases": [{"a": NaN}]}', "\ufeff{}"]
)
def test_what_is_no_results_file_is_an_input_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text, encoding="utf-8")
    (tmp_path / "loop.json").symlink_to("loop.json")
    for name in ("x.json", "loop.json", "missing.json", "."):
        with pytest.raises(FileFormatError):
            read_accepted(tmp_path / name)
