"""Results of the reference, static and dynamic; importable without FEniCSx."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.schemes import Integrator

Values: TypeAlias = Floats


class Formulation(StrEnum):
    """Unknowns of the equations: displacement alone, or pressure beside it (see `mixed_form`).

    >>> import palpate
    >>> palpate.Formulation("mixed")
    <Formulation.MIXED: 'mixed'>
    """

    DISPLACEMENT = "displacement"
    MIXED = "mixed"


# From this Poisson's ratio on the displacement form is too inaccurate: on Cook's membrane quadratic
# tetrahedra have an error of 15 % at 0.499.
NEARLY_INCOMPRESSIBLE = 0.49


def formulation_for(problem: Problem, degree: int) -> Formulation:
    """The formulation that a problem is solved with by default.

    MIXED from Poisson's ratios of 0.49 on, wherever that form can be used: degree 2 or 3, and all
    ratios above 0.

    Args:
        problem: The problem.
        degree: Polynomial degree of the displacement.
    """
    materials = (problem.material, *(one.material for one in problem.inclusions))
    ratios = [material.poissons_ratio for material in materials]
    is_asked = max(ratios) >= NEARLY_INCOMPRESSIBLE
    is_possible = degree > 1 and min(ratios) > 0.0
    return Formulation.MIXED if is_asked and is_possible else Formulation.DISPLACEMENT


Vector: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class ToolHistory:
    """Forces, moments and contact of one tool at the knots of the paths, in their order.

    Attributes:
        times: Knots [s].
        forces: Forces on the tool [N].
        moments: Moments on the tool about its origin [N m].
        active_areas: Rest area of the contact points that press on it [m2].
        penetrations: Largest depth of a contact point inside the tool [m], >= 0.
    """

    times: tuple[float, ...]
    forces: tuple[Vector, ...]
    moments: tuple[Vector, ...]
    active_areas: tuple[float, ...]
    penetrations: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ReferenceResult:
    """A converged static state.

    Attributes:
        displacement: At the mesh's points, in their order [m], shape (num_points, 3); for higher
            degrees its values at these points.
        strain: Strain measure of the model.
        degree: Polynomial degree of the displacement.
        load_factor: Fraction of the load reached: 1.
        converged: True; a solve that is not raises ReferenceNotConvergedError.
        relative_residual: Norm of the out-of-balance nodal forces over that of the external or
            internal ones, whichever is larger [-].
        smallest_det_f: Smallest det F: over the cells (degree 1), over sample points with the
            vertices among them (degree 2 and up) [-]. Positive for Green strain.
        volume: Integral of det F [m3].
        surface_area: Integral of |cof(F) N| over the boundary [m2].
        rest_volume: [m3].
        rest_surface_area: [m2].
        strain_energy: [J].
        newton_iterations: Total number of linear solves.
        load_steps: Load factors at which equilibrium was found, the last one 1.
        versions: Versions of Python and the parts of FEniCSx.
        tools: History of each tool, in the problem's order.
        formulation: Unknowns of the equations.
        element: Kind of the tetrahedra.
        second_piola_kirchhoff_stress: S, mean over each rest cell [Pa], shape (num_cells, 3, 3), in
            the mesh's order; the formulas are in `deformed_state`.
        cauchy_stress: sigma = F S F^T / det F, as S; equal to S under linear strain.
        first_piola_kirchhoff_stress: P = F S, as S, not symmetric; equal to S under linear strain.
        support_forces: Of each support on the body [N], shape (num_supports, 3): traction
            resultants, from nodal forces, so that they balance the loads and tools. A component
            that several supports fix counts for the first.
    """

    displacement: Points
    strain: Strain
    degree: int
    load_factor: float
    converged: bool
    relative_residual: float
    smallest_det_f: float
    volume: float
    surface_area: float
    rest_volume: float
    rest_surface_area: float
    strain_energy: float
    newton_iterations: int
    load_steps: tuple[float, ...] = (1.0,)
    versions: dict[str, str] = field(default_factory=dict)
    tools: tuple[ToolHistory, ...] = ()
    formulation: Formulation = Formulation.DISPLACEMENT
    element: Element = Element.LINEAR
    second_piola_kirchhoff_stress: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    cauchy_stress: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    first_piola_kirchhoff_stress: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    support_forces: Points = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def von_mises_stress(self) -> Floats:
        """sqrt(3/2 s : s) of each cell's mean Cauchy stress [Pa], s its deviator, (num_cells,)."""
        sigma = self.cauchy_stress
        s = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        stress: Floats = np.sqrt(1.5 * np.einsum("cij,cij->c", s, s))
        return stress


