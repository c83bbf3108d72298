"""Workers of a dask scheduler in the place of this machine's threads: an optional extra."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

import palpate
from palpate.meshes.errors import InputError

# How long a scheduler has to answer [s].
_PATIENCE = 10.0


class SchedulerError(InputError):
    """A scheduler that is of no use; `.address` holds it as it was given."""

    def __init__(self, address: str, reason: str) -> None:
        self.address = address
        super().__init__(f"scheduler {address!r}: {reason}")


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield an executor whose tasks run on the workers of a dask scheduler.

    Args:
        address: Of the scheduler, as `tcp://host:8786`.

    Raises:
        SchedulerError: dask.distributed is not installed, nobody answers, there is no worker, or
            a worker has no palpate, or one of another version.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SchedulerError(
            address, 'needs dask.distributed; pip install "palpate[cluster]"'
        ) from None
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SchedulerError(address, f"no dask scheduler answers there ({error})") from error
    with client:
        _require_workers(address, client.run(_version, on_error="return"))
        with client.get_executor(pure=False) as pool:
            yield pool


def _version() -> str:
    return palpate.__version__


def _require_workers(address: str, versions: dict[str, object]) -> None:
    """Refuse workers that would not answer as this machine does."""
    if not versions:
        raise SchedulerError(address, "it has no worker; start one with `dask worker ADDRESS`")
    here = palpate.__version__
    for worker, version in versions.items():
        if version != here:
            found = f"palpate {version}" if isinstance(version, str) else f"no palpate ({version})"
            reason = f"worker {worker} has {found}, here is {here}; install the same there"
            raise SchedulerError(address, reason)
