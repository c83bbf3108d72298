"""What a reader must know of the geometry part of error bars: whose it is, and where it is missing.

It is kept in a reference's provenance (`geometry_part`): files of before have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.meshes.problem import Strain
from palpate.validation.case import Case
from palpate.validation.references.bar_parts import GEOMETRY
from palpate.validation.references.sets import ReferenceSet
from palpate.validation.references.true_bodies import name_of_body, surface_key


def shape_of(references: ReferenceSet) -> str:
    """What the case's mesh is a polyhedron of, in words; empty where nothing is kept of it."""
    return str(_told(references).get("of", ""))


def _told(references: ReferenceSet) -> Mapping[str, Any]:
    told = references.provenance.get(GEOMETRY)
    return told if isinstance(told, dict) else {}


def geometry_notes(case: Case, references: ReferenceSet) -> list[str]:
    """What a reader must know of the geometry part: where it is missing, and why.

    Args:
        case: The case.
        references: Of the case, stored or solved here.
    """
    if not any(spec.against == "truth" for spec in case.checks):
        return []
    of, told, problem = name_of_body(case), _told(references), case.problem
    anew = f"`palpate reference build {case.name if case.is_builtin else case.path.name}`"
    notes = []
    if not of and case.spec.geometry.shape is None:
        notes.append(
            "The truth is that of this polyhedron: what its facets leave out of a curved body is "
            "in no bar; [truth] surface or geometry_distance in the case tells it."
        )
    elif of and "of" not in told and any(references.truth(strain) for strain in Strain):
        notes.append(
            f"This truth has no geometry part: what flat facets leave out of {of} is in no bar; "
            f"{anew} works it out."
        )
    elif of and "of" in told:
        if (told["of"], told.get("surface", "")) != (of, surface_key(case)):
            notes.append(
                f"The geometry part of this truth is of {told['of']} as it was when it was built, "
                f"and the case has {of} now: {anew} makes it anew."
            )
        notes += _notes_of_part(case, of, told)
    if problem.inclusions:
        notes.append(
            "Inclusions are the cells that the mesh gives them: how far those are from their true "
            "shape is in no bar."
        )
    return notes


def _notes_of_part(case: Case, of: str, told: Mapping[str, Any]) -> list[str]:
    failures, in_case_units = told.get("failures", {}), case.spec.units.in_case_units
    notes = [
        f"What {of} adds ({strain} strain) is not known: there {in_case_units(str(why))}"
        for strain, why in (failures.items() if isinstance(failures, dict) else ())
    ]
    notes = [note if note.endswith(".") else f"{note}." for note in notes]
    if case.problem.tools:
        notes.append(
            "Tools keep their paths in space: where the true surface is nearer, or farther, they "
            "press deeper or less, and that is in the geometry part."
        )
    if case.problem.time is not None and told.get("degree") == 1:
        notes.append(
            "The geometry part of this motion is from two runs of linear tetrahedra with "
            f"{told.get('steps_per_output')} steps from output to output: up to 15 % short, which "
            "its factor of safety makes good."
        )
    return notes
