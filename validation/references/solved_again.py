"""Stored references beside the same ones solved here anew: what no hash can say of a file.

Whoever writes a file can write its hash too. States on the case's own mesh are solved again and
differ by rounding; the truth is solved within a budget, on coarser meshes than the stored one, and
differs by no more than the error bars of both together.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.meshes.problem import Element, Problem
from palpate.validation.metrics import measure
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.references.reference_set import OF_ELEMENT, QUADRATIC, ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.states import Progress, State, Verdict

# Relative, of one mesh. Both are solved to a residual of 1e-10; a thin body loses some digits.
SAME = 1e-6
_OF_TRUTH = ("displacement_l2", "displacement_max", "volume", "trajectory_l2")


@dataclass(frozen=True)
class Comparison:
    """A number of a stored state beside that of the same one solved anew.

    Attributes:
        name: State and metric.
        apart: Their difference, relative [-]; None where there is none to compare with.
        allowed: What rounding or both error bars allow.
        why: Why there is none.
    """

    name: str
    apart: float | None
    allowed: float = 0.0
    why: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether the stored state is what is solved here."""
        if self.apart is None:
            return Verdict.INCONCLUSIVE
        return Verdict.PASSED if self.apart <= self.allowed else Verdict.FAILED

    def __str__(self) -> str:
        """One line."""
        if self.apart is None:
            return f"{self.name}: not compared, {self.why}"
        sign = "<=" if self.verdict is Verdict.PASSED else ">"
        return f"{self.name}: {self.apart:.3g} from what is solved here {sign} {self.allowed:.3g}"


def compare_anew(
    problem: Problem,
    stored: ReferenceSet,
    request: TruthRequest,
    seconds: float,
    progress: Progress,
) -> list[Comparison]:
    """Solve all states of a file again, and compare.

    Args:
        problem: The case's.
        stored: Its stored references.
        request: What the case asks of its truth.
        seconds: Budget of each truth, and of each run of a motion [s], > 0.
        progress: Called with one line for each run.

    Raises:
        ReferenceUnavailableError: No FEniCSx here.
    """
    on_mesh = {label: element for element, label in OF_ELEMENT.items()}
    labels = {label for label, _ in stored.states}
    elements = [element for element in Element if OF_ELEMENT[element] in labels]
    strains = sorted({strain for _, strain in stored.states})
    truths = sorted({strain for label, strain in stored.states if label not in on_mesh})
    if problem.time is None:
        asked = dataclasses.replace(request, seconds=seconds)
        found = solve_live(problem, progress, elements=elements, request=asked, strains=strains)
    else:
        wanted = {"same_mesh" if label in on_mesh else "truth" for label in labels}
        found = solve_motion_set(
            problem, progress, wanted=wanted, elements=elements, strains=strains,
            truth_strains=truths, seconds=seconds,
        )  # fmt: skip
    compared = [
        _same(problem, state, found, metric)
        for (label, _), state in stored.states.items()
        if label in on_mesh or (label == QUADRATIC and problem.time is None)
        for metric in ("displacement_l2" if problem.time is None else "trajectory_l2",)
    ]
    for strain in truths:
        best, other = stored.truth(strain), found.truth(strain)
        assert best is not None
        if other is None:
            compared.append(_missing(best, found))
            continue
        compared += _truths(problem, stored, best, found, other)
    return compared


def _same(problem: Problem, state: State, found: ReferenceSet, metric: str) -> Comparison:
    """A state on the case's own mesh."""
    other = found.states.get((state.label, state.strain))
    if other is None:
        return _missing(state, found)
    name = f"{state.label}, {state.strain} strain, {metric}"
    return Comparison(name, measure(metric, problem, other, state).value, SAME)


def _truths(
    problem: Problem, stored: ReferenceSet, best: State, found: ReferenceSet, other: State
) -> Iterator[Comparison]:
    for metric in _OF_TRUTH:
        bars = [of.bars.get((metric, best.strain), math.inf) for of in (stored, found)]
        if math.isfinite(sum(bars)):
            difference = measure(metric, problem, other, best)
            name = f"truth, {best.strain} strain, {metric}"
            yield Comparison(name, difference.value, sum(bars) + difference.uncertainty + SAME)


def _missing(state: State, found: ReferenceSet) -> Comparison:
    why = [line for (_, strain), line in found.failures.items() if strain is state.strain]
    return Comparison(f"{state.label}, {state.strain} strain", None, why="; ".join(why) or "absent")
