"""What makes the steps of an explicit body: the compiled core, or Warp's kernels on a device."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.gpu.devices import CORE, UnsupportedOnDeviceError, check_device
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem


class ExplicitRun(Protocol):
    """A body in motion, its arrays in the caller's numbering: core/explicit/explicit_run.hpp."""

    @property
    def instruction_set(self) -> str:
        """Instruction set that the step uses."""

    def set_state(self, displacement: Points, increment: Points, energy: float) -> None:
        """Start the sums afresh."""

    def get_state(self, displacement: Points, increment: Points) -> None:
        """Copy the state."""

    def set_dead_load(self, history: int, forces: Points) -> None:
        """Forces of a history [N]."""

    def set_pressure(
        self,
        points: Points,
        facets: NDArray[np.int32],
        pressures: Floats,
        histories: NDArray[np.int32],
    ) -> None:
        """Follower pressures [Pa]."""

    def set_springs(
        self, facets: NDArray[np.int32], stiffnesses: Floats, histories: NDArray[np.int32]
    ) -> None:
        """Springs over facets; they replace those set before."""

    def set_moving_supports(self, values: Floats, histories: NDArray[np.int32]) -> None:
        """Fixed components that move."""

    def set_sliding_supports(
        self,
        points: NDArray[np.int32],
        directions: Floats,
        values: Floats,
        histories: NDArray[np.int32],
    ) -> None:
        """Points fixed along some directions."""

    def set_mass_damping(self, mass_damping: float) -> None:
        """Change D."""

    def add_tool(
        self,
        shape: _core.ToolShape,
        *,
        is_constraint: bool,
        friction: float,
        reach: float,
        deepest: float,
        direction: tuple[float, float, float],
        mass: float,
        points: Points,
        vertices: NDArray[np.int32],
        stiffnesses: Floats,
    ) -> None:
        """A rigid tool."""

    def set_self_contact(
        self,
        points: Points,
        cells: NDArray[np.int32],
        vertices: NDArray[np.int32],
        facets: NDArray[np.int32],
        parts: NDArray[np.int32],
        stiffnesses: Floats,
        at_most: _core.InstructionSet,
    ) -> None:
        """Contact of the body with itself."""

    def advance(self, factors: Floats, tools: Floats) -> tuple[int, _core.StopReason, int]:
        """The steps between the rows."""

    def look(self, factors: Floats, tools: Floats) -> tuple[int, _core.StopReason, int]:
        """Find all that pushes, without a step."""

    def energies(self) -> tuple[float, float, float]:
        """Kinetic energy, external work, damping loss [J]."""

    def take_tool_records(self) -> Floats:
        """Loads on the tools."""

    def get_contact_force(self, force: Points) -> None:
        """Copy the forces of tools and of contact of the body with itself [N]."""

    def self_overlap(self) -> tuple[int, float]:
        """Vertices inside cells, and the deepest [m]."""


def make_run(
    problem: Problem,
    body: Body,
    mass: Floats,
    is_free: NDArray[np.uint8],
    *,
    scheme: _core.CentralDifference,
    displacement_limit: float,
    is_single: bool,
    tracks_energy: bool,
    stiffness_damping: float,
    num_threads: int,
    device: str,
    is_repeatable: bool,
) -> ExplicitRun:
    """A run on the core ("cpu") or on a device; see `ExplicitBody`.

    Raises:
        DeviceUnavailableError: There is no such device, or Warp is not installed.
        UnsupportedOnDeviceError: Something that only the core does.
    """
    named = check_device(device)
    if named == CORE:
        return _core.ExplicitRun.make(
            body.core,
            mass,
            is_free,
            time_step=scheme.time_step,
            mass_damping=scheme.mass_damping,
            displacement_limit=displacement_limit,
            num_threads=num_threads,
            at_most=chosen_instruction_set(),
            is_single=is_single,
            tracks_energy=tracks_energy,
            stiffness_damping=stiffness_damping,
        )
    if stiffness_damping:
        raise UnsupportedOnDeviceError("stiffness damping", named)
    from palpate.fastsim.gpu.device_run import DeviceRun

    return DeviceRun(
        problem,
        body,
        mass,
        is_free,
        device=named,
        precision="float32" if is_single else "float64",
        is_repeatable=is_repeatable,
        tracks_energy=tracks_energy,
        time_step=scheme.time_step,
        mass_damping=scheme.mass_damping,
        displacement_limit=displacement_limit,
    )
