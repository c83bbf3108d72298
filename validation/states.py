"""What everybody in this room passes on: a solution, a motion, a verdict. Plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.schemes import Steps

# The simulator of the reference's states, and how their labels begin.
REFERENCE = "reference"
# Called with one line now and then by what takes time.
Progress: TypeAlias = Callable[[str], None]


def in_silence(_line: str) -> None:
    """Progress that nobody reads."""


class CandidateFailedError(RuntimeError):
    """The candidate gave no usable answer; the message says why.

    >>> import dataclasses
    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> jelly = palpate.Material(youngs_modulus=1.0, poissons_ratio=0.4)
    >>> try:
    ...     palpate.solve(dataclasses.replace(problem, material=jelly))
    ... except palpate.CandidateFailedError as error:
    ...     print(str(error)[:8])
    fastsim:
    """


class Verdict(StrEnum):
    """Outcome of a check or a case; only a check can be skipped, with a reason.

    >>> import palpate
    >>> palpate.Verdict("passed")
    <Verdict.PASSED: 'passed'>
    """

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    SKIPPED = "skipped"


class ExitCode(IntEnum):
    """How a command ends, the same for every verb; a signal ends it with 128 and its number.

    Each has its `meaning`.
    """

    meaning: str

    PASSED = 0, "every check passed"
    FAILED = 1, "a check failed, or the simulator: diverged, crashed, NaN, out of time"
    UNUSABLE_INPUT = 2, "unusable input: a bad case or file, a missing or stale reference"
    INCONCLUSIVE = 3, "inconclusive: no answer of the reference, or too wide an error bar"
    INTERNAL_ERROR = 4, "an internal error of palpate: never a verdict"

    def __new__(cls, value: int, meaning: str) -> ExitCode:
        """A code by its number, with one line on what it says."""
        code = int.__new__(cls, value)
        code._value_ = value
        code.meaning = meaning
        return code


class Method(StrEnum):
    """How fastsim looks for equilibrium: by Newton's method, or by explicit steps until it rests.

    >>> import palpate
    >>> palpate.Method("relaxation")
    <Method.RELAXATION: 'relaxation'>
    """

    NEWTON = "newton"
    RELAXATION = "relaxation"


class Elements(StrEnum):
    """Whose tetrahedra are judged: linear or smoothed ones, or both beside one another.

    >>> import palpate
    >>> palpate.Elements("both").each
    (<Element.LINEAR: 'linear'>, <Element.SMOOTHED: 'smoothed'>)
    """

    LINEAR = "linear"
    SMOOTHED = "smoothed"
    BOTH = "both"

    @property
    def each(self) -> tuple[Element, ...]:
        """One after the other."""
        return tuple(Element) if self is Elements.BOTH else (Element(self.value),)


class Precision(StrEnum):
    """In which numbers an answer may have been computed; double, unless somebody grants single."""

    SINGLE = "single"
    DOUBLE = "double"


def gravest(verdicts: Sequence[Verdict]) -> Verdict:
    """Failed before inconclusive before passed; nothing but skipped checks is inconclusive."""
    for verdict in (Verdict.FAILED, Verdict.INCONCLUSIVE, Verdict.PASSED):
        if verdict in verdicts:
            return verdict
    return Verdict.INCONCLUSIVE


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Displacement over time: times [s], (num_times,); displacements [m], (num_times, n, 3).

    >>> import palpate
    >>> motion = palpate.solve(palpate.load_case("block-motion").problem).trajectory
    >>> len(motion.times), float(motion.times[-1])
    (51, 0.5)
    """

    times: Points
    displacements: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OwnMesh:
    """An answer on a mesh of the candidate's own.

    Attributes:
        mesh: At rest, points [m].
        displacements: [m], (num_times, mesh.num_points, 3); one state in statics.
        sent_stress: Cauchy's stress that it sent of the last of them [Pa], (mesh.num_cells, 3, 3).
    """

    mesh: TetMesh
    displacements: NDArray[np.float64]
    sent_stress: Floats | None = None


@dataclass(frozen=True, eq=False)
class CellStresses:
    """Means over each cell of a mesh; symmetric, tension positive.

    A pressure is minus a third of a cell's trace. Smoothed tetrahedra's pressures of nodes may
    alternate from node to node like a checkerboard: read the cells, not what a viewer makes of
    them at the nodes.

    Attributes:
        second_piola_kirchhoff: S, over the rest cell, in the rest frame [Pa], (num_cells, 3, 3).
        cauchy: sigma = F S F^T / det F, likewise; S itself under linear strain.
        first_piola_kirchhoff: P = F S, likewise but not symmetric; of the reference only.

    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> stresses = palpate.solve(problem).stresses
    >>> stresses.cauchy.shape == (problem.mesh.num_cells, 3, 3)
    True
    """

    second_piola_kirchhoff: Floats
    cauchy: Floats
    first_piola_kirchhoff: Floats | None = None

    @property
    def von_mises(self) -> Floats:
        """sqrt(3/2 s : s) of Cauchy's stress [Pa], s its deviator, (num_cells,)."""
        pressure = np.trace(self.cauchy, axis1=1, axis2=2) / 3.0
        s = self.cauchy - pressure[:, None, None] * np.eye(3)
        stress: Floats = np.sqrt(1.5 * (s * s).sum(axis=(1, 2)))
        return stress