# Beginning of `AdaptiveResult.ended` where a finer mesh has no equilibrium: nothing has a limit.
LOST = "no equilibrium on the next mesh"
# How the reason begins where the equilibrium on a mesh is none of the body without a mesh.
YIELDS = "the law has lost its resistance to compression"
REMEDY_OF_YIELD = "press less deep, or take a law that stiffens"


@dataclass(frozen=True, eq=False)
class AdaptiveResult(ReferenceResult):
    """A static state on the last of a sequence of meshes, at the points and cells of the first.

    Stresses are means over the first mesh's cells.

    Attributes:
        quantities: The quantities with error bars, in the order of the columns below.
        tolerances: The requested bar of each [-].
        num_cells: Number of cells of each mesh, shape (num_meshes,).
        num_unknowns: Number of unknowns on each mesh, shape (num_meshes,).
        seconds: Time spent on each mesh [s], shape (num_meshes,).
        estimates: Dual-weighted estimates of the error on each mesh, to a factor [-], shape
            (num_meshes, num_quantities).
        differences: Relative differences from the mesh before [-], as estimates; infinite in the
            first row.
        bars: Relative error bars from the meshes up to each [-], as estimates.
        smallest_det_fs: Smallest det F on each mesh [-], shape (num_meshes,).
        lowest_eigenvalue: Of the tangent over that at rest, on the first mesh [-]: 0 where a branch
            begins; nan where it is not asked (see `branches`).
        load_over_critical: The load over the first critical one of linear buckling, on the first
            mesh [-]: above 1 the state is one of several; nan where it is not asked.
        ended: Reason why there is no finer mesh.
        first: The state on the first mesh, where that is the case's.
    """

    quantities: tuple[str, ...] = ()
    tolerances: tuple[float, ...] = ()
    num_cells: Values = field(default_factory=lambda: np.zeros(0))
    num_unknowns: Values = field(default_factory=lambda: np.zeros(0))
    seconds: Values = field(default_factory=lambda: np.zeros(0))
    estimates: Values = field(default_factory=lambda: np.zeros((0, 0)))
    differences: Values = field(default_factory=lambda: np.zeros((0, 0)))
    bars: Values = field(default_factory=lambda: np.zeros((0, 0)))
    smallest_det_fs: Values = field(default_factory=lambda: np.zeros(0))
    lowest_eigenvalue: float = math.nan
    load_over_critical: float = math.nan
    ended: str = ""
    first: ReferenceResult | None = None

    def bar(self, quantity: str) -> float:
        """Error bar of a quantity on the last mesh, relative [-]; infinite where it has none."""
        if quantity not in self.quantities:
            return math.inf
        return float(self.bars[-1, self.quantities.index(quantity)])


