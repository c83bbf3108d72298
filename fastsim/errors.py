"""Errors of simulations, each with its data."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError

# Where `Body.folds`: a finer mesh, the usual way out, makes it worse.
FOLDING = (
    'take law = "neo-hookean-stable" (smoothed tetrahedra of Saint-Venant-Kirchhoff fold under '
    "pressure, small ones first; linear ones bear more)"
)


@dataclass(eq=False, repr=False)
class CrowdedPointError(InputError):
    """A point with more neighbours than the stiffness matrix can number; `.point`."""

    point: int

    def __post_init__(self) -> None:
        super().__init__(
            f"point {self.point} has more than 65535 neighbours; mesh the body there in smaller "
            "cells"
        )


class FastsimError(RuntimeError):
    """Base of the errors of a simulation; the input itself was usable."""


@dataclass(eq=False, repr=False)
class NotConvergedError(FastsimError):
    """No equilibrium was found at the full load.

    Attributes:
        reason: What ended the search.
        load_factor: Largest part of the load, 0 to 1, at which equilibrium was found.
        residual: Relative residual of the last attempt.
        iterations: Newton iterations in all.
        smallest_det_f: Smallest det F at the last equilibrium.
        cell: The cell that has it.
        displacement: The last equilibrium [m], shape (num_points, 3).
    """

    reason: str
    load_factor: float
    residual: float
    iterations: int
    smallest_det_f: float
    cell: int
    displacement: Points

    def __post_init__(self) -> None:
        super().__init__(self._message())

    def _message(self) -> str:
        return (
            f"no equilibrium beyond {self.load_factor:.4g} of the load ({self.reason}); smallest "
            f"det F {self.smallest_det_f:.3g} in cell {self.cell}, after {self.iterations} "
            "iterations; lower the load, or use a finer mesh if the place is a corner"
        )


@dataclass(eq=False, repr=False)
class EquilibriumLostError(NotConvergedError):
    """Saint-Venant-Kirchhoff has no stable equilibrium at the full load: the body gives way.

    Attributes:
        cell: The cell that is strained most as it gives way.
        position: Its centre at rest [m].
        smallest_stretch: Smallest principal stretch at the last equilibrium [-].
        stiffness: What is left of the stiffness in the softest direction [-]: 1 without stress,
            0 at the limit.
    """

    position: tuple[float, float, float]
    smallest_stretch: float
    stiffness: float

    def _message(self) -> str:
        where = ", ".join(f"{x:.4g}" for x in self.position)
        # Half-way between no stretch and the material's own limit.
        kind = (
            "Saint-Venant-Kirchhoff softens below 0.577 in free compression"
            if self.smallest_stretch < 0.8
            else "hardly crushed, it buckles"
        )
        return (
            f"no equilibrium beyond {self.load_factor:.4g} of the load ({self.reason}): the body "
            f"has {max(self.stiffness, 0.0):.1%} of its stiffness left and gives way in cell "
            f"{self.cell} at ({where}) m; smallest principal stretch {self.smallest_stretch:.3g} "
            f"({kind}); lower the load, or spread it"
        )


@dataclass(eq=False, repr=False)
class RelaxationFailedError(FastsimError):
    """Dynamic relaxation found no state of rest.

    Attributes:
        reason: What ended it.
        steps: Explicit steps in all.
        residual: Last relative residual [-].
        load_factor: Part of the load that acted when it ended, 0 to 1.
        displacement: The last good state [m], shape (num_points, 3); not an equilibrium.
    """

    reason: str
    steps: int
    residual: float
    load_factor: float
    displacement: Points

    def __post_init__(self) -> None:
        super().__init__(
            f"dynamic relaxation failed after {self.steps} steps: {self.reason} (relative residual "
            f"{self.residual:.2g}, {self.load_factor:.4g} of the load); lower the load, or solve "
            "it by Newton's method, which finds the load that can be borne"
        )


@dataclass(eq=False, repr=False)
class UnstableStepError(FastsimError):
    """The chosen time step is above the critical one; `.time_step`, `.critical_time_step`."""

    time_step: float
    critical_time_step: float

    def __post_init__(self) -> None:
        critical = self.critical_time_step
        super().__init__(
            f"time_step = {self.time_step:.4g} s is above the critical {critical:.4g} s; "
            f"use at most {0.9 * critical:.3g} s, or leave it out"
        )


@dataclass(eq=False, repr=False)
class SpringTooStiffError(FastsimError):
    """The time step is too long for a spring; `.stiffness`, `.largest_stiffness`, `.time_step`."""

    stiffness: float
    largest_stiffness: float
    time_step: float

    def __post_init__(self) -> None:
        super().__init__(
            f"stiffness = {self.stiffness:.4g} N/m of a spring is too much for steps of "
            f"{self.time_step:.4g} s on so few points: use at most {self.largest_stiffness:.3g} "
            "N/m, a larger radius, or shorter steps"
        )


@dataclass(eq=False, repr=False)
class BlowUpError(FastsimError):
    """A run that left the finite numbers or the neighbourhood of the body.

    Attributes:
        reason: What happened.
        step: Number of accepted time steps.
        time: Time of the last good state [s].
        cell: The cell that inverted, or one at the point that moved fastest.
        position: Centre of that cell at rest [m].
        smallest_det_f: Smallest det F of the last good state [-].
        displacement: The last good state [m], shape (num_points, 3).
        time_step: [s].
        critical_time_step: About the last good state [s].
        folds: Whether it is a body of which single cells fold (`Body.folds`).
        suggestion: What to change.
    """

    reason: str
    step: int
    time: float
    cell: int
    position: tuple[float, ...]
    smallest_det_f: float
    displacement: Points
    time_step: float
    critical_time_step: float
    folds: bool = False

    def __post_init__(self) -> None:
        critical = self.critical_time_step
        if self.time_step > 0.95 * critical:
            self.suggestion = (
                f"the time step {self.time_step:.4g} s is too long for the body as it is now "
                f"(critical: {critical:.4g} s); use at most {0.8 * critical:.3g} s"
            )
        else:
            ways_out = FOLDING if self.folds else "refine the mesh there"
            self.suggestion = (
                f"lower the load, raise it more slowly (amplitude), or {ways_out}; "
                f"a shorter time step is no cure (critical: {critical:.4g} s)"
            )
        where = ", ".join(f"{x:.4g}" for x in self.position)
        super().__init__(
            f"blew up after step {self.step} (t = {self.time:.4g} s): {self.reason}, in cell "
            f"{self.cell} at ({where}) m; smallest det F before it {self.smallest_det_f:.3g}; "
            f"{self.suggestion}"
        )
