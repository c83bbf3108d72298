"""Where a case file wants a number, nothing else will do, and the message says where it stands."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from palpate.meshes.errors import InputError
from palpate.validation.case import CaseError, load_case
from palpate.validation.case.body_schema import Count, Flag, Number
from palpate.validation.case.schema import CaseSpec

Write = Callable[..., Path]

# Each key with the text that stands there; the block case has them, or gets them.
NUMBERS = {
    "limit": "limit = 1e-8",
    "youngs_modulus": "youngs_modulus = 1000.0",
    "poissons_ratio": "poissons_ratio = 0.3",
    "edge_length": "edge_length = 0.5",
    "force": "force = [60.0,",
    "point": "point = [0.001,",
    "size": "size = [2.0,",
}
NOT_NUMBERS = ["true", '"1e300"', "inf", "-nan", "1" + "0" * 400, "2020-01-01", "{}"]


@pytest.mark.parametrize("value", NOT_NUMBERS)
@pytest.mark.parametrize("key", NUMBERS)
def test_what_is_no_finite_number_is_refused_with_line_and_key(
    write_case: Write, key: str, value: str
) -> None:
    old = NUMBERS[key]
    new = re.sub(r"[-\d.]+(e-8)?(?=,?$)", value, old)
    path = write_case((old, new))
    line = path.read_text("utf-8").split(new)[0].count("\n") + 1
    with pytest.raises(CaseError) as refused:
        load_case(path)
    first = str(refused.value).splitlines()[0]
    assert re.match(rf"{re.escape(str(path))}:{line}: \S*\b{key}\b", first)
    assert len(first) < 300


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("schema = 1", "schema = true", "schema"),
        ("schema = 1", 'schema = "1"', "schema"),
        ('shape = "box"', 'shape = "box"\nrepair = 1', "repair"),
        ("[[support]]", '[mesh]\ngrade = [{smallest = 1.0, boundary = 1}]\n[[support]]', "grade"),
        ("[[support]]", "[time]\nend_time = true\n[[support]]", "end_time"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = 2.0\n[[support]]", "num_outputs"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = true\n[[support]]", "num_outputs"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = 99999999\n[[support]]", "num_outputs"),
        ("[[support]]", "[[support]]\namplitude = {times = [true], factors = [1]}", "times"),
        ("[[support]]", '[[support]]\namplitude = {times = [0], factors = ["1"]}', "factors"),
        ("[[support]]", "[[support]]\ndisplacement = [0, false, 0]", "displacement"),
    ],
)  # fmt: skip
def test_truth_values_text_and_counts_are_told_apart(
    write_case: Write, old: str, new: str, key: str
) -> None:
    with pytest.raises(CaseError, match=key):
        load_case(write_case((old, new)))


def models(annotation: Any) -> Iterator[Any]:
    """Every type that an annotation is made of."""
    yield annotation
    for part in get_args(annotation):
        yield from models(part)


def test_no_key_of_the_schema_takes_a_bare_number_type() -> None:
    seen: set[type[BaseModel]] = set()
    bare, waiting = [], [CaseSpec]
    while waiting:
        model = waiting.pop()
        seen.add(model)
        for name, field in model.model_fields.items():
            # Annotated[float, validator] is taken apart by pydantic where it is the whole type.
            whole = field.metadata and any(m in field.metadata for m in _checks())
            for part in models(field.annotation):
                if isinstance(part, type) and issubclass(part, BaseModel) and part not in seen:
                    waiting.append(part)
                if part in (float, int, bool) and not whole and not _is_within(field.annotation):
                    bare.append(f"{model.__name__}.{name}")
    assert len(seen) > 15
    assert bare == []


def _checks() -> list[Any]:
    return [get_args(kind)[1] for kind in (Number, Count, Flag)]


def _is_within(annotation: Any) -> bool:
    """Whether a checked number is among the parts."""
    return any(
        check in getattr(part, "__metadata__", ()) for part in models(annotation)
        for check in _checks()
    )  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "place"),
    [
        ("when = 2020-01-01", "published.when"),
        ("when = 12:30:00", "published.when"),
        ("when = 2020-01-01T12:30:00Z", "published.when"),
        ("volume = nan", "published.volume"),
        ("deep.rows = [[1, 2], [3, inf]]", "published.deep.rows.2.2"),
        ("huge = 1" + "0" * 400, "published.huge"),
    ],
)
def test_published_holds_only_what_a_results_file_can(
    write_case: Write, entry: str, place: str
) -> None:
    with pytest.raises(CaseError, match=re.escape(place)):
        load_case(write_case(("[geometry]", f"[published]\n{entry}\n[geometry]")))


def test_published_keeps_text_numbers_truth_values_and_tables(write_case: Write) -> None:
    entry = 'volume = 1.5\nwho = "me"\nis_old = true\nrows = [[1, 2.5]]\ndeep.key = 3'
    case = load_case(write_case(("[geometry]", f"[published]\n{entry}\n[geometry]")))
    assert case.spec.published == {
        "volume": 1.5, "who": "me", "is_old": True, "rows": [[1, 2.5]], "deep": {"key": 3},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("force = [60.0,", "force = [1e308,", "load 1"),
        (
            "[[load]]",
            "[[load]]\nkind = 'gravity'\nacceleration = [0, 0, -1e308]\n[[load]]",
            "load 1",
        ),
        ("[[support]]", "[[support]]\ndisplacement = [1e200, 0, 0]", "support 1"),
        (
            "[[support]]",
            "[[support]]\ndisplacement = [1, 0, 0]\namplitude = {times = [0], factors = [1e200]}",
            "support 1",
        ),
    ],
)
def test_what_is_too_large_to_compute_with_is_refused_by_its_place(
    write_case: Write, old: str, new: str, what: str
) -> None:
    path = write_case((old, new))
    with pytest.raises(InputError, match=f"{what}: .*too large to compute with; lower it"):
        _ = load_case(path).problem
