"""Dynamics by central differences with a lumped mass: eq. 11-13 of the paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.amplitudes import Amplitudes
from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.explicit_tools import ToolTrack
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain


@dataclass(frozen=True, eq=False)
class Energies:
    """Energies at the output times [J], each of shape (num_outputs + 1,).

    Their balance strain + kinetic + damping_loss - external_work stays at its first value up to
    the error of the time steps. Strain energy is integrated from psi(F), not from work; external
    work counts dead loads, follower pressure and supports that move.
    """

    strain: Floats
    kinetic: Floats
    external_work: Floats
    damping_loss: Floats

    @property
    def balance(self) -> Points:
        """The sum that stays constant [J], shape (num_outputs + 1,)."""
        return self.strain + self.kinetic + self.damping_loss - self.external_work


@dataclass(frozen=True, eq=False)
class DynamicResult:
    """A trajectory.

    Attributes:
        times: [s], shape (num_outputs + 1,), from 0.
        displacements: [m], shape (num_outputs + 1, num_points, 3).
        velocity: At the last time [m/s], shape (num_points, 3).
        time_step: [s].
        critical_time_step: [s].
        num_steps: Number of time steps.
        energies: Energies, if they were tracked; else None.
        instruction_set: Instruction set that the step used.
        classes: Number of cells and step [s] of each class of cells.
        tools: Positions of each tool, and the loads on it.
    """

    times: Floats
    displacements: Floats
    velocity: Points
    time_step: float
    critical_time_step: float
    num_steps: int
    energies: Energies | None = None
    instruction_set: str = ""
    classes: tuple[tuple[int, float], ...] = ()
    tools: tuple[ToolTrack, ...] = ()


def simulate(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    displacement: Points | None = None,
    velocity: Points | None = None,
    amplitude: Amplitudes = None,
    support_amplitude: Amplitudes = None,
    precision: Precision = Precision.DOUBLE,
    num_threads: int = 1,
    device: str = "cpu",
    tracks_energy: bool = False,
    contact: ContactLaw | None = None,
    body_contact: ContactLaw | None = None,
    multirate: bool = False,
    progress: Callable[[str], None] | None = None,
) -> DynamicResult:
    """Run the explicit scheme over the problem's time span.

    M a'' + D a' + R(a) = s(t) F with lumped M and D = mass_damping M (eq. 11), by eq. 12
    (corrected: see core/explicit/central_difference.hpp) from the start-up value of eq. 13.
    Stiffness damping adds the forces of a viscous stress to R: see `viscous_force`.

    Args:
        problem: With `time` set; its `time_step` None takes 0.8 of the critical one, which
            stiffness damping shortens.
        strain: Engineering or finite strain.
        element: Linear tetrahedra, plain or smoothed: nearer the truth on the same mesh.
        displacement: Initial [m], shape (num_points, 3); None is rest. Fixed components are where
            their supports are from the start.
        velocity: Initial [m/s], shape (num_points, 3); None is zero.
        amplitude: Factor s(t) [-] on all loads, or one for each load; None takes each load's own,
            which is 1 from the start where it has none. Evaluated up to one step beyond the end.
        support_amplitude: Such factors on the prescribed displacements of the supports.
        precision: Precision of the step; loads, states and energies are float64 all the same.
        num_threads: At least 1. A run repeats bit for bit for a given number.
        device: "cpu" is the compiled core; for others see `ExplicitBody`.
        tracks_energy: Sum up work and losses at every step (slower).
        contact: How contact is enforced: None is the constraint; for force-driven tools, and over
            facets, a penalty.
        body_contact: A penalty for bodies that touch each other or themselves (the parts of the
            mesh); None lets them pass through each other.
        multirate: Steps of several lengths, where they save work; see `ExplicitBody`.
        progress: Called with one line per stored state.

    Returns:
        The trajectory; every number in it is finite.

    Raises:
        InputError: No time span, or arrays of the wrong shape.
        UnstableStepError: The chosen step is above the critical one.
        ToolError: A tool is in the body at the start, slips between its vertices, or is faster
            than they can follow.
        BlowUpError: A cell inverted (Green strain), a number left its bounds, or energy grew
            from nothing; carries the last good state.
    """
    span = problem.time
    if span is None:
        raise InputError("a dynamic run needs a time span; add [time] to the case")
    body = ExplicitBody(
        problem,
        strain=strain,
        element=element,
        displacement=displacement,
        velocity=velocity,
        amplitude=amplitude,
        support_amplitude=support_amplitude,
        precision=precision,
        num_threads=num_threads,
        device=device,
        tracks_energy=tracks_energy,
        contact=contact,
        body_contact=body_contact,
        multirate=multirate,
    )
    recorder = Recorder(body, tracks_energy=tracks_energy)
    for output, now in enumerate(recorder.times):
        if output > 0:
            body.step(body.steps_per_output)
        recorder.record(output)
        if progress and output > 0:
            progress(f"t = {now:.4g} s of {span.end_time:.4g} s")
    return recorder.result()


class Recorder:
    """Records states, energies and tools of a run at its output `times` [s], from 0."""

    def __init__(self, body: ExplicitBody, *, tracks_energy: bool) -> None:
        span = body.problem.time
        assert span is not None
        self._body, self._tracks_energy = body, tracks_energy
        self.times = span.end_time / span.num_outputs * np.arange(span.num_outputs + 1)
        self._displacements = np.empty((len(self.times), *body.problem.mesh.points.shape))
        self._energies: list[tuple[float, float, float]] = []
        self._tool_steps: list[NDArray[np.void]] = []
        self._tool_records: list[NDArray[np.void]] = []

    def record(self, output: int) -> None:
        """Record the present state as that of an output.

        Raises:
            BlowUpError: The last step inverted a cell.
        """
        body = self._body
        body.look()
        self._displacements[output] = body.displacement
        self._energies.append(body.energies())
        self._tool_steps.append(body.tool_steps())
        self._tool_records.append(body.take_tool_records())

    def result(self) -> DynamicResult:
        """The trajectory, once all outputs are recorded."""
        body = self._body
        balance = None
        if self._tracks_energy:
            of_strain = np.array([body.elastic.strain_energy(u) for u in self._displacements])
            balance = Energies(of_strain, *np.array(self._energies).T)
        tracks: tuple[ToolTrack, ...] = ()
        if body.tools is not None:
            steps, records = np.array(self._tool_steps), np.array(self._tool_records)
            tracks = body.tools.tracks(self.times, steps, records)
        return DynamicResult(
            times=self.times,
            displacements=self._displacements,
            velocity=body.velocity(),
            time_step=body.time_step,
            critical_time_step=body.critical_time_step,
            num_steps=body.steps,
            energies=balance,
            instruction_set=body.instruction_set,
            classes=tuple(
                zip(body.classes.counts, body.classes.time_steps(body.time_step), strict=True)
            ),
            tools=tracks,
        )
