"""A body in explicit motion, stepped from outside: eq. 11-13 with loads, supports and contact."""

from __future__ import annotations

import time
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.amplitudes import Amplitudes
from palpate.fastsim.body import Body
from palpate.fastsim.cell_classes import (
    choose_classes,
    one_class,
    require_damping,
    require_possible,
)
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.explicit_tools import TOOL_RECORD, TOOL_STEP, ExplicitTools
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.explicit_loads import ExplicitLoads, ExplicitSprings
from palpate.fastsim.explicit_run import make_run
from palpate.fastsim.explicit_time_step import (
    bound_step,
    critical_with_springs,
    divided,
    viscous_force,
)
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain

# Fraction of the critical step used if none is chosen: finite strain stiffens under stretch.
SAFETY = 0.8
# A displacement of more than this many sizes of the body is a blow-up, whatever its energy.
_BOUND_IN_SIZES = 1e3
# The core is left about so often, so that Ctrl-C works [s].
_BREATH = 0.5
_REASONS = {
    _core.StopReason.inverted_cell: "a cell inverted",
    _core.StopReason.out_of_bounds: "a displacement left all bounds",
    _core.StopReason.energy_growth: "energy grew from nothing",
    _core.StopReason.deep_in_tool: "a vertex moved so fast or deep that it may pass through a tool",
}


class Precision(StrEnum):
    """Arithmetic of the explicit step."""

    SINGLE = "float32"
    DOUBLE = "float64"


