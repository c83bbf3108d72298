"""Stored references whose numbers stay while the rules about them have changed.

A file of version 0.1 has no hash; error bars of a truth on adaptive meshes follow from the record
of its meshes by a formula that gets better. Both are mended without solving anything.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import Any

from palpate.meshes.problem import Problem, Strain
from palpate.validation.references.adaptive_truth import ADAPTIVE, recorded_bars
from palpate.validation.references.bar_parts import PARTS, as_record, of_statics, recorded
from palpate.validation.references.reference_files import read_reference
from palpate.validation.references.sets import Bars, ReferenceSet
from palpate.validation.references.stored import describe_acceptance, load_checked, store
from palpate.validation.versions import version_of

_HASH = "hash added to a file of version 0.1; fields and numbers as they were"
_BARS = "error bars as the record of meshes makes them now; fields, numbers and record as they were"


def renew_reference(path: Path, name: str, problem: Problem, called: str = "") -> list[str]:
    """Check an accepted reference as far as it can be, and add a hash if it has none.

    Bars that follow from a record of adaptive meshes are made anew by the formula of today.

    Args:
        path: Of the file.
        name: Of the case.
        problem: Of the case now.
        called: What the case is called on the command line, if not by its name.

    Returns:
        What was done, a line each.

    Raises:
        MissingReferenceError: No file, or a damaged one.
        StaleReferenceError: Made for something else, altered, or contradicting itself or the case.
    """
    references = load_checked(
        path,
        name,
        problem,
        called,
        thoroughly=True,
        needs_hash=False,
        before_check=with_bars_of_today,
    )
    stored, _, is_hashed = read_reference(path)
    changed = {
        key: (stored.bars[key], bar)
        for key, bar in references.bars.items()
        if bar != stored.bars[key]
    }
    if is_hashed and not changed:
        return ["nothing to renew: checked, and its hash is that of its contents"]
    changes = [*([] if is_hashed else [_HASH]), *([_BARS] if changed else [])]
    renewed = {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "palpate": version_of("palpate"),
        "changes": "; ".join(changes),
    }
    store(name, problem, references, {**references.provenance, "renewed": renewed}, path=path)
    motions = sum(state.trajectory is not None for state in references.states.values())
    accepted = describe_acceptance(references)
    return [
        f"checked: {len(references.states)} states, {len(references.bars)} error bars"
        + (f", {motions} motions" if motions else ""),
        *([] if is_hashed else ["added: its hash; fields and numbers are as they were"]),
        *(
            f"renewed: bar of {metric}, {strain} strain: {before:.3g}, now {now:.3g}"
            for (metric, strain), (before, now) in changed.items()
        ),
        *([f"kept: {accepted}"] if accepted else []),
    ]


def with_bars_of_today(references: ReferenceSet) -> ReferenceSet:
    """The same with those bars that follow from a record of adaptive meshes made anew from it.

    What was without a bar stays so: under forces on points, say, which the record does not tell.
    """
    kept = references.provenance.get(ADAPTIVE)
    bars: Bars = dict(references.bars)
    rows: dict[str, Any] = {}
    for strain in Strain:
        record = kept.get(strain.value) if isinstance(kept, dict) else None
        tables = record.get("metrics") if isinstance(record, dict) else None
        if not isinstance(tables, dict):
            continue
        for metric, bar in recorded_bars(tables).items():
            key = (metric, strain)
            if not math.isfinite(bars.get(key, math.inf)) or bar == bars[key]:
                continue
            parts = recorded(references.provenance, metric, strain, bars[key])
            now = dataclasses.replace(of_statics(bar), geometry=parts.geometry)
            bars[key] = bar
            rows |= as_record({key: now})
    if not rows:
        return references
    table = references.provenance.get(PARTS)
    provenance = dict(references.provenance)
    if isinstance(table, dict):
        provenance[PARTS] = table | {name: row for name, row in rows.items() if name in table}
    return dataclasses.replace(references, bars=bars, provenance=provenance)
