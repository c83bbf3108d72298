"""What makes the steps of an explicit body: the compiled core, or Warp's kernels on a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.gpu.devices import CORE, UnsupportedOnDeviceError, check_device
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Problem

if TYPE_CHECKING:
    from palpate.fastsim.gpu.device_run import DeviceRun


# Both have one interface; arrays in the caller's numbering: core/explicit/explicit_run.hpp.
ExplicitRun: TypeAlias = "_core.ExplicitRun | DeviceRun"


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
