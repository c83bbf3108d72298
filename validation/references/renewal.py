"""A stored reference of version 0.1, taken over: checked, and written again with its hash."""

from __future__ import annotations

import datetime
from pathlib import Path

from palpate.meshes.problem import Problem
from palpate.validation.references.reference_files import read_reference
from palpate.validation.references.stored import describe_acceptance, load_checked, store
from palpate.validation.versions import version_of


def renew_reference(path: Path, name: str, problem: Problem, called: str = "") -> list[str]:
    """Check an accepted reference as far as it can be, and add a hash if it has none.

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
    references = load_checked(path, name, problem, called, thoroughly=True, needs_hash=False)
    if read_reference(path)[2]:
        return ["nothing to renew: checked, and its hash is that of its contents"]
    renewed = {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "palpate": version_of("palpate"),
        "changes": "hash added to a file of version 0.1; fields, numbers and bars as they were",
    }
    store(name, problem, references, {**references.provenance, "renewed": renewed}, path=path)
    motions = sum(state.trajectory is not None for state in references.states.values())
    accepted = describe_acceptance(references)
    return [
        f"checked: {len(references.states)} states, {len(references.bars)} error bars"
        + (f", {motions} motions" if motions else ""),
        "added: its hash; fields, numbers and bars are as they were",
        *([f"kept: {accepted}"] if accepted else []),
    ]
