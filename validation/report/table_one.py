"""Table I of the paper beside the reference and the candidate."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import csv_text

MM3, MM2 = 1e9, 1e6


@dataclass(frozen=True)
class Row:
    """One quantity in one state: a value and its change against the original, per column."""

    quantity: str
    state: str
    cells: tuple[tuple[float | None, float | None], ...]


@dataclass(frozen=True)
class StateTable:
    """Volume and surface area of the original, linear and Green states, by column."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    has_paper: bool


def state_table(result: CaseResult) -> StateTable:
    """Columns: the paper where the case has its numbers, then every simulator; mm3 and mm2."""
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
    for quantity, key, rest, scale in (
        ("volume", "volume", mesh.volume, MM3),
        ("surface area", "area", mesh.surface_area, MM2),
    ):
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
                    cells.append((rest * scale, None))
                    continue
                found = result.state(label, strain)
                if found is None:
                    cells.append((None, None))
                    continue
                amount = found.volume if key == "volume" else found.surface_area
                cells.append((amount * scale, (amount / rest - 1) * 100))
            rows.append(Row(quantity, state, tuple(cells)))
    columns = (["paper"] if has_paper else []) + labels
    return StateTable(tuple(columns), tuple(rows), has_paper)


def state_table_csv(result: CaseResult) -> str:
    """The same table for a spreadsheet."""
    table = state_table(result)
    columns = ["quantity", "state"]
    columns += [name for c in table.columns for name in (c, f"{c} change %")]
    rows = []
    for row in table.rows:
        unit = "mm3" if row.quantity == "volume" else "mm2"
        cells = ["" if number is None else f"{number:.4f}" for pair in row.cells for number in pair]
        rows.append([f"{row.quantity} [{unit}]", row.state, *cells])
    return csv_text(columns, rows)
