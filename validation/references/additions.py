"""States of another element on the case's mesh, or the truth's stresses, put beside what is there.

What was accepted stays as it is, with who accepted it; the addition waits like anything that was
built, and is accepted with a reason of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.references.adaptive_truth import ADAPTIVE
from palpate.validation.references.changes import is_same_state
from palpate.validation.references.errors import StaleReferenceError
from palpate.validation.references.motion_runs import solve_reference
from palpate.validation.references.sequences import at_points_of
from palpate.validation.references.sets import (
    OF_ELEMENT,
    QUADRATIC,
    TRUTH,
    ReferenceSet,
    solve_state,
)
from palpate.validation.references.soundness import is_of_three
from palpate.validation.states import Progress

_ADDED = "added"
# What is added where it is no element's states.
STRESS = "stress"
# The truth is solved again for its stresses: to 1e-10 of its forces, and a body that bends shows a
# thousand times that.
_SAME = 1e-7


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


def with_stresses(
    problem: Problem,
    accepted: ReferenceSet,
    strains: Iterable[Strain],
    about: Mapping[str, Any],
    progress: Progress,
) -> ReferenceSet:
    """Accepted references with the stresses of their quadratic states, solved here once more.

    Args:
        problem: Of the case.
        accepted: Its references as they are, with a truth on a finer mesh.
        strains: Whose states are solved.
        about: Who builds them and when, for the provenance.
        progress: Called with one line now and then.

    Raises:
        InputError: A motion, or references without a truth on a finer mesh.
        ReferenceFailedError: No FEniCSx, or a solve failed.
        StaleReferenceError: What is solved here is not what was accepted.
    """
    if problem.time is not None:
        raise InputError("a motion's truth carries no stresses; leave --stress out")
    if ADAPTIVE in accepted.provenance:
        raise InputError(
            "a truth on adaptive meshes carries no stresses; check one of stress in the case and "
            "build the reference anew"
        )
    finest = refine_problem(problem)
    if is_of_three(accepted.provenance):
        finest = refine_problem(finest)
    states = dict(accepted.states)
    for strain in strains:
        for label, given in ((QUADRATIC, problem), (TRUTH, finest)):
            old = states.get((label, strain))
            if old is None:
                raise InputError(f"no {label} ({strain} strain) is stored; build the reference")
            new = at_points_of(problem.mesh, solve_state(given, strain, 2, progress), label)
            apart = float(np.abs(new.displacement - old.displacement).max())
            if not apart <= _SAME * old.max_displacement:
                raise StaleReferenceError(
                    f"{label} ({strain} strain) solved here is {apart:.3g} m from what was "
                    "accepted; build the whole reference anew"
                )
            states[label, strain] = dataclasses.replace(old, integrals=new.integrals)
    added = {**additions(accepted), STRESS: dict(about)}
    return dataclasses.replace(
        accepted, states=states, provenance={**accepted.provenance, _ADDED: added}
    )


def additions(references: ReferenceSet) -> dict[str, Mapping[str, Any]]:
    """What was added to references, by element or `STRESS`; empty where nothing was."""
    added = references.provenance.get(_ADDED)
    return dict(added) if isinstance(added, Mapping) else {}


def waiting(references: ReferenceSet) -> list[str]:
    """What was added to references and nobody has accepted yet: elements, or `STRESS`."""
    return [what for what, about in additions(references).items() if "accepted" not in about]


def accept_additions(references: ReferenceSet, acceptance: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance with an acceptance at every addition that waits for one."""
    new = {e: {**additions(references)[e], "accepted": acceptance} for e in waiting(references)}
    return {**references.provenance, _ADDED: {**additions(references), **new}}


def altered_beside(accepted: ReferenceSet, built: ReferenceSet) -> list[str]:
    """States and bars that are not as they were accepted, but for the additions that wait."""
    new = {OF_ELEMENT[Element(what)] for what in waiting(built) if what != STRESS}
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
