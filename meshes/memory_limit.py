"""A stretch of work that may not take more than so much memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def limited_memory(most_bytes: int) -> Iterator[None]:
    """Let the process grow by so much at most; what asks for more gets a MemoryError.

    For short calls into readers that reserve whatever a file asks for. Holds for the whole
    process, and on Linux only: elsewhere it does nothing.
    """
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        yield
        return
    old, hardest = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * resource.getpagesize() + most_bytes
    limits = [n for n in (old, hardest) if n != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([wanted, *limits]), hardest))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (old, hardest))
