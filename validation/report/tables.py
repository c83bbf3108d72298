"""Tables of a report, for page and CSV: Table I of the paper, checks, solutions, provenance."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.meshes.problem import Strain
from palpate.validation.judging.error_budget import Budget, budget_rows
from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import csv_text
from palpate.validation.report.linear_strain import percent_off


@dataclass(frozen=True)
class Row:
    """One quantity in one state: its value in a unit and its change [%], by column."""

    quantity: str
    unit: str
    state: str
    cells: tuple[tuple[float | None, float | None], ...]


@dataclass(frozen=True)
class StateTable:
    """Volume and surface area of the original, linear and Green states, by column."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    has_paper: bool


def state_table(result: CaseResult) -> StateTable:
    """Columns: the paper, if the case has its numbers, then every simulator; in its units."""
    references = [s for s in result.states if s.is_reference]
    references.sort(key=lambda s: (s.degree, s.label), reverse=True)
    labels = list(dict.fromkeys(s.label for s in references))
    labels += dict.fromkeys(s.label for s in result.states if not s.is_reference)
    published = result.published
    has_paper = all(
        isinstance(published.get(f"{state}_{key}"), int | float)
        for state in ("original", *Strain)
        for key in ("volume", "area")
    )
    mesh = result.problem.mesh
    rows = []
    for quantity, key, rest in (
        ("volume", "volume", mesh.volume),
        ("surface area", "area", mesh.surface_area),
    ):
        size, unit = result.units.of(key)
        for state, strain in (
            ("original", None),
            ("linear strain", Strain.LINEAR),
            ("Green strain", Strain.GREEN),
        ):
            cells: list[tuple[float | None, float | None]] = []
            if has_paper:
                original = float(published[f"original_{key}"])
                value = float(published[f"{strain or 'original'}_{key}"])
                cells.append((value, None if strain is None else (value / original - 1) * 100))
            for label in labels:
                if strain is None:
                    cells.append((rest / size, None))
                    continue
                found = result.state(label, strain)
                if found is None:
                    cells.append((None, None))
                    continue
                amount = found.volume if key == "volume" else found.surface_area
                cells.append((amount / size, (amount / rest - 1) * 100))
            rows.append(Row(quantity, unit, state, tuple(cells)))
    columns = (["paper"] if has_paper else []) + labels
    return StateTable(tuple(columns), tuple(rows), has_paper)


def state_table_csv(result: CaseResult) -> str:
    """The same table for a spreadsheet."""
    table = state_table(result)
    columns = ["quantity", "state"]
    columns += [name for c in table.columns for name in (c, f"{c} change %")]
    rows = []
    for row in table.rows:
        cells = ["" if number is None else f"{number:.4f}" for pair in row.cells for number in pair]
        rows.append([f"{row.quantity} [{row.unit}]", row.state, *cells])
    return csv_text(columns, rows)


_CHECK = (
    "metric", "against", "strain", "element", "verdict", "value", "limit", "reference_error",
    "unit", "scale", "bar_says", "is_vacuous", "precision", "reason",
)  # fmt: skip
_SOLUTION = ("label", "strain", "element", "degree")


def write_tables(result: CaseResult, folder: Path, budgets: Sequence[Budget] = ()) -> list[Path]:
    """Write NAME-states, -checks and -solutions.csv, and -budget.csv where there are budgets."""
    texts = {
        "states": state_table_csv(result),
        "checks": csv_text(_CHECK, ([_cell(getattr(c, n)) for n in _CHECK] for c in result.checks)),
        "solutions": solutions_csv(result),
    }
    if budgets:
        texts["budget"] = csv_text(*budget_rows(list(budgets), result.units))
    made = []
    for name, text in texts.items():
        path = folder / f"{result.name}-{name}.csv"
        path.write_text(text, encoding="utf-8")
        made.append(path)
    return made