@dataclass(frozen=True, eq=False)
class Audit:
    """Errors of a displacement that are measured without solving the problem.

    Attributes:
        degree: Polynomial degree of the test functions.
        strain: Strain measure of the model.
        residual_norm: Of the free residual, dual to the energy norm: sup over v of R(v) / |v|,
            |v|^2 = v . K v with the rest stiffness K [J^(1/2)]. For linear strain it is the
            energy norm of the error itself; for Green strain to first order.
        relative_residual_norm: Over the energy norm of the displacement, (2 energy)^(1/2) [-].
        support_gap: Largest distance of a fixed component from its prescribed value [m].
        largest_displacement: Largest displacement of a point of the mesh [m].
        force_imbalance: Size of the sum of external forces and reactions [N].
        moment_imbalance: Size of the sum of their moments about the origin, at deformed positions
            under Green strain [N m].
        strain_energy: [J].
        volume: [m3].
        smallest_det_f: Smallest det F [-]; not above 0 where a cell is inverted.
        is_stable: Whether the tangent is positive definite there; None where this is not tested:
            under linear strain it always is, follower loads have no symmetric tangent, and a body
            cannot have inverted cells.
        displacement_error: Estimate, L2 over the mesh's points over the corrected displacement
            [-]; None where the tangent is singular or not positive definite, or a cell inverted.
        volume_error: Estimate, of the change of volume over the corrected change, signed [-];
            None where `displacement_error` is.
        cell_errors: Each cell's part of `residual_norm` [J^(1/2)], shape (num_cells,): an indicator
            for refinement. Their squares add up to its square (to quadrature for degree 3).
    """

    degree: int
    strain: Strain
    residual_norm: float
    relative_residual_norm: float
    support_gap: float
    largest_displacement: float
    force_imbalance: float
    moment_imbalance: float
    strain_energy: float
    volume: float
    smallest_det_f: float
    is_stable: bool | None
    displacement_error: float | None
    volume_error: float | None
    cell_errors: Values

    @property
    def relative_support_gap(self) -> float:
        """Gap at the supports over the largest displacement of a point [-]."""
        if self.support_gap == 0.0:
            return 0.0
        size = self.largest_displacement
        return self.support_gap / size if size else math.inf


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """A motion at the outputs.

    Attributes:
        times: [s], shape (num_outputs + 1,), from 0.
        displacements: At the mesh's points, in their order [m],
            shape (num_outputs + 1, num_points, 3).
        velocities: [m/s], the same shape.
        kinetic_energies: [J], shape (num_outputs + 1,).
        strain_energies: [J], the same shape.
        strain: Strain measure of the model.
        time_step: [s].
        newton_iterations: Linear solves in all.
        versions: Versions of Python and the parts of FEniCSx.
        tool_forces: On each tool, mean since the output before [N], shape
            (num_tools, num_outputs + 1, 3); the first is zero.
    """

    times: Values
    displacements: Floats
    velocities: Floats
    kinetic_energies: Values
    strain_energies: Values
    strain: Strain
    time_step: float
    newton_iterations: int
    versions: dict[str, str] = field(default_factory=dict)
    tool_forces: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))


@dataclass(frozen=True, eq=False, kw_only=True)
class ImplicitResult(Trajectory):
    """A trajectory by the generalised-alpha method; for the other attributes see `Trajectory`.

    Attributes:
        external_works: Work of loads, moving supports and tools since the start [J],
            shape (num_outputs + 1,).
        damping_works: Energy dissipated by damping since the start [J], the same shape.
        smallest_det_f: Over the outputs [-]; see ReferenceResult.
        degree: Polynomial degree of the displacement.
    """

    external_works: Values
    damping_works: Values
    smallest_det_f: float
    degree: int

    @property
    def energy_errors(self) -> Values:
        """Kinetic plus strain energy since the start, less work done, plus damping [J].

        Energy lost to the numerical damping of high frequencies is a negative value here.
        """
        stored = self.kinetic_energies + self.strain_energies
        errors: Values = stored - stored[0] - self.external_works + self.damping_works
        return errors


@dataclass(frozen=True, eq=False, kw_only=True)
class SteppedResult(Trajectory):
    """A trajectory of tetrahedra of degree 1 with lumped mass, every step solved.

    Velocities are as defined by the scheme; for central differences the mean over the last step.
    For the other attributes see `Trajectory`.

    Attributes:
        integrator: The scheme.
        num_steps: Number of time steps.
        largest_residual: Of any step, relative as in `simulate_by` [-]; 0 for explicit schemes.
        element: Kind of the tetrahedra.
    """

    integrator: Integrator
    num_steps: int
    largest_residual: float
    element: Element
