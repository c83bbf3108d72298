"""The page of equations says where each stands: held against the files that it names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "validation" / "documentation" / "equations.md"
# A label stands at the head of a file, or this near to the name that it is about.
NEAR = 12
HEAD = 12


def rows(first: str) -> list[list[str]]:
    """Cells of the table whose first column is called so."""
    lines = PAGE.read_text("utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"| {first} |"))
    found = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        found.append([cell.strip() for cell in line.strip("|").split("|")])
    return found


def numbers(cell: str) -> list[int]:
    """1, or 3 and 4 of "3-4"."""
    first, _, last = cell.partition("-")
    return list(range(int(first), int(last or first) + 1))


def places(cell: str) -> list[tuple[Path, str]]:
    """Files and the names in them."""
    return [(ROOT / path, name) for path, name in re.findall(r"`([^`]+)` `([^`]+)`", cell)]


def labelled(text: str) -> set[int]:
    """Equations that a text names: "eq. 2", "eq. 1, 5 and 8", "eq. 11-13"."""
    found: set[int] = set()
    for list_of in re.findall(r"[Ee]q\. (\d+(?:-\d+)?(?:(?:, | and )\d+(?:-\d+)?)*)", text):
        for part in re.split(", | and ", list_of):
            found |= set(numbers(part))
    return found


def around(path: Path, name: str) -> str:
    """Head of a file, and what stands near the definition of a name in it."""
    lines = path.read_text("utf-8").splitlines()
    defined = re.compile(
        rf"(def|class|struct|enum class) {name}\b|^(inline |\[\[.*\]\] )?[\w:<> ]+ {name}\("
    )
    found = [k for k, line in enumerate(lines) if defined.search(line)]
    assert found, f"{path}: defines no {name}"
    near = [line for k in found for line in lines[max(0, k - NEAR) : k + NEAR]]
    return "\n".join(lines[:HEAD] + near)


EQUATIONS = rows("eq.")
SECTIONS = rows("section")


def test_every_equation_of_the_paper_is_on_the_page_once() -> None:
    assert [n for row in EQUATIONS for n in numbers(row[0])] == list(range(1, 14))


@pytest.mark.parametrize("row", EQUATIONS, ids=lambda row: f"eq. {row[0]}")
def test_the_files_name_the_equation_where_the_page_says(row: list[str]) -> None:
    fastsim, reference = places(row[2]), places(row[3])
    assert fastsim
    assert all("fastsim" in path.parts for path, _ in fastsim)
    assert all("reference" in path.parts for path, _ in reference)
    for path, name in fastsim + reference:
        missing = set(numbers(row[0])) - labelled(around(path, name))
        assert not missing, f"{path}: no label of eq. {sorted(missing)} near {name}"


@pytest.mark.parametrize("row", SECTIONS, ids=lambda row: f"section {row[0]}")
def test_the_files_name_the_section_where_the_page_says(row: list[str]) -> None:
    assert places(row[2])
    for path, name in places(row[2]):
        assert re.search(rf"section {row[0]}\b", around(path, name)), f"{path}: {name}"


@pytest.mark.parametrize("row", EQUATIONS + SECTIONS, ids=lambda row: row[0])
def test_the_tests_on_the_page_exist(row: list[str]) -> None:
    (held,) = places(row[-1])
    assert re.search(rf"^def {held[1]}\(", held[0].read_text("utf-8"), re.MULTILINE), held


def test_labels_are_read_as_they_are_written() -> None:
    assert labelled("forces: eq. 1, 5 and 8.") == {1, 5, 8}
    assert labelled("(eq. 3-4) and Eq. 12") == {3, 4, 12}
    assert labelled("the equation 7") == set()