def solutions_csv(result: CaseResult) -> str:
    """Every solution in the case's units, and how far its displacement is from the truth's."""
    sizes = [result.units.of(dimension) for dimension in ("length", "volume", "area")]
    names = ("largest displacement", "volume", "surface area")
    columns = ["simulator", *_SOLUTION[1:]]
    columns += [f"{name} [{unit}]" for name, (_, unit) in zip(names, sizes, strict=True)]
    columns += ["smallest det F [-]", "displacement off the truth with Green strain [%]"]
    rows = []
    for state in result.states:
        numbers = (state.max_displacement, state.volume, state.surface_area)
        own = [value / size for value, (size, _) in zip(numbers, sizes, strict=True)]
        others = (state.smallest_det_f, percent_off(result, state), state.seconds or None)
        about = [getattr(state, name) or None for name in _SOLUTION]
        rows.append([_cell(value) for value in (*about, *own, *others)])
    return csv_text([*columns, "time [s], none of what was stored"], rows)


def _cell(value: object) -> object:
    """Format numbers to ten digits, and leave other values as they are."""
    if value is None:
        return ""
    return (
        f"{value:.10g}" if isinstance(value, float) else value if type(value) is int else str(value)
    )


# The keys of a record, in this order.
_OWN = ("palpate", "python", "numpy", "machine", "time", "command", "case_file")
_OF_MESH = {
    "origin": "{}",
    "num_points": "{} points",
    "num_cells": "{} cells",
    "smallest_dihedral_deg": "smallest dihedral angle {}°",
    "longest_edge": "longest edge {}",
}
_HASHES = {"case_key": "hash of the problem", "input_key": "hash of all inputs"}


def provenance_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Versions, machine, command, hashes, mesh and reference, each as a name and a value.

    Entries that a record lacks are left out; long ones (iterates, parts of bars, changes since the
    previous reference) are in the whole record only.
    """
    rows = [(name.replace("_", " "), str(record[name])) for name in _OWN if name in record]
    rows = [(name, _clock(text) if name == "time" else text) for name, text in rows]
    rows += [(words, str(record[key])) for key, words in _HASHES.items() if key in record]
    mesh: Mapping[str, Any] = record.get("mesh") or {}
    if mesh:
        says = {key: _OF_MESH.get(key, f"{key.replace('_', ' ')} {{}}") for key in mesh}
        rows.append(("mesh", ", ".join(says[key].format(_short(mesh[key])) for key in mesh)))
    reference: Mapping[str, Any] = record.get("reference") or {}
    if "origin" in reference:
        rows.append(("reference", str(reference["origin"])))
    about = [f"{k} {_short(v)}" for k, v in reference.items() if isinstance(v, str | int | float)]
    about = [words for words in about if not words.startswith("origin ")]
    if about:
        rows.append(("reference built", ", ".join(about)))
    versions: Mapping[str, Any] = reference.get("versions") or {}
    if versions:
        rows.append(("with", ", ".join(f"{name} {version}" for name, version in versions.items())))
    accepted: Mapping[str, Any] = reference.get("accepted") or {}
    said = [f"{key} {accepted[key]}" for key in ("by", "date") if key in accepted]
    if said:
        rows.append(("reference accepted", ", ".join(said)))
    return rows


def _clock(text: str) -> str:
    """A time of ISO 8601 as people write it: 2026-11-28 05:15:24 UTC."""
    return text.replace("T", " ").replace("+00:00", " UTC")


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def record_text(record: Mapping[str, Any]) -> str:
    """The record as JSON, with each list of numbers on one line."""
    text = json.dumps(dict(record), indent=2, allow_nan=False)
    numbers = r"\[\s+((?:-?[\d.]+(?:e[-+]?\d+)?|null)(?:,\s+(?:-?[\d.]+(?:e[-+]?\d+)?|null))*)\s+\]"
    return re.sub(numbers, lambda found: f"[{' '.join(found[1].split())}]", text)
