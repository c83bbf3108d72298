"""A trajectory by one of the schemes; importable without FEniCSx."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Element, Strain
from palpate.reference.integrators.schemes import Integrator


@dataclass(frozen=True, eq=False)
class SteppedResult:
    """A trajectory of tetrahedra of degree 1 with lumped mass, every step solved.

    Attributes:
        times: [s], shape (num_outputs + 1,), from 0.
        displacements: [m], shape (num_outputs + 1, num_points, 3), in the mesh's order of points.
        velocities: [m/s], likewise, as the scheme has them.
        kinetic_energies: [J], shape (num_outputs + 1,).
        strain_energies: [J], likewise.
        integrator: The scheme.
        time_step: [s].
        num_steps: Steps done.
        newton_iterations: Linear solves in all.
        largest_residual: Of any step, relative as in `simulate_by` [-]; 0 of explicit schemes.
        strain: Strain measure.
        element: What the tetrahedra are.
        versions: Of Python and the parts of FEniCSx.
    """

    times: Floats
    displacements: Floats
    velocities: Floats
    kinetic_energies: Floats
    strain_energies: Floats
    integrator: Integrator
    time_step: float
    num_steps: int
    newton_iterations: int
    largest_residual: float
    strain: Strain
    element: Element
    versions: dict[str, str] = field(default_factory=dict)
