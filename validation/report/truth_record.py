"""The record of a truth for a reader: how it was found, on which meshes, with which error bars."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from palpate.validation.judging.provenance import STORED_HASH, stored_record
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.adaptive_truth import ADAPTIVE
from palpate.validation.references.bars import PARTS, read_row
from palpate.validation.report.answer import metric_in_words
from palpate.validation.report.comparisons import STRAIN_NAMES

# Where a motion's record has its meshes.
_OF_MOTION = "convergence"
# Names of the metrics of a part end with a hash of it.
_OF_PART = "@"
_STRAINS = {str(strain): words for strain, words in STRAIN_NAMES.items()}


class TruthRecord(NamedTuple):
    """What is known of a truth: facts by name, and each error bar in per cent of its scale.

    Rows of `bars` are quantity, strain, whole bar (None where nothing bounds it), and its parts in
    words.
    """

    facts: tuple[tuple[str, str], ...]
    bars: tuple[tuple[str, str, float | None, str], ...]


def truth_record(result: CaseResult) -> TruthRecord:
    """The record of a result's truth; no facts where the case has none.

    Anybody may have written a stored record: what is not of the expected kind is left out.
    """
    reference = _table(result.provenance.get("reference"))
    stored = stored_record(reference)
    facts = [("origin", str(reference["origin"]))] if "origin" in reference else []
    facts += [
        (f"meshes, {_STRAINS.get(strain, strain)}", words)
        for kind in (ADAPTIVE, _OF_MOTION)
        for strain, row in _table(reference.get(kind)).items()
        if (words := _meshes(_table(row)))
    ]
    made = [str(stored[key]) for key in ("command", "date") if key in stored]
    if "palpate" in stored:
        made.append(f"palpate {stored['palpate']}")
    versions = _table(stored.get("versions"))
    made += [f"{name} {versions[name]}" for name in ("dolfinx", "petsc") if name in versions]
    if made:
        facts.append(("found by", ", ".join(made)))
    accepted = _table(stored.get("accepted"))
    says = [str(accepted[key]) for key in ("by", "date", "reason") if key in accepted]
    if says:
        facts.append(("accepted", "; ".join(says)))
    if STORED_HASH in stored:
        facts.append(("SHA-256 of the stored truth", str(stored[STORED_HASH])))
    else:
        facts.append(("stored truth", "none: the reference was solved in this run"))
    return TruthRecord(tuple(facts), tuple(_bars(_table(reference.get(PARTS)))))


def _table(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _meshes(row: Mapping[str, Any]) -> str:
    """The meshes of one strain measure, and why there is no finer one."""
    cells, unknowns = row.get("cells"), row.get("unknowns")
    if not (isinstance(cells, list) and cells):
        return ""
    words = f"{' → '.join(map(str, cells))} cells"
    words += f" of degree {row['degree']}" if "degree" in row else ""
    if isinstance(unknowns, list) and unknowns:
        words += f", {unknowns[-1]} unknowns on the last"
    return words + (f"; ended: {row['ended']}" if "ended" in row else "")


def _bars(table: Mapping[str, Any]) -> list[tuple[str, str, float | None, str]]:
    rows = []
    for name, row in table.items():
        metric, _, strain = name.partition("|")
        parts = read_row(row)
        if parts is None or strain not in _STRAINS:
            continue
        where = ", in the part that the case names" if _OF_PART in metric else ""
        whole = 100.0 * parts.whole if math.isfinite(parts.whole) else None
        of = parts.reported(with_geometry=True).items()
        words = ", ".join(
            f"{part} {100.0 * value:.2g} %" for part, value in of if math.isfinite(value)
        )
        name = metric_in_words(metric.partition(_OF_PART)[0]) + where
        rows.append((name, _STRAINS[strain], whole, words))
    return rows
