"""Static equilibrium on FEniCSx: the reference that other solvers are judged against."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_modes import require_supported
from palpate.meshes.rigid_tool import require_drive_of_statics
from palpate.reference import fenicsx
from palpate.reference.contact.tool_path import EXACT, follow_tools, go_on_at_end, press
from palpate.reference.deformed_state import (
    DetFSampler,
    find_smallest_stretch,
    least_modulus,
    measure_state,
    measure_stresses,
    support_forces,
)
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.reference.load_stepping import follow_load
from palpate.reference.mixed_form import MixedProblem
from palpate.reference.newton import Newton, Outcome
from palpate.reference.result import REMEDY_OF_YIELD, Formulation, ReferenceResult
from palpate.reference.tasks import Progress, say_nothing

_ON_THE_WAY = "on the way of the tools"
_SPENT = (
    "in cells of that state Saint-Venant-Kirchhoff has lost its resistance to compression, and "
    f"finer meshes yield there: {REMEDY_OF_YIELD}"
)


def solve_static(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    degree: int = 1,
    relative_tolerance: float = 1e-10,
    formulation: Formulation = Formulation.DISPLACEMENT,
    element: Element = Element.LINEAR,
    start: Points | None = None,
    progress: Progress | None = None,
) -> ReferenceResult:
    """Solve internal(u) = external(u) on the problem's own mesh.

    Green strain: the material's law under finite strain; the load is raised in adaptive steps, each
    solved by Newton's method, which does not invert a cell. Linear strain: one linear solve; a
    pressure then acts on the rest surface, and cells of the solution may be inverted.

    Args:
        problem: Mesh, material, supports, loads and tools. Time is ignored, except in the tools'
            paths: the loads are applied first, with the tools where their paths begin, and then
            the tools move to where their paths end.
        strain: Strain measure.
        degree: Polynomial degree of the displacement, 1 to 3. 1 is the same discretisation as
            other linear tetrahedra; 2 is the reference that these are judged against.
        relative_tolerance: Out-of-balance nodal forces over the external or internal ones [-],
            between 1e-14 and 1e-2.
        formulation: MIXED for Poisson's ratios of 0.49 and more; needs degree 2 or 3.
        element: SMOOTHED averages strains over edges and nodes; needs degree 1, and does not run
            under mpirun.
        start: Displacement at the mesh's points near an equilibrium [m], shape (num_points, 3).
            The equilibrium nearby is sought first, and is returned if it exists even where there
            are several. If there is none, or for None, the loads are raised from zero; not under
            tools where the law's least modulus there is not above 0 (see `least_moduli`) and
            equilibria are asked for less exactly than to 1e-8.
        progress: Called with one line of text now and then.

    Returns:
        The state under the full load; its displacement at the mesh's points, in their order.

    Raises:
        InputError: The problem cannot be used: too few supports, a tool driven by a force that is
            not the only tool, has friction or starts too near, values that are not finite,
            overlapping cells, contact over facets that is not modelled (see `contact_rule`), or an
            element or formulation that does not support the problem.
        ReferenceNotConvergedError: No equilibrium under the full load; has the last one found.

    Note:
        Saint-Venant-Kirchhoff loses equilibrium under strong compression (stretch 0.577), and in
        confined compression it loses stability in shear before that. An equilibrium whose tangent
        is not positive definite is not accepted; under follower pressure the tangent's symmetric
        part is tested, which is stricter than stability where the pressure has no potential.
        The iteration of a slender body may end at the rounding error of its nodal forces, a few
        1e-10; the result contains the relative residual.
        Degree 1 has contact with a tool at vertices or over facets, as the tool says; higher ones
        have it at nodes (see `contact_points`): a tool smaller than a facet can pass between
        them. With friction the result depends on the loading path (see `Friction`).
    """
    found = find_equilibrium(
        problem,
        strain=strain,
        degree=degree,
        relative_tolerance=relative_tolerance,
        formulation=formulation,
        element=element,
        start=start,
        progress=progress,
    )
    try:
        return found.result()
    finally:
        found.destroy()


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium with its discrete equations and their solver.

    Attributes:
        problem: Mesh, material, supports, loads and tools.
        discrete: The discrete equations.
        newton: Their solver, which can continue from here.
        path: Path of the load, or of the tools, to the equilibrium.
        smallest_det_f: Smallest det F [-].
    """

    problem: Problem
    discrete: DiscreteProblem
    newton: Newton
    path: Outcome
    smallest_det_f: float

    @property
    def displacement(self) -> Floats:
        """All unknowns, flat."""
        return self.path.displacement

    def result(self) -> ReferenceResult:
        """Evaluate all quantities of the result."""
        discrete, problem = self.discrete, self.problem
        state = measure_state(discrete, self.displacement)
        second_piola_kirchhoff, cauchy, first = measure_stresses(discrete, self.displacement)
        return ReferenceResult(
            displacement=discrete.at_points(self.displacement),
            strain=discrete.strain,
            degree=discrete.space.degree,
            load_factor=1.0,
            converged=True,
            relative_residual=self.path.relative_residual,
            smallest_det_f=self.smallest_det_f,
            volume=state.volume,
            surface_area=state.surface_area,
            rest_volume=problem.mesh.volume,
            rest_surface_area=problem.mesh.surface_area,
            strain_energy=state.strain_energy,
            newton_iterations=self.path.iterations,
            load_steps=self.path.load_factors,
            versions=fenicsx.versions(),
            tools=self.path.tools,
            formulation=discrete.formulation,
            element=discrete.element,
            second_piola_kirchhoff_stress=second_piola_kirchhoff,
            cauchy_stress=cauchy,
            first_piola_kirchhoff_stress=first,
            support_forces=support_forces(discrete, self.displacement),
        )

    def destroy(self) -> None:
        """Free matrices and factors at once."""
        self.newton.destroy()
        self.discrete.destroy()