class ExplicitBody:
    """A body that is stepped by its caller: a loop, a viewer, a robot, a training run.

    Args:
        problem: Mesh, material, supports, loads and tools. Its time span, if any, sets the step,
            the damping and the spacing of outputs; without one there is no damping. Stiffness
            damping acts on the change of strain over the step before: see `viscous_force`.
        strain: Engineering or finite strain.
        element: Linear tetrahedra, plain or smoothed: nearer the truth on the same mesh.
        displacement: To start from; see `set_state`. None is rest.
        velocity: At the start; None is the problem's initial velocity.
        time_step: [s]; None takes the time span's, or 0.8 of the critical one, shortened so that
            a whole number makes an output.
        amplitude: Factor s(t) [-] on all loads, or one for each load; None takes each load's own,
            which is 1 from the start where it has none.
        support_amplitude: Such factors on the prescribed displacements of the supports.
        precision: Precision of the step; loads, states and energies are float64 all the same.
        num_threads: At least 1. A run repeats bit for bit for a given number.
        device: "cpu" is the compiled core; "cuda:0" a GPU and "warp:cpu" its kernels on the
            processor, which need the extra `gpu`; see `palpate.fastsim.gpu`.
        is_repeatable: On a device: sums in one order, bit for bit; else in any order.
        tracks_energy: Sum up work and losses at every step (slower).
        contact: How contact is enforced: None is the constraint; for force-driven tools, and over
            facets, a penalty.
        body_contact: A penalty for bodies that touch each other or themselves (the parts of the
            mesh); None lets them pass through each other.
        multirate: Steps of several lengths, where they save work: small cells make more of them
            than large ones; see `palpate.fastsim.cell_classes`, also for what it leaves out. One
            thread; contact of tools is then a penalty over facets.
        mass: Fictitious lumped mass [kg], shape (num_points,), for dynamic relaxation; the caller
            then sees to a stable time step. None is the material's.
        tools: Contact of the tools, prepared for that mass; None prepares it here.

    Attributes:
        elastic: The body at rest.
        time_step: [s].
        critical_time_step: With contact and stiffness damping [s]; of all classes of cells.
        classes: Classes of the cells; one without `multirate`.
        steps_per_output: Steps between two outputs of the time span; 1 without one.
        steps: Number of accepted time steps since the start.
        tools: The rigid tools; None without any.
        run: What makes the steps.

    Raises:
        InputError: A number of threads below 1, loads or supports that make no sense, or a device
            that is not there or cannot do this.
        UnstableStepError: The chosen step is above the critical one.
        ToolError: A tool is in the body at the start, slips between its vertices, or is faster
            than they can follow.

    Example:
        >>> import numpy as np
        >>> from palpate.fastsim.explicit_body import ExplicitBody
        >>> from palpate.meshes.boundary_conditions import Support
        >>> from palpate.meshes.problem import Material, Problem
        >>> from palpate.meshes.tet_mesh import TetMesh
        >>> mesh = TetMesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))
        >>> held = Support(np.array([0, 1, 2], dtype=np.int32))
        >>> body = ExplicitBody(Problem(mesh, Material(1e4, 0.3, 1000.0), (held,), ()))
        >>> body.apply_force([[0.0, 0.0, 5.0]], points=[3])
        >>> body.step(10)
        >>> bool(body.displacement[3, 2] > 0.0)
        True
    """

    def __init__(
        self,
        problem: Problem,
        *,
        strain: Strain = Strain.GREEN,
        element: Element = Element.LINEAR,
        displacement: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        time_step: float | None = None,
        amplitude: Amplitudes = None,
        support_amplitude: Amplitudes = None,
        precision: Precision = Precision.DOUBLE,
        num_threads: int = 1,
        device: str = "cpu",
        is_repeatable: bool = True,
        tracks_energy: bool = False,
        contact: ContactLaw | None = None,
        body_contact: ContactLaw | None = None,
        multirate: bool = False,
        mass: Floats | None = None,
        tools: ExplicitTools | None = None,
    ) -> None:
        if num_threads < 1:
            raise InputError(f"num_threads = {num_threads}: needs at least 1")
        mesh, span = problem.mesh, problem.time
        self.problem = problem
        self.elastic = Body.of(problem, strain, element=element)
        self._mass = self.elastic.lumped_mass if mass is None else mass
        self._loads = ExplicitLoads(problem, strain, amplitude, support_amplitude)
        chosen = span.time_step if time_step is None and span is not None else time_step
        is_timed = span is not None and mass is None
        self._stiffness_damping = span.stiffness_damping if span and is_timed else 0.0
        critical = np.inf
        if mass is None:
            critical = critical_with_springs(self.elastic, self._loads.springs, chosen)
        if multirate:
            require_possible(
                problem,
                self.elastic,
                slides=self._loads.slides,
                num_threads=num_threads,
                device=device,
                contact=contact,
                body_contact=body_contact,
                is_timed=mass is None,
            )
            contact = contact or ContactLaw(ContactForm.PENALTY)
        self.critical_time_step, self.tools, self._body_contact = bound_step(
            problem,
            self._mass,
            critical,
            time_step=None if multirate else chosen,
            stiffness_damping=self._stiffness_damping,
            contact=contact,
            body_contact=body_contact,
            tools=tools,
        )
        self.classes = one_class(mesh.num_cells, self.critical_time_step)
        if multirate:
            self.classes = choose_classes(
                problem,
                element,
                critical=critical,
                critical_with_contact=self.critical_time_step,
                time_step=chosen,
                safety=SAFETY,
            )
            self.critical_time_step = self.classes.critical_time_step
        if chosen is not None and chosen > self.critical_time_step:
            raise UnstableStepError(chosen, self.critical_time_step)
        wanted = SAFETY * self.critical_time_step if chosen is None else chosen
        self.time_step, self.steps_per_output = wanted, 1
        if span is not None and time_step is None:
            self.time_step, self.steps_per_output = divided(span, wanted)
        mass_damping = span.mass_damping if span and is_timed else 0.0
        if self._is_multirate and strain is Strain.GREEN:
            require_damping(mass_damping, self.time_step)
        self._scheme = _core.CentralDifference(self.time_step, mass_damping)
        self.run = make_run(
            problem,
            self.elastic,
            self._mass,
            self._loads.is_free,
            time_step=self.time_step,
            mass_damping=mass_damping,
            displacement_limit=_BOUND_IN_SIZES * float(np.ptp(mesh.points, axis=0).max()),
            is_single=precision is Precision.SINGLE,
            tracks_energy=tracks_energy,
            stiffness_damping=self._stiffness_damping,
            num_threads=num_threads,
            device=device,
            is_repeatable=is_repeatable,
            classes=self.classes.of_cells,
        )
        self._loads.attach(self.run)
        if self.tools is not None:
            self.tools.attach(self.run, self.time_step, is_timed=mass is None)
        if self._body_contact is not None:
            self._body_contact.attach(self.run)
        # The state as last read from the run, and the positions of tools at the last look.
        self._displacement, self._increment = np.zeros((2, *mesh.points.shape))
        self._read_only: Points = self._displacement.view()
        self._read_only.flags.writeable = False
        self._tool_steps: NDArray[np.void] = np.zeros(0, dtype=TOOL_STEP)
        self.steps = 0
        self._is_read, self._is_looked_at = True, False
        self._goals: dict[int, tuple[list[float], list[float] | None]] = {}
        self._pace = 1e-4
        if velocity is None and problem.initial_velocity is not None:
            velocity = problem.initial_velocity.at(mesh.points)
        at_rest = np.zeros_like(mesh.points)
        self.set_state(at_rest if displacement is None else displacement, velocity)

    @property
    def instruction_set(self) -> str:
        """Instruction set that the step uses."""
        return self.run.instruction_set

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.time_step

    @property
    def displacement(self) -> Points:
        """Present displacement [m], shape (num_points, 3).

        Read-only, and always the same array, which is updated when it is asked for after a step.
        """
        self._read()
        return self._read_only

    def _read(self) -> tuple[Points, Points]:
        """Displacement and the increment that led to it [m], always the same two arrays."""
        if not self._is_read:
            self.run.get_state(self._displacement, self._increment)
            self._is_read = True
        return self._displacement, self._increment

    def set_state(self, displacement: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Start from a state, at time 0 (eq. 13).

        Args:
            displacement: [m], shape (num_points, 3). Fixed components are where their supports
                are at once.
            velocity: [m/s], shape (num_points, 3); None is zero.

        Raises:
            InputError: Wrong shape, or a value that is not finite.
            ToolInsideError: A tool is in the body.
        """
        given = self.elastic.checked(displacement)
        placed = self._loads.placed(given, 0.0)
        speed = np.zeros_like(given)
        if velocity is not None:
            speed = self._loads.keep_free(self.elastic.checked(velocity))
        if self.tools is not None:
            self.tools.start(placed)
        # Eq. 13: a(-dt) = a - dt v + dt^2 / 2 a''.
        dt, mass = self.time_step, self._mass[:, None]
        energy = self.elastic.strain_energy(placed)
        energy += 0.5 * float(np.sum(mass * speed**2))
        self.steps = 0
        if self._is_multirate:
            self.run.set_state(placed, dt * speed, energy)
            force = self._force_of_step()
        else:
            force = self._net_force(self._loads.at(0.0, placed), placed, dt * speed)
        acceleration = force / mass - self._scheme.mass_damping * speed
        increment = self._loads.keep_free(dt * speed - 0.5 * dt**2 * acceleration)
        self._displacement[:], self._increment[:] = placed, increment
        self.run.set_state(self._displacement, self._increment, energy)
        self._is_read, self._is_looked_at = True, False

    def step(self, num_steps: int = 1) -> None:
        """Make steps of eq. 12.

        A cell that the last of them inverts is found by the next step, or by `look`.

        Raises:
            BlowUpError: A cell inverted (Green strain), a number left its bounds, a vertex may
                pass through a tool, or energy grew from nothing; carries the last good state.
            ToolTooFastError: A tool cannot get where it was sent in these steps.
        """
        self.send_tools(num_steps)
        while num_steps > 0:
            piece = min(num_steps, max(1, int(_BREATH / self._pace)))
            start = time.perf_counter()
            outcome = self.run.advance(*self.rows(piece))
            self._pace = max(time.perf_counter() - start, 1e-6) / piece
            self.moved(*outcome)
            num_steps -= piece

    def look(self) -> None:
        """Find all forces at the present state without a step; the next step then need not.

        Raises:
            BlowUpError: The last step inverted a cell.
        """
        if not self._is_looked_at:
            factors, tools = self.rows(1)
            outcome = self.run.look(factors, tools)
            self._is_looked_at = True
            self._count(*outcome)
            self._tool_steps = tools[0].view(TOOL_STEP)

    def apply_force(self, force: ArrayLike, *, points: ArrayLike | None = None) -> None:
        """Apply forces besides the problem's loads, from now on.

        They replace those applied before; zero removes them.

        Args:
            force: [N], shape (num_points, 3), or one row for each of `points`.
            points: Where they act; None is everywhere.

        Raises:
            InputError: Wrong shape, no such point, or a value that is not finite.
        """
        self._loads.apply(self.run, force, points)
        self._is_looked_at = False

    def move_tool(
        self, number: int, position: ArrayLike, rotation: ArrayLike | None = None
    ) -> None:
        """Send a tool elsewhere: it goes there during the next call of `step`, and stays.

        Args:
            number: Number of the tool, from 0.
            position: Position of its origin [m], shape (3,).
            rotation: Unit quaternion (w, x, y, z), shape (4,); None keeps the present one.

        Raises:
            InputError: There is no such tool, it is driven by a force, or this is no pose.
        """
        if self.tools is None:
            raise InputError(f"tool number {number}: the problem has no tools")
        self._goals[number] = self.tools.goal(number, position, rotation)

    @property
    def tool_goals(self) -> dict[int, tuple[list[float], list[float] | None]]:
        """Poses to which the next `step` sends tools: position [m], quaternion, by number."""
        return self._goals

    def send_tools(self, num_steps: int) -> None:
        """Give the tools that were sent elsewhere their paths for so many steps, as `step` does."""
        if not self._goals or self.tools is None:
            return
        goals, self._goals = self._goals, {}
        end = (self.steps + num_steps) * self.time_step
        self.tools.send(goals, self.time, end)
        self._is_looked_at = False

    @property
    def mass(self) -> Floats:
        """Lumped mass [kg], shape (num_points,)."""
        return self._mass

    @property
    def springs(self) -> ExplicitSprings:
        """Springs that act now."""
        return self._loads.springs

    def change_springs(self, springs: ExplicitSprings) -> None:
        """Replace the springs from now on; the caller checks that they are not too stiff."""
        self._loads.change_springs(self.run, springs)
        self._is_looked_at = False

    def tool_steps(self) -> NDArray[np.void]:
        """Present poses on the tools' paths, shape (num_tools,) of `TOOL_STEP`."""
        self.look()
        return self._tool_steps

    def take_tool_records(self) -> NDArray[np.void]:
        """Loads on the tools, shape (num_tools,) of `TOOL_RECORD`; impulses restart from zero."""
        self.look()
        return self.run.take_tool_records().view(TOOL_RECORD).reshape(-1)

    def energies(self) -> tuple[float, float, float]:
        """Kinetic energy, external work and damping loss so far [J]; zero if not tracked."""
        self.look()
        return self.run.energies()

    def self_overlap(self) -> tuple[int, float]:
        """Vertices of the body inside its own cells, and the deepest [m]."""
        self.look()
        return self.run.self_overlap()

    def velocity(self) -> Points:
        """Central velocity at the present state [m/s]: the mean of the two increments."""
        increment = self._read()[1]
        force = self._force_of_step() if self._is_multirate else self.force()
        ahead = self._scheme.next_increments(increment, self._mass, force)
        ahead = self._loads.moved(ahead, self.time, self.time + self.time_step)
        return (increment + ahead) / (2.0 * self.time_step)

    @property
    def _is_multirate(self) -> bool:
        return len(self.classes.counts) > 1

    def _force_of_step(self) -> Points:
        """What the next step of several classes takes for `force` [N]: their mean over it."""
        assert isinstance(self.run, _core.ExplicitRun)
        self._is_looked_at = False
        self.look()
        force: Points = np.empty_like(self._displacement)
        self.run.get_net_force(force)
        return force

    def load(self) -> Points:
        """All loads F(t) at the present state, pressure and tools included [N], (num_points, 3)."""
        load: Points = self._loads.at(self.time, self._read()[0])
        if self.tools is not None or self._body_contact is not None:
            self.look()
            touching = np.empty_like(load)
            self.run.get_contact_force(touching)
            load += touching
        return load

    def force(self) -> Points:
        """Loads minus internal force, F(t) - R(a), at the present state [N].

        That of stiffness damping is in R(a).
        """
        return self._net_force(self.load(), *self._read())

    def _net_force(self, load: Points, displacement: Points, increment: Points) -> Points:
        """F - R(a) [N] of loads F, displacement a and the increment that led to it."""
        force: Points = load - self.elastic.internal_force(displacement)
        if self._stiffness_damping:
            factor = self._stiffness_damping / self.time_step
            force -= viscous_force(self.elastic, displacement, increment, factor)
        return force

    def set_mass_damping(self, mass_damping: float) -> None:
        """Change D = mass_damping M from here on [1/s]."""
        self._scheme = _core.CentralDifference(self.time_step, mass_damping)
        self.run.set_mass_damping(mass_damping)
        self._is_looked_at = False

    def moved(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Record `steps_done` that `run` has made; raises as `step` does.

        `reason` and `point`, as returned by the core's run, state what ended them, and where.
        """
        self._is_read = self._is_looked_at = False
        self._count(steps_done, reason, point)

    def _count(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Count the steps of a call of the run; raise if something ended them early."""
        self.steps += steps_done
        if reason is not _core.StopReason.none:
            self._is_read = False
            raise self._blow_up(reason, point)

    def _blow_up(self, reason: _core.StopReason, point: int) -> BlowUpError:
        """The error that states what happened, in which cell, and what to change."""
        body, mesh = self.elastic, self.elastic.mesh
        displacement, increment = self._read()
        smallest, cell = body.smallest_det_f(displacement)
        if reason is _core.StopReason.inverted_cell:
            # The bad state is one increment ahead of the last good one.
            cell = body.smallest_det_f(displacement + increment)[1]
        elif point >= 0:
            cell = int(np.flatnonzero((mesh.cells == point).any(axis=1))[0])
        return BlowUpError(
            _REASONS[reason],
            step=self.steps,
            time=self.time,
            cell=cell,
            position=tuple(float(x) for x in mesh.points[mesh.cells[cell]].mean(axis=0)),
            smallest_det_f=smallest,
            displacement=displacement.copy(),
            time_step=self.time_step,
            critical_time_step=body.critical_time_step(displacement=displacement, mass=self._mass),
            folds=body.folds and reason is _core.StopReason.inverted_cell,
        )

    def rows(self, num_steps: int) -> tuple[Points, Points]:
        """Factors of the histories and steps of the tools, before each step and after the last."""
        times = self.time_step * (self.steps + np.arange(num_steps + 1))
        factors = self._loads.factors(times)
        if self.tools is None:
            return factors, np.empty((num_steps + 1, 0))
        return factors, self.tools.rows(times)
