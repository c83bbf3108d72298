"""The reference solutions of a case: on its mesh by element, P2 for the truth, with error bars."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.metrics import Number, Part, is_stress_known, measure
from palpate.validation.references.bars import (
    NOISE,
    BarParts,
    name_of_part,
    recorded,
    saturated,
    without_limits,
)
from palpate.validation.states import State

SAME_MESH = "reference P1"
SMOOTHED = "reference smoothed"
QUADRATIC = "reference P2"
# P2 on finer meshes of the case's body.
TRUTH = "reference P2, refined"

# The references that checks are against.
BOTH = ("same_mesh", "truth")
# The reference on the case's mesh, by what its tetrahedra are.
OF_ELEMENT = {Element.LINEAR: SAME_MESH, Element.SMOOTHED: SMOOTHED}
# Numbers that every state carries.
SCALARS = ("volume", "surface_area", "smallest_det_f", "max_displacement")
# Relative: stresses of a stored truth are stored in single precision.
_STORED_TO = 2.0**-23

# A label and a strain measure.
StateKey = tuple[str, Strain]


@dataclass(frozen=True, eq=False)
class ReferenceSet:
    """States by (label, strain), and error bars by (metric, strain) relative to their scale.

    Attributes:
        states: On the same mesh and of degree 2; one that did not converge is missing.
        bars: Error bars of the truth.
        origin: One line on where this comes from.
        failures: Why a state is missing, by (label, strain).
        provenance: Versions and how it was made.
        element: The element whose states "the same mesh" means.
        aside: States of other elements on that mesh, which no candidate is compared with: error
            bars of the truth follow from them, whoever is judged.
        remarks: What a reader must know of its bars, a sentence each.
    """

    states: Mapping[StateKey, State]
    bars: Mapping[StateKey, float]
    origin: str
    failures: Mapping[StateKey, str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    element: Element = Element.LINEAR
    aside: Mapping[StateKey, State] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def of_element(self, element: Element) -> ReferenceSet:
        """The set for a candidate with this element: without the states of other elements."""
        others = [label for kind, label in OF_ELEMENT.items() if kind is not element]
        every = {**self.aside, **self.states}
        states = {key: state for key, state in every.items() if key[0] not in others}
        aside = {key: state for key, state in every.items() if key[0] in others}
        return replace(self, states=states, element=element, aside=aside)

    def with_same_mesh(
        self, strain: Strain, state: State | None, note: str, failure: str = ""
    ) -> ReferenceSet:
        """Another state on the case's mesh with the element, or why there is none.

        Args:
            strain: Its strain measure.
            state: Replaces the one that is there.
            note: A note on it for the reader of the verdict; left out where there is no state.
            failure: Why there is no state.
        """
        key = (OF_ELEMENT[self.element], strain)
        states = {known: other for known, other in self.states.items() if known != key}
        failures = {known: why for known, why in self.failures.items() if known != key}
        if state is None:
            return replace(self, states=states, failures=failures | {key: failure})
        states[key] = state
        return replace(self, states=states, failures=failures, remarks=(*self.remarks, note))

    def same_mesh(self, strain: Strain) -> State | None:
        """The state on the case's mesh with the element."""
        return self.states.get((OF_ELEMENT[self.element], strain))

    def truth(self, strain: Strain) -> State | None:
        """The best state there is: P2 on the refined mesh, else P2 on the case's mesh."""
        return self.states.get((TRUTH, strain)) or self.states.get((QUADRATIC, strain))

    def stress_truth(self, strain: Strain) -> State | None:
        """The truth where its stress is known, else P2 solved here; None where there is none."""
        truth, here = self.truth(strain), self.states.get((QUADRATIC, strain))
        if truth is not None and not is_stress_known(truth):
            return here if here is not None and here.stresses is not None else None
        return truth

    def bar_parts(self, metric: str, strain: Strain) -> BarParts:
        """The parts of a metric's error bar; infinite where it has none."""
        bar = self.bars.get((metric, strain), math.inf)
        return recorded(self.provenance, metric, strain, bar)

    def failure(self, against: str, strain: Strain) -> str:
        """Why a reference is missing; empty when it is not, or nobody knows."""
        label = QUADRATIC if against == "truth" else OF_ELEMENT[self.element]
        return self.failures.get((label, strain), "")

    def bar_of_part(self, problem: Problem, strain: Strain, metric: str, part: Part) -> float:
        """What the truth of a metric of a part may be off by, relative to the metric's scale [-].

        A stored truth, on adaptive meshes, has bars for the parts that the case's checks named when
        it was built: its meshes were refined for those. Where the truth is on the case's own mesh
        the bar is its difference from linear tetrahedra there: see `saturated`. Infinite where
        nothing bounds it.
        """
        linear, truth = self._linear(strain), self.stress_truth(strain)
        if truth is None or truth.label == TRUTH or linear is None:
            return self._stored_bar(name_of_part(metric, part), strain, truth)
        bar = saturated(measure(metric, problem, linear, truth, part).value) + NOISE
        return without_limits(problem, strain, {metric: bar}, truth)[metric]

    def bar_of_number(
        self,
        problem: Problem,
        strain: Strain,
        metric: str,
        name: str,
        read: Callable[[State], Number | None],
    ) -> float:
        """What a number of the truth's stresses or energy may be off by, over its scale [-].

        By the same rule, of the signed number itself. Infinite where a solution does not have it.

        Args:
            problem: The case's.
            strain: Strain measure.
            metric: Name of the metric.
            name: Name of the bar that a stored truth has for it.
            read: Function that returns the number of a state.
        """
        linear, truth = self._linear(strain), self.stress_truth(strain)
        if truth is None or truth.label == TRUTH or linear is None:
            return self._stored_bar(name, strain, truth)
        other, best = read(linear), read(truth)
        if other is None or best is None or not best.scale > 0.0:
            return math.inf
        size, apart = abs(best.value), abs(other.value - best.value)
        bar = saturated(apart / size) * size if size > 0.0 else apart
        bar = bar / best.scale + NOISE
        return without_limits(problem, strain, {metric: bar}, truth)[metric]

    def was_asked(self, strain: Strain, name: str) -> bool:
        """Whether a stored truth was asked for a bar; one that was solved here has any."""
        truth = self.stress_truth(strain)
        return truth is None or truth.label != TRUTH or (name, strain) in self.bars

    def _stored_bar(self, name: str, strain: Strain, truth: State | None) -> float:
        if truth is None or truth.label != TRUTH:
            return math.inf
        return self.bars.get((name, strain), math.inf) + _STORED_TO

    def _linear(self, strain: Strain) -> State | None:
        """Linear tetrahedra on the case's mesh, whoever is judged."""
        return {**self.aside, **self.states}.get((SAME_MESH, strain))