def find_equilibrium(
    problem: Problem,
    *,
    strain: Strain,
    degree: int,
    relative_tolerance: float = 1e-10,
    formulation: Formulation = Formulation.DISPLACEMENT,
    element: Element = Element.LINEAR,
    guess: Callable[[DiscreteProblem], Floats] | None = None,
    start: Points | None = None,
    progress: Progress | None = None,
) -> Equilibrium:
    """Find the state under the full load; see `solve_static`.

    Args:
        problem: Mesh, material, supports, loads and tools.
        strain: Strain measure.
        degree: Polynomial degree of the displacement, 1 to 3.
        relative_tolerance: See `solve_static`.
        formulation: See `solve_static`.
        element: See `solve_static`.
        guess: Unknowns near the equilibrium, flat, from which alone it is sought; with tools also
            along their paths, if that fails or the equilibrium depends on the path, except as for
            `start`. For None the load is raised from zero.
        start: See `solve_static`; given instead of a guess.
        progress: Called with one line of text now and then.

    Raises:
        InputError: The problem cannot be used.
        ReferenceNotConvergedError: No equilibrium under the full load.
    """
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: needs 1, 2 or 3")
    if not 1e-14 <= relative_tolerance <= 1e-2:
        raise InputError(f"relative_tolerance = {relative_tolerance:g}: needs 1e-14 to 1e-2")
    require_supported(problem)
    require_drive_of_statics(problem.tools)
    tell = progress or say_nothing
    tell(f"compiling the forms of degree {degree} (once for this version)")
    formulation, element = Formulation(formulation), Element(element)
    kind = MixedProblem if formulation is Formulation.MIXED else DiscreteProblem
    discrete = kind(problem, strain=Strain(strain), degree=degree, element=element)
    sampler = DetFSampler(discrete)
    newton = Newton(discrete, sampler, relative_tolerance=relative_tolerance)
    num_dofs = fenicsx.total(discrete.num_dofs)
    tell(f"{num_dofs} degrees of freedom, {newton.linear_solver}")
    is_known = all(contact.forgets_its_way for contact in discrete.contacts)
    near = _near(discrete, guess, start) if is_known else None
    # For other degrees the internal forces would be those of the kinks between linear cells.
    knows_forces = start is not None and degree == 1
    path = None if near is None else _go_on(discrete, newton, near, tell, knows_forces=knows_forces)
    is_spent = path is not None and relative_tolerance > EXACT and _is_spent(discrete, near, path)
    if path is not None and is_spent:
        path = dataclasses.replace(path, reason=f"{path.reason}; {_SPENT}")
    elif path is None or (path.reason and (discrete.contacts or start is not None)):
        for contact in discrete.contacts:
            contact.begin()
        path = _follow(discrete, sampler, newton, tell)
    smallest_det_f = sampler.smallest(path.displacement)
    is_inverted = discrete.strain is Strain.GREEN and not smallest_det_f > 0.0
    reason = path.reason or ("a cell is inverted" if is_inverted else "")
    if reason or not np.isfinite(path.displacement).all():
        reached = path.load_factors[-1] if path.load_factors else math.nan if is_spent else 0.0
        where = find_smallest_stretch(discrete, path.displacement)
        nodal = discrete.at_points(path.displacement)
        newton.destroy()
        discrete.destroy()
        is_pressed = is_spent or reason.startswith(_ON_THE_WAY)
        raise ReferenceNotConvergedError(
            reached, reason, smallest_det_f, nodal, *where, is_pressed=is_pressed
        )
    return Equilibrium(problem, discrete, newton, path, smallest_det_f)


