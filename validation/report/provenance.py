"""Where a result comes from: what a reader needs in a few rows, and the whole record."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

# As a record names them, in this order.
_OWN = ("palpate", "python", "numpy", "machine", "time", "command", "case_file", "case_key")


def provenance_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Versions, machine, command, hashes, mesh and reference: a name and its value each.

    Whatever of a record is missing is left out; what is long (iterates, parts of bars, changes
    since the reference before) is in the whole record only.
    """
    rows = [(name.replace("_", " "), str(record[name])) for name in _OWN if name in record]
    mesh: Mapping[str, Any] = record.get("mesh") or {}
    if mesh:
        rows.append(("mesh", ", ".join(f"{k.replace('_', ' ')} {_short(mesh[k])}" for k in mesh)))
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


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def record_text(record: Mapping[str, Any]) -> str:
    """As JSON, a list of numbers on one line."""
    text = json.dumps(dict(record), indent=2, allow_nan=False)
    numbers = r"\[\s+((?:-?[\d.]+(?:e[-+]?\d+)?|null)(?:,\s+(?:-?[\d.]+(?:e[-+]?\d+)?|null))*)\s+\]"
    return re.sub(numbers, lambda found: f"[{' '.join(found[1].split())}]", text)
