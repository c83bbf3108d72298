"""States of another element on the case's mesh, put beside what is there.

What was accepted stays as it is, with who accepted it; the addition waits like anything that was
built, and is accepted with a reason of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.references.changes import is_same_state
from palpate.validation.references.motion_runs import solve_reference
from palpate.validation.references.sets import OF_ELEMENT, ReferenceSet
from palpate.validation.states import Progress

_ADDED = "added"


def with_element(
    problem: Problem,
    accepted: ReferenceSet,
    element: Element,
    about: Mapping[str, Any],
    progress: Progress,
) -> ReferenceSet:
    """Accepted references with an element's states on the same mesh, solved here.

    Args:
        problem: Of the case.
        accepted: Its references as they are.
        element: Whose states are solved, with both strain measures.
        about: Who builds them and when, for the provenance.
        progress: Called with one line now and then.

    Raises:
        InputError: A motion without a stated step has no steps to be equal to.
        ReferenceFailedError: No FEniCSx, or a solve failed.
    """
    label = OF_ELEMENT[element]
    solved = {s: solve_reference(problem, s, 1, progress, element=element) for s in Strain}
    versions = next((dict(state.versions) for state in solved.values() if state.versions), {})
    added = {**additions(accepted), element.value: {**about, "versions": versions}}
    words = f"{element} tetrahedra on the case's mesh beside them"
    return dataclasses.replace(
        accepted,
        states={**accepted.states, **{(label, s): state for s, state in solved.items()}},
        origin=accepted.origin if words in accepted.origin else f"{accepted.origin}; {words}",
        provenance={**accepted.provenance, _ADDED: added},
    )


def additions(references: ReferenceSet) -> dict[str, Mapping[str, Any]]:
    """What was added to references, by element; empty where nothing was."""
    added = references.provenance.get(_ADDED)
    known = dict(added) if isinstance(added, Mapping) else {}
    return {element: known[element] for element in Element if element in known}


def waiting(references: ReferenceSet) -> list[str]:
    """Elements that were added to references and nobody has accepted yet."""
    return [what for what, about in additions(references).items() if "accepted" not in about]


def accept_additions(references: ReferenceSet, acceptance: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance with an acceptance at every addition that waits for one."""
    new = {e: {**additions(references)[e], "accepted": acceptance} for e in waiting(references)}
    return {**references.provenance, _ADDED: {**additions(references), **new}}


def altered_beside(accepted: ReferenceSet, built: ReferenceSet) -> list[str]:
    """States and bars that are not as they were accepted, but for the additions that wait."""
    new = {OF_ELEMENT[Element(what)] for what in waiting(built)}
    places = {place for place in {*accepted.states, *built.states} if place[0] not in new}
    altered = [
        f"{label}, {strain} strain"
        for label, strain in sorted(places)
        if not is_same_state(
            accepted.states.get((label, strain)), built.states.get((label, strain))
        )
    ]
    if dict(accepted.bars) != dict(built.bars):
        altered.append("error bars")
    return altered
