"""What keeps a run from a device, with the way out."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.meshes.errors import InputError


@dataclass(eq=False, repr=False)
class DeviceUnavailableError(InputError):
    """A device that this machine does not have; `.device`, `.devices`.

    Attributes:
        device: That was asked for.
        devices: That there are; empty where Warp is not installed.
        remedy: What to do.
    """

    device: str
    devices: tuple[str, ...]
    remedy: str

    def __post_init__(self) -> None:
        super().__init__(f"device {self.device!r} is not to be had: {self.remedy}")


@dataclass(eq=False, repr=False)
class UnsupportedOnDeviceError(InputError):
    """Something that only the compiled core does; `.what`, `.device`."""

    what: str
    device: str

    def __post_init__(self) -> None:
        super().__init__(f'{self.what} does not run on {self.device}; use device="cpu"')