def _is_spent(discrete: DiscreteProblem, near: Floats | None, path: Outcome) -> bool:
    """Whether a body under tools has no equilibrium near a state in which its law gives way.

    The way of the tools would end there as well, after minutes.
    """
    if near is None or not (path.reason and discrete.contacts):
        return False
    return least_modulus(discrete, near) <= 0.0


def _near(
    discrete: DiscreteProblem,
    guess: Callable[[DiscreteProblem], Floats] | None,
    start: Points | None,
) -> Floats | None:
    if start is not None:
        return discrete.from_nodal(discrete.space.from_points(start))
    return None if guess is None else guess(discrete)


def _go_on(
    discrete: DiscreteProblem,
    newton: Newton,
    near: Floats,
    tell: Progress,
    *,
    knows_forces: bool,
) -> Outcome:
    """The equilibrium under the full load that Newton's method finds from a displacement nearby."""

    def report(iteration: int, relative: float, det_f: float) -> None:
        tell(
            f"from nearby, iteration {iteration}: relative residual {relative:.2e}, "
            f"smallest det F {det_f:.4f}"
        )

    needed = discrete.internal_force(near) - discrete.external_force(near) if knows_forces else None
    return go_on_at_end(newton, discrete.contacts, near, needed=needed, report=report)


def _follow(
    discrete: DiscreteProblem, sampler: DetFSampler, newton: Newton, tell: Progress
) -> Outcome:
    """Apply the loads with the tools where they begin; then move the tools as they are driven."""
    given = fenicsx.norm(discrete.fixed.values) + fenicsx.norm(discrete.dead_force)
    if given > 0.0 or discrete.has_follower_forces or not discrete.contacts:
        path = follow_load(newton, sampler, discrete.num_dofs, progress=tell)
        if path.reason or not discrete.contacts:
            return path
        start = path.displacement
    else:
        start = np.zeros(discrete.num_dofs)
    if discrete.contacts[0].tool.drive is not None:
        run = press(newton, discrete.contacts[0], start, progress=tell)
    else:
        run = follow_tools(newton, sampler, discrete.contacts, start, progress=tell)
    if run.reason:
        return dataclasses.replace(run, reason=f"{_ON_THE_WAY}: {run.reason}")
    return run
