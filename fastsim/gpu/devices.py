"""Devices by name: "cpu" is the compiled core, "warp:cpu" and "cuda:0" are Warp's.

"cpu" is C++ on the processor, and needs nothing installed. "warp:cpu"
runs the kernels of the GPU on the processor: one thread, slower than the core, to verify them.
Kernels are compiled when first needed and stored in Warp's own cache of the user, or in the folder
that the environment variable WARP_CACHE_PATH names; nothing is written beside the sources.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from palpate.meshes.errors import InputError

CORE = "cpu"
WARP_CPU = "warp:cpu"
_CUDA = re.compile(r"cuda(:\d+)?")
_INSTALL = 'install Warp: pip install "palpate[gpu]", or pip install warp-lang'


def load_warp(device: str) -> Any:
    """Warp, quiet and started.

    Raises:
        DeviceUnavailableError: It is not installed.
    """
    try:
        import warp as wp
    except ImportError as error:
        raise DeviceUnavailableError(device, (CORE,), _INSTALL) from error
    _start(wp)
    return wp


@cache
def _start(wp: Any) -> None:
    # Warp greets on standard output, where results may be read; a caller's own choice stays.
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING
    wp.init()


def known_devices() -> tuple[str, ...]:
    """The devices that this machine has, "cpu" first; that alone where Warp is not installed."""
    try:
        wp = load_warp(WARP_CPU)
    except DeviceUnavailableError:
        return (CORE,)
    return (CORE, WARP_CPU, *(str(device.alias) for device in wp.get_cuda_devices()))


def check_device(device: str) -> str:
    """The device's name as `known_devices` has it.

    Raises:
        DeviceUnavailableError: There is no such device, or Warp is not installed.
    """
    if device == CORE:
        return CORE
    if device != WARP_CPU and not _CUDA.fullmatch(device):
        listed = ", ".join(known_devices())
        raise DeviceUnavailableError(
            device, known_devices(), f"it is no name of one; this machine has {listed}"
        )
    load_warp(device)  # its error states what to install
    found = known_devices()
    name = "cuda:0" if device == "cuda" else device
    if name not in found:
        raise DeviceUnavailableError(
            device,
            found,
            f"Warp sees no such GPU (driver, or CUDA_VISIBLE_DEVICES); this machine has "
            f"{', '.join(found)}",
        )
    return name


def warp_name(device: str) -> str:
    """The name of a device in Warp."""
    return "cpu" if device == WARP_CPU else device


@dataclass(eq=False, repr=False)
class DeviceUnavailableError(InputError):
    """A device that this machine does not have; `.device`, `.devices` it has, `.remedy`."""

    device: str
    devices: tuple[str, ...]
    remedy: str

    def __post_init__(self) -> None:
        super().__init__(f"device {self.device!r} is not to be had: {self.remedy}")


@dataclass(eq=False, repr=False)
class UnsupportedOnDeviceError(InputError):
    """Something that only the compiled core supports; `.what`, `.device`."""

    what: str
    device: str

    def __post_init__(self) -> None:
        super().__init__(f'{self.what} does not run on {self.device}; use device="cpu"')
