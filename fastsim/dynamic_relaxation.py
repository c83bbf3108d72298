"""Static equilibrium by explicit steps: motion with fictitious masses, damped until it rests.

M a'' + c M a' + R(a) = F with dt = 1 and masses by Gershgorin's bound, so that every step is
stable: m_i = sum_j |K_ij| / 4 (P. Underwood, "Dynamic relaxation", in Computational Methods for
Transient Analysis, 1983). The damping is twice the frequency of what still moves, by Rayleigh's
quotient of the last increment,

    c = 2 omega,  omega^2 = du . (R(a + du) - R(a)) / du . M du,

which damps the lowest frequency critically once the others have died. No matrix is ever solved:
a step costs what a step of the dynamics costs, and their number grows with omega_max / omega_min.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.fastsim.amplitudes import smooth_ramp
from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.explicit_tools import ExplicitTools
from palpate.fastsim.contact.tool_contact import require_vertices
from palpate.fastsim.errors import BlowUpError, RelaxationFailedError
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.newton import rounding_error
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain, require_no_springs
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.rigid_tool import ToolPath
from palpate.meshes.spring import AnchorPath

# Steps between two looks at the residual, each with a force in double precision besides.
WINDOW = 50
# The load is raised over so many steps at first, and over four times as many at each new start.
_FIRST_RAMP = 500
_MOST_STARTS = 5
# omega_max is 2 by the choice of masses: above this part of it nothing is left to be damped.
_LARGEST_FREQUENCY = 0.5
# Finite strain stiffens under stretch; masses are this factor above their bound, and its next
# power at each new start.
_MASS_MARGIN = 1.3


@dataclass(frozen=True, eq=False)
class RelaxationResult:
    """A static equilibrium found by dynamic relaxation.

    Attributes:
        displacement: [m], shape (num_points, 3).
        strain: The strain measure used.
        steps: Explicit steps in all, those of lost starts included.
        relative_residual: Out-of-balance force over load or reactions [-].
        history: (steps, relative residual) at each look of the last start.
        smallest_det_f: Smallest det F of all cells [-].
        starts: Number of starts: 1, or more if one blew up.
        tool_forces: On each tool at the end [N], shape (num_tools, 3).
    """

    displacement: Points
    strain: Strain
    steps: int
    relative_residual: float
    history: tuple[tuple[int, float], ...]
    smallest_det_f: float
    starts: int
    tool_forces: Floats = field(default_factory=lambda: np.zeros((0, 3)))


def relax(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    relative_tolerance: float = 1e-10,
    max_steps: int = 1_000_000,
    num_threads: int = 1,
    device: str = "cpu",
    contact: ContactLaw | None = None,
    start: Points | None = None,
    progress: Callable[[str], None] | None = None,
) -> RelaxationResult:
    """Find R(a) = F (eq. 1) by dynamic relaxation.

    Tools go along their paths while the load is raised, and rest at their ends.

    Args:
        problem: Mesh, material, supports and loads; density and time are ignored.
        strain: Engineering or finite strain.
        element: Plain or smoothed.
        relative_tolerance: Residual over the load's norm, or the reactions' where supports move.
        max_steps: Largest number of steps before giving up.
        num_threads: At least 1.
        device: On which the steps are made; see `ExplicitBody`.
        contact: How contact is enforced: None is the constraint.
        start: A displacement from which the body comes to rest under the full load, with tools and
            anchors of springs where their paths end [m], shape (num_points, 3); None raises the
            load from the body at rest.
        progress: Called with one line now and then.

    Returns:
        The equilibrium; its relative residual is at most the tolerance, or the rounding error of
        the nodal forces where that is larger.

    Raises:
        InputError: A problem with springs, and no start.
        FacetContactError: The constraint over facets.
        UnsupportedBodyError: The body can float.
        RelaxationFailedError: It did not come to rest, or blew up at every start; carries the last
            good state. `palpate.fastsim.statics.solve_static` finds the load that can be borne.

    Note:
        Slender bodies take many steps: their number grows with the ratio of the highest to the
        lowest frequency, Newton's hardly does.
    """
    require_supported(problem)
    if start is None:
        require_no_springs(problem, "dynamic relaxation without a start")
    else:
        problem = _at_its_end(problem)
    if contact is None:  # motion would take its penalty, whose equilibrium is another
        require_vertices(
            problem.tools,
            "dynamic relaxation finds the constraint at vertices only, so solve by Newton's method",
        )
    run = _Relaxation(problem, strain, element, relative_tolerance, num_threads, device, contact)
    run.begin = start
    blown: BlowUpError | None = None
    ramp = _FIRST_RAMP
    for number in range(1, _MOST_STARTS + 1):
        try:
            result = run.start(ramp, _MASS_MARGIN**number, max_steps, progress)
        except BlowUpError as error:
            blown = error
            if progress:
                progress(f"start {number}: {error.reason} after {error.step} steps; slower again")
            ramp *= 4
            continue
        if result is None:
            break
        displacement, residual = result
        return RelaxationResult(
            displacement=displacement,
            strain=strain,
            steps=run.steps,
            relative_residual=residual,
            history=tuple(run.history),
            smallest_det_f=run.body.smallest_det_f(displacement)[0],
            starts=number,
            tool_forces=run.tool_forces,
        )
    raise RelaxationFailedError(
        f"{blown.reason} in cell {blown.cell} at every start"
        if blown
        else "it did not come to rest",
        steps=run.steps,
        residual=run.history[-1][1] if run.history else float("inf"),
        load_factor=smooth_ramp(ramp / 4.0)(blown.time) if blown else 1.0,
        displacement=run.last_good if blown is None else blown.displacement,
    )


def _in_full(time: float) -> float:
    """The load at all times [-]."""
    del time
    return 1.0


def _at_its_end(problem: Problem) -> Problem:
    """The problem with tools and anchors where their paths end, at all times."""
    tools, now = [], np.zeros(1)
    for tool in problem.tools:
        position, rotation = tool.path.positions[-1:], tool.path.rotations[-1:]
        tools.append(dataclasses.replace(tool, path=ToolPath(now, position, rotation)))
    springs = [
        dataclasses.replace(spring, path=AnchorPath(now, spring.path.end[None]), amplitude=None)
        for spring in problem.springs
    ]
    return dataclasses.replace(problem, tools=tuple(tools), springs=tuple(springs))


class _Relaxation:
    """One problem's masses and counts, over several starts.

    Attributes:
        begin: The displacement from which it comes to rest under the full load [m]; None raises
            the load from the body at rest.
    """

    begin: Points | None = None

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        element: Element,
        relative_tolerance: float,
        num_threads: int,
        device: str,
        contact: ContactLaw | None,
    ) -> None:
        self.steps = 0
        self.history: list[tuple[int, float]] = []
        self.last_good = np.zeros_like(problem.mesh.points)
        self._problem = problem
        self._strain = strain
        self._element = element
        self._tolerance = relative_tolerance
        self._num_threads, self._device = num_threads, device
        self._supports = FixedPoints(problem)
        self.body = Body.of(problem, strain, element=element)
        # Masses for which omega_max <= 2 at rest, the largest of each point's three.
        self.body.core.assemble_tangent(np.zeros_like(self.last_good))
        self._bound: Floats = 0.25 * self.body.core.absolute_row_sums().max(axis=1)
        # The rows of a spring have no negative entry.
        self._bound += 0.25 * PatchSprings(problem.mesh.points, problem.springs).row_sums()
        self._contact = contact
        self.tool_forces = np.zeros((len(problem.tools), 3))

    def start(
        self,
        ramp_steps: int,
        mass_factor: float,
        max_steps: int,
        progress: Callable[[str], None] | None,
    ) -> tuple[Points, float] | None:
        """Relax from rest, or from `begin`; None if the steps do not suffice.

        Raises:
            BlowUpError: A cell inverted on the way, or the body stiffened beyond its masses.
        """
        ramp = smooth_ramp(float(ramp_steps))
        if self.begin is not None:
            ramp, ramp_steps = _in_full, 0
        bound, tools = self._bound, None
        if self._problem.tools:
            tools = self._tools(ramp)
            bound = bound.copy()
            for touched, stiffness in tools.penalties:
                bound[touched.vertices] += 0.25 * stiffness * touched.areas
        mass = mass_factor * bound
        body = ExplicitBody(
            self._problem,
            strain=self._strain,
            element=self._element,
            displacement=self.begin,
            time_step=1.0,
            amplitude=ramp,
            support_amplitude=ramp,
            mass=mass,
            num_threads=self._num_threads,
            device=self._device,
            tools=tools,
        )
        self.history = []
        before, force_before = body.displacement.copy(), body.force()
        while self.steps < max_steps:
            try:
                body.step(WINDOW)
                body.look()
            except BlowUpError as error:
                self.steps += WINDOW
                self.last_good = error.displacement
                raise
            self.steps += WINDOW
            now, force = body.displacement.copy(), body.force()
            self.last_good = now
            is_loaded = body.steps >= ramp_steps
            scale = self._scale(body, force)
            relative = float(np.linalg.norm(self._supports.keep_free(force))) / scale
            self.history.append((body.steps, relative))
            if progress and len(self.history) % 20 == 0:
                progress(f"{body.steps} steps, relative residual {relative:.2e}")
            rounding = rounding_error(4.0 * self._bound[:, None], now) / scale
            if is_loaded and relative <= max(self._tolerance, 0.1 * rounding):
                if tools is not None:
                    self.tool_forces = body.take_tool_records()["force"].copy()
                return now, relative
            # While the load still grows the change of force is not the body's alone.
            if is_loaded:
                moved = self._supports.keep_free(now - before)
                mobile = float(np.sum(mass[:, None] * moved**2))
                stiffness = float(np.sum(moved * (force_before - force)))
                if mobile > 0.0 and stiffness > 0.0:
                    omega = min(np.sqrt(stiffness / mobile), _LARGEST_FREQUENCY)
                    body.set_mass_damping(2.0 * omega)
            before, force_before = now, force
        return None

    def _tools(self, ramp: Callable[[float], float]) -> ExplicitTools:
        """The tools, which go through the whole time of their paths while the load is raised."""
        times = np.concatenate([tool.path.times for tool in self._problem.tools])
        first, span = float(times.min()), float(np.ptp(times))
        return ExplicitTools(
            self._problem,
            self._contact,
            self._bound,
            critical_time_step=np.inf,
            time_step=1.0,
            clock=lambda steps: first + span * np.array([ramp(float(s)) for s in steps]),
        )

    def _scale(self, body: ExplicitBody, force: Points) -> float:
        """Norm of the load; of the reactions where supports move, or nothing else pushes."""
        scale = float(np.linalg.norm(body.load()))
        moves = any(support.is_moved for support in self._problem.supports)
        if moves or scale == 0.0:
            scale = max(scale, float(np.linalg.norm(self._supports.keep_held(force))))
        return max(scale, float(np.finfo(float).tiny))
