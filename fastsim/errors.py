"""What can go wrong in a simulation, with the data that shows it."""

from __future__ import annotations

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError


class CrowdedPointError(InputError):
    """A point with more neighbours than the stiffness matrix counts; `.point`."""

    def __init__(self, point: int) -> None:
        self.point = point
        super().__init__(
            f"point {point} has more than 65535 neighbours; mesh the body there in smaller cells"
        )


class FastsimError(RuntimeError):
    """Base of what goes wrong while simulating; the input itself was usable."""


class NotConvergedError(FastsimError):
    """No equilibrium was found at the full load.

    Attributes:
        load_factor: Largest part of the load, 0 to 1, at which equilibrium was found.
        residual: Relative residual of the last attempt.
        iterations: Newton iterations in all.
        smallest_det_f: Smallest det F at the last equilibrium.
        cell: The cell that has it.
        displacement: The last equilibrium [m], shape (num_points, 3).
    """

    def __init__(
        self,
        reason: str,
        *,
        load_factor: float,
        residual: float,
        iterations: int,
        smallest_det_f: float,
        cell: int,
        displacement: Points,
    ) -> None:
        self.reason = reason
        self.load_factor = load_factor
        self.residual = residual
        self.iterations = iterations
        self.smallest_det_f = smallest_det_f
        self.cell = cell
        self.displacement = displacement
        super().__init__(self._message())

    def _message(self) -> str:
        return (
            f"no equilibrium beyond {self.load_factor:.4g} of the load ({self.reason}); smallest "
            f"det F {self.smallest_det_f:.3g} in cell {self.cell}, after {self.iterations} "
            "iterations; lower the load, or use a finer mesh if the place is a corner"
        )


class EquilibriumLostError(NotConvergedError):
    """Saint-Venant-Kirchhoff has no stable equilibrium at the full load: the body gives way.

    Attributes:
        cell: The cell that is strained most as it gives way.
        place: Its centre at rest [m].
        smallest_stretch: Smallest principal stretch at the last equilibrium [-].
        stiffness: What is left of the stiffness in the softest direction [-]: 1 without stress,
            0 at the limit.
    """

    def __init__(
        self,
        reason: str,
        *,
        load_factor: float,
        residual: float,
        iterations: int,
        smallest_det_f: float,
        cell: int,
        place: tuple[float, float, float],
        smallest_stretch: float,
        stiffness: float,
        displacement: Points,
    ) -> None:
        self.place = place
        self.smallest_stretch = smallest_stretch
        self.stiffness = stiffness
        super().__init__(
            reason,
            load_factor=load_factor,
            residual=residual,
            iterations=iterations,
            smallest_det_f=smallest_det_f,
            cell=cell,
            displacement=displacement,
        )

    def _message(self) -> str:
        where = ", ".join(f"{x:.4g}" for x in self.place)
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


class RelaxationFailedError(FastsimError):
    """Dynamic relaxation found no state of rest.

    Attributes:
        reason: What ended it.
        steps: Explicit steps in all.
        residual: Last relative residual [-].
        load_factor: Part of the load that acted when it ended, 0 to 1.
        displacement: The last good state [m], shape (num_points, 3); not an equilibrium.
    """

    def __init__(
        self, reason: str, *, steps: int, residual: float, load_factor: float, displacement: Points
    ) -> None:
        self.reason = reason
        self.steps = steps
        self.residual = residual
        self.load_factor = load_factor
        self.displacement = displacement
        super().__init__(
            f"dynamic relaxation failed after {steps} steps: {reason} (relative residual "
            f"{residual:.2g}, {load_factor:.4g} of the load); lower the load, or solve it by "
            "Newton's method, which finds the load that can be borne"
        )


class UnstableStepError(FastsimError):
    """The chosen time step is above the critical one; `.time_step`, `.critical_time_step`."""

    def __init__(self, time_step: float, critical_time_step: float) -> None:
        self.time_step = time_step
        self.critical_time_step = critical_time_step
        super().__init__(
            f"time_step = {time_step:.4g} s is above the critical {critical_time_step:.4g} s; "
            f"use at most {0.9 * critical_time_step:.3g} s, or leave it out"
        )


class BlowUpError(FastsimError):
    """A run that left the finite numbers or the neighbourhood of the body.

    Attributes:
        reason: What was seen.
        step: Number of good steps done.
        time: Time of the last good state [s].
        cell: Where: the cell that inverted, or one at the point that moved fastest.
        place: Centre of that cell at rest [m].
        smallest_det_f: Smallest det F of the last good state [-].
        displacement: The last good state [m], shape (num_points, 3).
        time_step: [s].
        critical_time_step: About the last good state [s].
        suggestion: What to change.
    """

    def __init__(
        self,
        reason: str,
        *,
        step: int,
        time: float,
        cell: int,
        place: tuple[float, ...],
        smallest_det_f: float,
        displacement: Points,
        time_step: float,
        critical_time_step: float,
    ) -> None:
        self.reason = reason
        self.step = step
        self.time = time
        self.cell = cell
        self.place = place
        self.smallest_det_f = smallest_det_f
        self.displacement = displacement
        self.time_step = time_step
        self.critical_time_step = critical_time_step
        if time_step > 0.95 * critical_time_step:
            self.suggestion = (
                f"the time step {time_step:.4g} s is too long for the body as it is now (critical: "
                f"{critical_time_step:.4g} s); use at most {0.8 * critical_time_step:.3g} s"
            )
        else:
            self.suggestion = (
                "lower the load, raise it more slowly (amplitude), or refine the mesh there; "
                f"a shorter time step is no cure (critical: {critical_time_step:.4g} s)"
            )
        where = ", ".join(f"{x:.4g}" for x in place)
        super().__init__(
            f"blew up after step {step} (t = {time:.4g} s): {reason}, in cell {cell} at "
            f"({where}) m; smallest det F before it {smallest_det_f:.3g}; {self.suggestion}"
        )
