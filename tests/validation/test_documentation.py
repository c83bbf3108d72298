"""The list of equations says where each stands: held against the files that it names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from making.equations import equations, find, read_list, written_out

ROOT = Path(__file__).parents[2]
LIST = ROOT / "validation" / "documentation" / "equations.toml"
# A label stands at the head of a file, or this near to the name that it is about.
NEAR = 12
HEAD = 12

EQUATIONS, SECTIONS = read_list(LIST)


def numbers(words: str) -> list[int]:
    """1, or 3 and 4 of "3-4"."""
    first, _, last = words.partition("-")
    return list(range(int(first), int(last or first) + 1))


def labelled(text: str) -> set[int]:
    """Equations that a text names: "eq. 2", "eq. 1, 5 and 8", "eq. 11-13"."""
    found: set[int] = set()
    for list_of in re.findall(r"[Ee]q\. (\d+(?:-\d+)?(?:(?:, | and )\d+(?:-\d+)?)*)", text):
        for part in re.split(", | and ", list_of):
            found |= set(numbers(part))
    return found


def around(words: str) -> str:
    """Head of a file, and what stands near the definition of a name in it."""
    position = find(words)
    lines = (ROOT / position.path).read_text("utf-8").splitlines()
    at = position.first - 1
    return "\n".join(lines[:HEAD] + lines[max(0, at - NEAR) : at + NEAR])


def test_every_equation_of_the_paper_is_listed_once() -> None:
    assert [n for entry in EQUATIONS for n in numbers(entry["number"])] == list(range(1, 14))


@pytest.mark.parametrize("entry", EQUATIONS, ids=lambda entry: f"eq. {entry['number']}")
def test_the_files_name_the_equation_where_the_list_says(entry: dict[str, Any]) -> None:
    assert entry["fastsim"]
    assert all(words.startswith("fastsim/") for words in entry["fastsim"])
    assert all(words.startswith("reference/") for words in entry["reference"])
    for words in entry["fastsim"] + entry["reference"]:
        missing = set(numbers(entry["number"])) - labelled(around(words))
        assert not missing, f"{words}: no label of eq. {sorted(missing)} near it"


@pytest.mark.parametrize("entry", SECTIONS, ids=lambda entry: f"section {entry['number']}")
def test_the_files_name_the_section_where_the_list_says(entry: dict[str, Any]) -> None:
    assert entry["fastsim"]
    for words in entry["fastsim"]:
        assert re.search(rf"section {entry['number']}\b", around(words)), words


@pytest.mark.parametrize("entry", EQUATIONS + SECTIONS, ids=lambda entry: entry["number"])
def test_the_tests_on_the_list_exist(entry: dict[str, Any]) -> None:
    position = find(entry["held_by"])
    assert position.path.startswith("tests/")
    assert position.name.startswith("test_")


def test_labels_are_read_as_they_are_written() -> None:
    assert labelled("forces: eq. 1, 5 and 8.") == {1, 5, 8}
    assert labelled("(eq. 3-4) and Eq. 12") == {3, 4, 12}
    assert labelled("the equation 7") == set()


def test_lines_and_sources_are_those_of_the_files() -> None:
    strain = find("reference/laws.py green_lagrange_strain")
    lines = (ROOT / strain.path).read_text("utf-8").splitlines()
    assert lines[strain.first - 1].startswith("def green_lagrange_strain(")
    assert strain.source() == "\n".join(lines[strain.first - 1 : strain.last])
    declared = find("fastsim/core/mechanics/tet4.hpp strain_tensor")
    body = written_out(declared)
    assert body is not None
    assert declared.source().endswith(");")
    assert body.source().startswith("Matrix3 strain_tensor(")
    assert body.source().endswith("return e;\n}")
    with pytest.raises(LookupError, match="defines no green_strain"):
        find("reference/laws.py green_strain")


def test_the_page_has_a_row_and_a_heading_for_each() -> None:
    page = equations(LIST)
    for entry in EQUATIONS:
        assert f"## Equation {entry['number']}: {entry['title']}" in page
        for words in [*entry["fastsim"], *entry["reference"], entry["held_by"]]:
            assert f"`{find(words).short}`" in page
