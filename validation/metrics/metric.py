"""What sets a metric apart: how it is measured, and what it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics import fields, numbers, own_mesh
from palpate.validation.metrics.pairs import Difference
from palpate.validation.metrics.stress import Part
from palpate.validation.states import State

Compare = Callable[[Problem, State, State], Difference]
CompareInPart = Callable[[Problem, State, State, Part], Difference]
Read = Callable[[Problem, State, Part, str], numbers.Number | None]


# Whose error bars are of stress and energy.
_OF_INTEGRALS = ("stress_l2", "traction_resultant", "strain_energy")


@dataclass(frozen=True)
class Metric:
    """One metric.

    Attributes:
        name: As in a case file.
        meaning: What it says, in one line.
        scale: What the error is divided by.
        compare: Candidate and reference to a relative error; None of one state alone.
        on_own_mesh: The same on a candidate's own mesh; None where it depends on no mesh.
        of_part: As `compare`, of a part of the body that a check names.
        own: Of the candidate alone.
        says: What was found and the limit, of the candidate alone.
        unit: Of the value.
        asks: Keys of a check that say which number is held against one of the case file, the
            candidate's or the truth's own; empty of what compares two states.
        read: That number; None of a displacement at a point, over time or at the end.
        components: Which `component` such a check may name.
        dimension: Of that number: "length", "force", "stress", "volume" or "energy".
        bar_of: Whose error bar the truth's number has.
        is_alone: On its own mesh, without what it is at the case's points.
        is_of_surface: Of a part: of a support or a cut, not of cells.
        is_fitted: To a motion, as good as its samples.
        is_lower_limit: The limit is the least that it may be, not the most.
        has_moving_truth: The truth of a motion is held to it: points over time, not integrals of
            the last state.
        needs_same_mesh: Judged against the reference on the same mesh only: a quadratic solution
            read at the points does not carry it.
        needs_time: For cases with [time] only.
        needs_tools: Of cases with tools only.
    """

    name: str
    meaning: str
    scale: str
    compare: Compare | None = None
    on_own_mesh: own_mesh.Measure | None = None
    of_part: CompareInPart | None = None
    own: Callable[[TetMesh, State], fields.Worst] | None = None
    says: str = ""
    unit: str = "-"
    asks: tuple[str, ...] = ()
    read: Read | None = None
    components: tuple[str, ...] = ()
    dimension: str = "length"
    bar_of: str = ""
    is_alone: bool = False
    is_of_surface: bool = False
    is_fitted: bool = False
    is_lower_limit: bool = False
    has_moving_truth: bool = False
    needs_same_mesh: bool = False
    needs_tools: bool = False
    needs_time: bool = False

    @property
    def is_published(self) -> bool:
        """Whether it is held against a number of the case file."""
        return bool(self.asks)

    @property
    def is_of_integrals(self) -> bool:
        """Whether a quadratic truth tells it by integrals that are kept beside its displacement."""
        return self.of_part is not None or self.bar_of in _OF_INTEGRALS

    @property
    def is_own(self) -> bool:
        """Whether it is of the candidate alone, without any number to compare with."""
        return self.own is not None

    @property
    def is_compared(self) -> bool:
        """Whether it is an error between two states."""
        return self.compare is not None or self.of_part is not None
