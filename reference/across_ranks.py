"""What the ranks of mpirun tell each other, besides the sums of `fenicsx`.

Every rank calls these together, like anything that sums over a body. A decision that one rank takes
by its own numbers alone leaves the others waiting: take it by `is_anywhere`.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.reference.fenicsx import COMM, MPI

# A rank in trouble waits this long for the others to be in trouble too [s].
PATIENCE = 10.0
_POLL = 0.005  # [s]
# Where ranks in trouble meet: on a channel of its own, since the others may be at any other call.
_TROUBLE = COMM.Dup()


def is_anywhere(value: bool) -> bool:
    """Whether something is so on any rank."""
    return value if COMM.size == 1 else bool(COMM.allreduce(value, MPI.LOR))


def all_rows(rows: Floats) -> Floats:
    """The rows of all ranks, those of rank 0 first."""
    return rows if COMM.size == 1 else np.concatenate(COMM.allgather(rows))


def different_rows(rows: Floats) -> Floats:
    """The different rows of a table over all ranks, sorted."""
    different: Floats = np.unique(all_rows(np.unique(rows, axis=0)), axis=0)
    return different


def exchange(parts: list[Any]) -> list[Any]:
    """Send each rank its part; return what each has sent to this one, in the order of the ranks."""
    return parts if COMM.size == 1 else list(COMM.alltoall(parts))


def last_offered(value: Any, is_offered: bool) -> Any:
    """The value of the last rank that offers one."""
    return [v for v in COMM.allgather(value if is_offered else None) if v is not None][-1]


def is_met_by_all() -> bool:
    """Whether all ranks are in trouble: each calls this where it is, and waits for the others.

    False where one alone is. It must not go on then: the others wait for it elsewhere.
    """
    return COMM.size == 1 or comes(_TROUBLE.Ibarrier())


def comes(request: Any) -> bool:
    """Whether a request of MPI is met in the time that a rank in trouble waits."""
    deadline = time.monotonic() + PATIENCE
    while not request.Test():
        if time.monotonic() > deadline:
            return False
        time.sleep(_POLL)
    return True
