"""What makes the steps of an explicit body: the compiled core, or Warp's kernels on a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.gpu.devices import CORE, UnsupportedOnDeviceError, check_device
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats, Indices
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
    is_single: bool,
    stiffness_damping: float,
    num_threads: int,
    device: str,
    is_repeatable: bool,
    classes: Indices,
    **options: Any,
) -> ExplicitRun:
    """A run on the core ("cpu") or on a device; see `ExplicitBody`.

    Both take the options: the step and its damping, the bound of displacements, `tracks_energy`.

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
            num_threads=num_threads,
            at_most=chosen_instruction_set(),
            is_single=is_single,
            stiffness_damping=stiffness_damping,
            classes=classes,
            **options,
        )
    if stiffness_damping:
        raise UnsupportedOnDeviceError("stiffness damping", named)
    from palpate.fastsim.gpu.device_run import DeviceRun

    precision = "float32" if is_single else "float64"
    options |= {"device": named, "precision": precision, "is_repeatable": is_repeatable}
    return DeviceRun(problem, body, mass, is_free, **options)
