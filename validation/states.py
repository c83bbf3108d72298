"""Plain data that all parts of the judge exchange: solutions, motions, verdicts, exit codes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.temporaries import atomic_path
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.schemes import Steps

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid

# The name of the simulator in the reference's states, with which their labels begin.
REFERENCE = "reference"
# Called with a line of text from time to time by functions that take long.
Progress: TypeAlias = Callable[[str], None]


def in_silence(_line: str) -> None:
    """Report no progress."""


class CandidateFailedError(RuntimeError):
    """The candidate gave no usable solution; the message says why.

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
    """How a command ends, the same for every verb; a signal ends it with 128 plus its number.

    Each has its `meaning`.
    """

    meaning: str

    PASSED = 0, "every check passed"
    FAILED = 1, "a check failed, or the simulator: diverged, crashed, NaN, out of time"
    UNUSABLE_INPUT = 2, "unusable input: a bad case or file, a missing or stale reference"
    INCONCLUSIVE = 3, "inconclusive: no result of the reference, or too wide an error bar"
    INTERNAL_ERROR = 4, "an internal error of palpate: never a verdict"

    def __new__(cls, value: int, meaning: str) -> ExitCode:
        """Make a code from its number and its meaning in one line."""
        code = int.__new__(cls, value)
        code._value_ = value
        code.meaning = meaning
        return code


class Method(StrEnum):
    """How fastsim finds equilibrium: by Newton's method, or by explicit steps until it rests.

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
        """The elements one by one."""
        return tuple(Element) if self is Elements.BOTH else (Element(self.value),)


class Precision(StrEnum):
    """The precision that a solution may be computed in; double, unless single is granted."""

    SINGLE = "single"
    DOUBLE = "double"


def gravest(verdicts: Sequence[Verdict]) -> Verdict:
    """The worst: failed before inconclusive before passed; only skipped ones are inconclusive."""
    for verdict in (Verdict.FAILED, Verdict.INCONCLUSIVE, Verdict.PASSED):
        if verdict in verdicts:
            return verdict
    return Verdict.INCONCLUSIVE


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Displacement over time: times [s], (num_times,); displacements [m], (num_times, n, 3).

    `problem` is what was solved, of `palpate.solve` and `palpate.simulate`.

    >>> import palpate
    >>> motion = palpate.solve(palpate.load_case("block-motion").problem).trajectory
    >>> len(motion.times), float(motion.times[-1])
    (51, 0.5)
    """

    times: Points
    displacements: NDArray[np.float64]
    problem: Problem | None = None

    def animate(self, path: str | Path, *, seconds: float = 4.0) -> Path:
        """Write it as an animated picture by pyvista, coloured by the displacement.

        Args:
            path: A file, .gif; `IPython.display.Image(path)` shows it in a notebook.
            seconds: How long it plays, over and over [s], > 0, whatever the motion takes.

        Returns:
            The file, written whole or not at all.

        Raises:
            InputError: Another ending, no time, a motion that is not of `palpate.solve` or
                `simulate`, or pyvista is not installed.
        """
        from palpate.validation.report.pyvista_grid import animate

        if self.problem is None:
            raise InputError(
                "this motion does not know its problem: take the trajectory of palpate.simulate"
            )
        return animate(self.problem, self.displacements, Path(path), seconds)


@dataclass(frozen=True, eq=False)
class OwnMesh:
    """A solution on a mesh of the candidate's own.

    Attributes:
        mesh: The mesh at rest, points [m].
        displacements: [m], (num_times, mesh.num_points, 3); one state in statics.
        sent_stress: Cauchy stress that it sent for the last state [Pa], (mesh.num_cells, 3, 3).
    """

    mesh: TetMesh
    displacements: NDArray[np.float64]
    sent_stress: Floats | None = None