@dataclass(frozen=True, eq=False)
class StressIntegrals:
    """What a quadratic state, or one of a finer mesh, says of stress on the case's mesh.

    Attributes:
        cauchy: Mean of Cauchy's stress over each rest cell of the case [Pa], (num_cells, 3, 3).
        internal_force: Integral of P grad N over the body [N], (num_points, 3), N the linear shape
            functions of the case's points; sums to zero.
        strain_energy: Of the quadratic field itself [J]; None where it was not kept.
    """

    cauchy: Floats
    internal_force: Points
    strain_energy: float | None = None


@dataclass(frozen=True, eq=False)
class State:
    """One solution of a case, with the quantities that are judged.

    Attributes:
        label: For people: "fastsim", "reference P1", "reference smoothed", "reference P2".
        simulator: "fastsim", "reference", or the name of another.
        strain: Strain measure.
        degree: Degree of the elements.
        displacement: [m], shape (num_points, 3), at the points of the case's mesh.
        volume: Deformed volume [m3].
        surface_area: Deformed area of the boundary [m2].
        smallest_det_f: Of `displacement` [-].
        max_displacement: Largest displacement of a point in `displacement` [m].
        seconds: Time the solve took; 0 when stored.
        details: Iterations, residuals: shown to people, never judged.
        trajectory: In dynamic cases, at the case's output times; `displacement` is its last state.
        sent: In dynamic cases of an outside simulator, every state it sent from the start to the
            end, at its own times; where it sent none at the end, the last one is read there.
        other_reading: Where not all of the output times were sent: the same motion read between
            the states that were in another way, at the points of the case's mesh; how far apart
            the two are is what the reading may be off.
        own: Where the candidate answered on a mesh of its own: that mesh, at the times of `sent`.
        tool_forces: Force on each tool [N]: (num_tools, 3) at the end of the path, or
            (num_tools, num_outputs + 1, 3), means from output to output.
        versions: Of the libraries that solved it, by name.
        says: What an outside candidate says of itself: its words, never judged.
        remarks: What was done to the answer to compare it, or how far it holds, a sentence each.
        element: What its tetrahedra are; of an outside simulator what it says in its result.
        stresses: Of `displacement`, of each cell: fastsim's answers and the reference's equilibria
            have them.
        integrals: Of a reference that its displacement at the points does not tell the stress of.
        sent_stress: Cauchy's stress that an outside simulator sent [Pa], (num_cells, 3, 3), of
            `displacement` and the case's cells.
        steps: Of a motion: scheme and time step, as its simulator states them; None where it does
            not, or where they are the case's own by central differences.

    >>> import palpate
    >>> state = palpate.solve(palpate.load_case("block").problem)
    >>> state.label, state.smallest_det_f > 0.0
    ('fastsim', True)
    """

    label: str
    simulator: str
    strain: Strain
    degree: int
    displacement: Points
    volume: float
    surface_area: float
    smallest_det_f: float
    max_displacement: float
    seconds: float = 0.0
    details: Mapping[str, Any] = field(default_factory=dict)
    trajectory: Trajectory | None = None
    sent: Trajectory | None = None
    other_reading: State | None = None
    own: OwnMesh | None = None
    tool_forces: NDArray[np.float64] | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    says: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    element: Element = Element.LINEAR
    stresses: CellStresses | None = None
    integrals: StressIntegrals | None = None
    sent_stress: Floats | None = None
    steps: Steps | None = None

    @property
    def displacements(self) -> NDArray[np.float64]:
        """At each of the output times [m], (num_times, num_points, 3); once in statics."""
        motion = self.trajectory
        return self.displacement[None] if motion is None else motion.displacements

    @property
    def given(self) -> Trajectory | None:
        """The motion as it was sent, or else at the output times; None in statics."""
        return self.sent or self.trajectory

    @property
    def fields(self) -> list[NDArray[np.float64]]:
        """Every displacement in it [m], whichever way it was given."""
        motions = [motion for motion in (self.trajectory, self.sent) if motion is not None]
        own = [] if self.own is None else [self.own.displacements]
        return [self.displacement, *(motion.displacements for motion in motions), *own]

    @property
    def is_reference(self) -> bool:
        """Whether the reference solved it; no candidate is called so (`candidate_name`)."""
        return self.simulator == REFERENCE
