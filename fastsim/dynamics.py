"""Dynamics by central differences with a lumped mass: eq. 11-13 of the paper."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.amplitudes import Amplitudes, Histories
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import BodyContact
from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.explicit_tools import ExplicitTools, ToolTrack
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain

__all__ = [
    "DynamicResult",
    "Energies",
    "Precision",
    "simulate",
]

# Share of the critical step used when none is chosen: Green strain stiffens under stretch.
SAFETY = 0.8
# The steps are left about so often, for progress and Ctrl-C [s].
_BREATH = 0.5


@dataclass(frozen=True, eq=False)
class Energies:
    """Energies at the output times [J], each of shape (num_outputs + 1,).

    Their balance strain + kinetic + damping_loss - external_work stays at its first value up to
    the error of the time steps. Strain energy is integrated from psi(F), not from work; external
    work counts dead loads, follower pressure and supports that move.
    """

    strain: Points
    kinetic: Points
    external_work: Points
    damping_loss: Points

    @property
    def balance(self) -> Points:
        """What should not change [J], shape (num_outputs + 1,)."""
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
        num_steps: Steps done.
        energies: If asked for.
        instruction_set: What the step ran on.
        tools: What each tool did and felt.
    """

    times: Points
    displacements: Points
    velocity: Points
    time_step: float
    critical_time_step: float
    num_steps: int
    energies: Energies | None = None
    instruction_set: str = ""
    tools: tuple[ToolTrack, ...] = ()


def simulate(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    displacement: Points | None = None,
    velocity: Points | None = None,
    amplitude: Amplitudes = None,
    support_amplitude: Amplitudes = None,
    precision: Precision = Precision.DOUBLE,
    num_threads: int = 1,
    tracks_energy: bool = False,
    contact: ContactLaw | None = None,
    body_contact: ContactLaw | None = None,
    progress: Callable[[str], None] | None = None,
) -> DynamicResult:
    """Run the explicit scheme over the problem's time span.

    M a'' + D a' + R(a) = s(t) F with lumped M and D = mass_damping M, by eq. 12 (corrected: see
    core/mechanics/central_difference.hpp) from the start-up value of eq. 13.

    Args:
        problem: With `time` set; its `time_step` None takes 0.8 of the critical one.
        strain: Engineering or Green strain.
        displacement: Initial [m], shape (num_points, 3); None is rest. Held components are where
            their supports are from the start.
        velocity: Initial [m/s], shape (num_points, 3); None is zero.
        amplitude: Factor s(t) [-] on all loads, or one for each load; None takes each load's own,
            which is 1 from the start where it has none. Asked up to one step beyond the end.
        support_amplitude: The same for the prescribed displacements of the supports.
        precision: Of the step; loads, states and energies are float64 all the same.
        num_threads: At least 1. A run repeats bit for bit for a given number.
        tracks_energy: Sum up work and losses at every step (slower).
        contact: How tools are kept out: None is the constraint, for force-driven ones a penalty.
        body_contact: A penalty for bodies that touch each other or themselves (the parts of the
            mesh); None lets them pass through each other.
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
    span, mesh = problem.time, problem.mesh
    if span is None:
        raise InputError("a dynamic run needs a time span; add [time] to the case")
    if num_threads < 1:
        raise InputError(f"num_threads = {num_threads}: needs at least 1")
    elastic = Body.of(problem, strain)
    critical, mass = elastic.critical_time_step(), elastic.lumped_mass
    tools = None
    if problem.tools:
        tools = ExplicitTools(
            problem,
            contact,
            mass,
            critical_time_step=critical,
            time_step=span.time_step,
        )
        critical = tools.critical_time_step
    bodies = None
    if body_contact is not None:
        bodies = BodyContact(
            problem,
            body_contact,
            mass,
            critical_time_step=critical,
            time_step=span.time_step,
        )
        critical = bodies.critical_time_step
    if span.time_step is not None and span.time_step > critical:
        raise UnstableStepError(span.time_step, critical)
    wanted = span.time_step if span.time_step is not None else SAFETY * critical
    per_output = max(1, int(np.ceil(span.end_time / span.num_outputs / wanted * (1 - 1e-12))))
    body = ExplicitBody(
        problem,
        strain=strain,
        time_step=span.end_time / (span.num_outputs * per_output),
        mass_damping=span.mass_damping,
        histories=Histories(problem, amplitude, support_amplitude),
        precision=precision,
        num_threads=num_threads,
        tracks_energy=tracks_energy,
        tools=tools,
        body_contact=bodies,
    )
    zero = np.zeros_like(mesh.points)
    body.start(
        elastic.checked(zero if displacement is None else displacement),
        elastic.checked(zero if velocity is None else velocity),
    )
    states, rows = [body.displacement[None].copy()], [np.zeros((1, 3))]
    done = 0
    for new, energies in _outputs(body, span.num_outputs, per_output):
        states.append(new)
        rows = [*rows, energies[1:]] if done else [energies]
        done += len(new)
        if progress:
            now = done * span.end_time / span.num_outputs
            progress(f"t = {now:.4g} s of {span.end_time:.4g} s")
    displacements = np.concatenate(states)
    times = span.end_time / span.num_outputs * np.arange(span.num_outputs + 1)
    return DynamicResult(
        times=times,
        displacements=displacements,
        velocity=body.velocity(),
        time_step=body.dt,
        critical_time_step=critical,
        num_steps=body.steps,
        energies=_energies(body, displacements, np.concatenate(rows)) if tracks_energy else None,
        instruction_set=body.instruction_set,
        tools=() if tools is None else tools.tracks(times),
    )


def _outputs(
    body: ExplicitBody, num_outputs: int, per_output: int
) -> Iterator[tuple[Points, Points]]:
    """States and energies, several outputs at a time where they are quick, none where slow.

    How the steps are cut into calls changes no bit of the trajectory.
    """
    output, piece = 0, min(per_output, 64)
    while output < num_outputs:
        left, first = per_output, None
        while left > 0:
            if piece > per_output and left == per_output:
                count = min(piece // per_output, num_outputs - output)
                num_steps, every = count * per_output, per_output
            else:
                num_steps = every = min(piece, left)
            start = time.perf_counter()
            states, energies = body.advance(num_steps, every, is_output=left <= num_steps)
            pace = max(time.perf_counter() - start, 1e-6) / num_steps
            piece = max(1, int(_BREATH / pace))
            first = energies[:1] if first is None else first
            left -= min(num_steps, left)
        yield states, np.concatenate([first, energies[1:]])
        output += len(states)


def _energies(body: ExplicitBody, displacements: Points, rows: Points) -> Energies:
    strain = np.array([body.elastic.strain_energy(u) for u in displacements])
    return Energies(strain, *rows.T)