@dataclass(frozen=True, eq=False)
class CellStresses:
    """Mean stresses of each cell of a mesh; they are symmetric, and tension is positive.

    A pressure is minus a third of a cell's trace. In smoothed tetrahedra pressures of nodes may
    alternate from node to node like a checkerboard: read the cells, not what a viewer computes
    from them at the nodes.

    Attributes:
        second_piola_kirchhoff: S, over the rest cell, in the rest frame [Pa], (num_cells, 3, 3).
        cauchy: sigma = F S F^T / det F [Pa], (num_cells, 3, 3); S itself under linear strain.
        first_piola_kirchhoff: P = F S [Pa], (num_cells, 3, 3), not symmetric; reference only.

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
        """Von Mises stress sqrt(3/2 s : s) [Pa], s the deviator of Cauchy stress, (num_cells,)."""
        pressure = np.trace(self.cauchy, axis1=1, axis2=2) / 3.0
        s = self.cauchy - pressure[:, None, None] * np.eye(3)
        stress: Floats = np.sqrt(1.5 * (s * s).sum(axis=(1, 2)))
        return stress


@dataclass(frozen=True, eq=False)
class StressIntegrals:
    """Stress on the case's mesh from a state that is quadratic or has a finer mesh.

    Attributes:
        cauchy: Mean Cauchy stress over each rest cell of the case [Pa], (num_cells, 3, 3).
        internal_force: Integral of P grad N over the body [N], (num_points, 3), N the linear shape
            functions of the case's points; sums to zero.
        strain_energy: Energy of the quadratic field itself [J]; None where it was not stored.
    """

    cauchy: Floats
    internal_force: Points
    strain_energy: float | None = None


@dataclass(frozen=True, eq=False)
class State:
    """One solution of a case, with the quantities that are judged.

    Attributes:
        label: Name for people: "fastsim", "reference P1", "reference smoothed", "reference P2".
        simulator: "fastsim", "reference", or the name of another simulator.
        strain: Strain measure.
        degree: Degree of the elements.
        displacement: [m], shape (num_points, 3), at the points of the case's mesh.
        volume: Deformed volume [m3].
        surface_area: Deformed area of the boundary [m2].
        smallest_det_f: Smallest det F of `displacement` [-].
        max_displacement: Largest displacement of a point in `displacement` [m].
        seconds: Time of the solve [s]; 0 where the state was stored.
        details: Iterations, residuals and the like; they are shown, and never judged.
        trajectory: In dynamic cases, at the case's output times; `displacement` is its last state.
        sent: In dynamic cases of an outside simulator, every state it sent from the start to the
            end, at its own times; where it sent none at the end, the last one is read there.
        other_reading: Where not all of the output times were sent, the same motion interpolated in
            another way between the sent states, at the points of the case's mesh; the distance of
            the two is the error of the reading.
        own: Where the candidate solved on a mesh of its own: that mesh, at the times of `sent`.
        tool_forces: Force on each tool [N]: (num_tools, 3) at the end of the path, or
            (num_tools, num_outputs + 1, 3), means from output to output.
        versions: Versions of the libraries that solved it, by name.
        says: What an outside candidate says of itself, its own words: they choose nothing; those
            on its equations are compared with what was asked for.
        remarks: What was done to compare the solution, or its limits, a sentence each.
        element: Its tetrahedra; for an outside simulator as the caller asks for.
        stresses: Stresses of each cell under `displacement`: fastsim's solutions and the
            reference's equilibria have them.
        integrals: Stresses of a reference whose displacement at the points does not give them.
        sent_stress: Cauchy stress that an outside simulator sent [Pa], (num_cells, 3, 3), for
            `displacement` and the case's cells.
        steps: Scheme and time step of a motion, as its simulator states them, or else as they were
            asked for; None where they are the case's own by central differences.
        problem: What was solved, of `palpate.solve` and `palpate.simulate`; it is what `plot` and
            `save` take the body from.

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
    problem: Problem | None = None

    def __repr__(self) -> str:
        """Its numbers in a line; the arrays would fill a notebook."""
        return (
            f"<State of {self.label}, {self.strain} strain: {len(self.displacement)} points, "
            f"largest displacement {self.max_displacement:.4g} m, volume {self.volume:.6g} m3, "
            f"surface area {self.surface_area:.6g} m2, smallest det F {self.smallest_det_f:.4g}>"
        )

    def grid(self, step: int = -1) -> UnstructuredGrid:
        """The body at an output time: see `palpate.to_pyvista`.

        Args:
            step: Number of the output time of a motion; the last one by default.

        Returns:
            Deformed points [m], with displacements and stresses as data.

        Raises:
            InputError: The state is not of `palpate.solve` or `simulate`, there is no such output
                time, or pyvista is not installed.
        """
        from palpate.validation.report.pyvista_grid import to_pyvista

        if self.problem is None:
            raise InputError(
                "this state does not know its problem: palpate.to_pyvista(problem, state) takes it"
            )
        return to_pyvista(self.problem, self, step=step)

    def plot(self, step: int = -1, **options: Any) -> Any:
        """Show it by pyvista, coloured by the displacement.

        Args:
            step: See `grid`, also for the errors.
            options: Of pyvista's `plot`, such as `off_screen`.

        Returns:
            What pyvista's `plot` does.
        """
        from palpate.validation.report.pyvista_grid import BAR

        bar = BAR if "scalars" in options else {**BAR, "title": "displacement [m]"}
        asked = {"scalars": "displacement", "show_edges": True, "scalar_bar_args": bar, **options}
        return self.grid(step).plot(**asked)

    def save(self, path: str | Path, step: int = -1) -> Path:
        """Write it for ParaView, whole or not at all.

        Args:
            path: A file, .vtu.
            step: See `grid`, also for the other errors.

        Returns:
            The file.

        Raises:
            InputError: Another ending.
        """
        target = Path(path)
        if target.suffix.lower() != ".vtu":
            raise InputError(f"{target}: a state is saved as .vtu")
        grid = self.grid(step)
        with atomic_path(target) as temporary:
            grid.save(temporary)
        return target

    @property
    def displacements(self) -> NDArray[np.float64]:
        """Displacement at each output time [m], (num_times, num_points, 3); one in statics."""
        motion = self.trajectory
        return self.displacement[None] if motion is None else motion.displacements

    @property
    def given(self) -> Trajectory | None:
        """The motion as it was sent, or at the output times if it was not; None in statics."""
        return self.sent or self.trajectory

    @property
    def fields(self) -> list[NDArray[np.float64]]:
        """Every displacement of the state [m], in whichever way it was given."""
        motions = [motion for motion in (self.trajectory, self.sent) if motion is not None]
        own = [] if self.own is None else [self.own.displacements]
        return [self.displacement, *(motion.displacements for motion in motions), *own]

    @property
    def is_reference(self) -> bool:
        """Whether the reference solved it; no candidate has its name (`candidate_name`)."""
        return self.simulator == REFERENCE
