"""What is shown beside what: the candidates of one strain, and a reference that each is held to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.colours import BLUE, GREEN, OCHRE, PURPLE, RED
from palpate.validation.states import State

STRAIN_NAMES = {Strain.LINEAR: "linear strain", Strain.GREEN: "Green strain"}
# Of candidates beside one another: linear tetrahedra red, smoothed ones blue, as in the studies.
_BESIDE = (RED, BLUE, PURPLE, GREEN, OCHRE)
# Least end of a scale of errors, in parts of the body's diagonal.
_LEAST_TOP = 1e-8


@dataclass(frozen=True, eq=False)
class Look:
    """Candidates and what they are held against.

    Attributes:
        strain: Of all of them.
        pairs: Each candidate's and its reference's number among the states of the result.
        is_truth: Whether the reference has elements of a higher degree, one for all candidates;
            else each candidate has that of its own tetrahedra on the same mesh.
    """

    strain: Strain
    pairs: tuple[tuple[int, int], ...]
    is_truth: bool

    @property
    def references(self) -> list[int]:
        """Their numbers, each once."""
        return list(dict.fromkeys(reference for _, reference in self.pairs))

    def name(self, states: Sequence[State]) -> str:
        """For a list to choose from."""
        strain = STRAIN_NAMES[self.strain]
        parts = [(states[one].label, states[other].label) for one, other in self.pairs]
        if len(parts) == 1:
            return f"{parts[0][0]}, {strain} with {parts[0][1]}"
        if self.is_truth:
            return f"{strain}: {' and '.join(one for one, _ in parts)} with {parts[0][1]}"
        return f"{strain}: " + ", ".join(f"{one} with {other}" for one, other in parts)


def looks_of(result: CaseResult) -> list[Look]:
    """Every candidate with its own same mesh and with each truth.

    A truth comes first, Green strain's where there is one; then Green strain before linear.
    """
    states = result.states
    found: dict[tuple[Strain, str], list[tuple[int, int]]] = {}
    for other, reference in enumerate(states):
        if not reference.is_reference:
            continue
        is_truth = reference.degree > 1
        against = reference.label if is_truth else ""
        for one, candidate in enumerate(states):
            if (
                not candidate.is_reference
                and candidate.strain is reference.strain
                and (is_truth or candidate.element is reference.element)
                and candidate.displacements.shape == reference.displacements.shape
            ):
                found.setdefault((candidate.strain, against), []).append((one, other))
    looks = [
        Look(strain, tuple(sorted(pairs)), bool(against))
        for (strain, against), pairs in found.items()
    ]
    # The finer truth has the longer name, and comes first.
    looks.sort(
        key=lambda look: (
            look.strain is not Strain.GREEN,
            not look.is_truth,
            -len(states[look.references[0]].label),
        ),
    )
    first = next((look for look in looks if look.is_truth), None)
    return sorted(looks, key=lambda look: look is not first)


def error_top(result: CaseResult, largest: float) -> float:
    """Where a scale of errors ends, in the unit of the largest: not below 1e-8 of the body's size.

    Else rounding errors would be painted like wrong answers.

    Args:
        result: With the mesh.
        largest: Error that is shown [m].
    """
    size = float(np.linalg.norm(np.ptp(result.problem.mesh.points, axis=0)))
    return max(largest, _LEAST_TOP * size)


def colours_of(result: CaseResult) -> dict[str, str]:
    """A colour for each candidate, by its label."""
    labels = list(dict.fromkeys(s.label for s in result.states if not s.is_reference))
    if len(labels) == 1:
        return {labels[0]: BLUE}
    return {label: _BESIDE[k % len(_BESIDE)] for k, label in enumerate(labels)}
