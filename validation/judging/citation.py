"""How a result is cited: everything it hangs on, with versions, in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import in_quotes

# Digits of the problem's hash that tell it from any other.
_KEY = 12
# Of the libraries of the reference, those whose versions its numbers depend on.
_LIBRARIES = ("dolfinx", "basix", "petsc")


def citation(result: CaseResult) -> str:
    """A line for a paper: palpate, case, simulator, reference with dolfinx, mesh and day.

    The version of an outside simulator is what it says itself, in quotes: nobody checked it.
    """
    about = result.provenance
    mesh: Mapping[str, Any] = about.get("mesh", {})
    reference: Mapping[str, Any] = about.get("reference", {})
    versions: Mapping[str, Any] = reference.get("versions") or {}
    said = result.candidate_says.get("version")
    simulator = result.candidate + (f" (says version {in_quotes(str(said))})" if said else "")
    libraries = ", ".join(f"{name} {versions[name]}" for name in _LIBRARIES if name in versions)
    built = f", built {reference['date']}" if "date" in reference else ""
    parts = [
        f"palpate {about.get('palpate', 'of unknown version')}, the palpate developers",
        f"case {result.name} (problem {str(about.get('case_key', 'unknown'))[:_KEY]})",
        f"simulator {simulator}",
        f"reference FEniCSx, {libraries}{built}" if libraries else "",
        f"mesh of {mesh['num_points']} points and {mesh['num_cells']} tetrahedra, {mesh['origin']}"
        if mesh
        else "",
        f"judged {str(about['time'])[:10]}" if "time" in about else "",
    ]
    return "; ".join(filter(None, parts)) + "."
