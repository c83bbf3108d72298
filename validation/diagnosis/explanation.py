"""What an explanation is, and the rule by which one is named. Plain data.

An explanation is one slip that a simulator may have made. Undone, it leaves a residual: of the
answer against the reference, or of the altered equations at the points that are free. It is named
only where that residual is at most `DOUBLE` of its scale (`SINGLE` where numbers of single
precision can do no better) and at least `FAR_BETTER` times smaller than that of the problem as it
was stated, measured the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from palpate.meshes.problem import Element, Strain

# What solvers of double precision leave once they have converged, with room for loose ones.
DOUBLE = 1e-6
# Single precision: 6e-8, times the thousand that forces of a body that bends easily lose.
SINGLE = 1e-4
FAR_BETTER = 1e3
# Two answers of converged solvers: residuals of 1e-10, and what a soft body makes of them.
CONVERGED = 1e-8
# Fits this close to nothing are as good as each other.
_AS_GOOD = 1e-9
# Rounding: what is stated to less has nothing to explain.
_TINY = 1e-15

OF_DISPLACEMENT = "the reference's largest displacement"
OF_FORCE = "the largest nodal force"
OF_MOTION = "the largest displacement of the motion's start"
OF_TOOL_FORCE = "the reference's largest force on a tool"
OF_RELATION = "the largest displacement"


class Cause(StrEnum):
    """Where the slip was made."""

    AGREES = "none: the stated problem is solved"
    PRECISION = "precision"
    ANSWER = "answer"
    UNITS = "units"
    LAW = "law"
    MATERIAL = "material"
    LOAD = "load"
    SUPPORT = "support"
    TOOL = "tool"
    MASS = "mass"
    TIME = "time"


@dataclass(frozen=True)
class Explanation:
    """One explanation with what it leaves.

    Attributes:
        name: In words, as "displacement in millimetres".
        cause: Where the slip was made.
        residual: What is left when the slip is undone, in parts of `of`.
        stated: What the problem as stated leaves, in parts of the same.
        of: What residuals are divided by.
        complexity: 0 for the stated problem itself, 1 for a plain slip, more for fitted numbers.
        limit: What the residual may be at most: `SINGLE`, or what another mesh is off.
    """

    name: str
    cause: Cause
    residual: float
    stated: float
    of: str
    complexity: int = 1
    limit: float = SINGLE

    @property
    def fits(self) -> bool:
        """Whether it may be named."""
        if not math.isfinite(self.residual) or self.residual > self.limit:
            return False
        return self.complexity == 0 or FAR_BETTER * max(self.residual, _TINY) <= self.stated

    @property
    def is_single(self) -> bool:
        """Whether it fits to single precision only."""
        return self.residual > DOUBLE


@dataclass(frozen=True)
class Diagnosis:
    """What explains one answer of a candidate.

    Attributes:
        strain: Which of its answers.
        explanations: Those that fit, the simplest first; empty where none does.
        tested: How many were tried.
        stated: What the answer as it stands leaves, in parts of `of`.
        of: What `stated` was divided by.
        hint: A sentence on where the stated equations fail, or what could not be tried.
        element: What the answer's tetrahedra are.
    """

    strain: Strain
    explanations: tuple[Explanation, ...]
    tested: int
    stated: float
    of: str
    hint: str = ""
    element: Element = Element.LINEAR

    @property
    def title(self) -> str:
        """Which answer it is about, for people."""
        plain = f"{self.strain} strain"
        return plain if self.element is Element.LINEAR else f"{plain}, {self.element}"

    @property
    def first(self) -> Explanation | None:
        """The simplest that fits."""
        return self.explanations[0] if self.explanations else None

    def __str__(self) -> str:
        """One line for people."""
        best, *others = self.explanations or (None,)
        if best is None:
            line = (
                f"none of {self.tested} explanations fits" if self.tested else "nothing was tried"
            )
        elif best.complexity == 0:
            line = f"{best.name} ({best.residual:.1g} of {best.of})"
        else:
            line = (
                f"fits '{best.name}' to {best.residual:.1g} of {best.of}; as stated, "
                f"{best.stated:.2g} is left"
            )
            if best.is_single:
                line += f" ({'to single precision' if best.limit == SINGLE else 'meshes differ'})"
        shown = [f"'{other.name}'" for other in others[:3]]
        if shown:
            more = f" and {len(others) - 3} more" if len(others) > 3 else ""
            line += f"; {', '.join(shown)}{more} fit as well: this case cannot tell them apart"
        return line + (f". {self.hint}" if self.hint else "")


def choose(tried: Iterable[Explanation]) -> tuple[Explanation, ...]:
    """Those that fit, simplest first; without those that fit far worse than the best."""
    fitting = [each for each in tried if each.fits]
    # That the answer agrees is said only where nothing is found to be wrong with it.
    fitting = [each for each in fitting if each.complexity > 0] or fitting
    if not fitting:
        return ()
    best = min(each.residual for each in fitting)
    kept = [each for each in fitting if each.residual <= max(FAR_BETTER * best, _AS_GOOD)]
    unique: dict[str, Explanation] = {}
    for each in kept:
        unique.setdefault(each.name, each)
    return tuple(
        sorted(
            unique.values(), key=lambda e: (e.is_single, e.complexity, list(Cause).index(e.cause))
        )
    )
