"""One solve on all ranks of mpirun: rank 0 leads, the others wait for what it sends.

    mpirun -n 4 palpate solve CASE --with reference -o RESULT.vtu

Only rank 0 reads, judges, prints and writes; the other processes do nothing but their part of
each solve. An error that every rank meets is raised on rank 0 as usual; one that a single rank
meets, while the others wait for it inside a solve, ends them all.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, TypeAlias

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.meshes.temporaries import scratch_folder
from palpate.reference.availability import require_available
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError

# Variables in which Open MPI and MPICH tell a process its place.
_PLACES = (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK"))
_TAG = 1
_POLL = 0.005  # [s]
# A rank in trouble waits this long for the others to be in trouble too [s].
_PATIENCE = 10.0

Say: TypeAlias = Callable[[str], None]
# What is done on every rank, with a place to tell progress.
Task: TypeAlias = Callable[[Problem, Say], Any]


def _place() -> tuple[int, int]:
    for size, rank in _PLACES:
        if size in os.environ and rank in os.environ:
            return int(os.environ[size]), int(os.environ[rank])
    return 1, 0


def num_ranks() -> int:
    """Processes that mpirun started this one among; 1 without mpirun."""
    return _place()[0]


def is_follower() -> bool:
    """Whether this process only does its part of what rank 0 solves."""
    return _place()[1] > 0


def solve_on_ranks(task: Task, problem: Problem, *, time_limit: float, progress: Say) -> Any:
    """Do a task on all ranks; called on rank 0, answered with its own result.

    Args:
        task: Picklable; does the same collective calls on every rank.
        problem: Sent to all.
        time_limit: All ranks are ended after this [s].
        progress: Called on rank 0.

    Raises:
        ReferenceUnavailableError: mpirun is not that of the MPI FEniCSx was built with.
    """
    comm = _communicator()
    with scratch_folder("ranks") as folder:
        given = folder / "problem.npz"
        save_problem(given, problem)
        sent = given.read_bytes()
    for rank in range(1, comm.size):
        comm.send((task, sent), dest=rank, tag=_TAG)
    timer = threading.Timer(time_limit, _end_all, (comm, 3, f"no answer within {time_limit:g} s"))
    timer.daemon = True
    timer.start()
    try:
        answer, error = _together(comm, lambda say: task(problem, say), progress)
    finally:
        timer.cancel()
    if error is not None:
        raise error
    return answer


def follow() -> int:
    """Do rank 0's tasks until it has no more; return the exit status of a follower."""
    try:
        comm = _communicator()
    except (ReferenceFailedError, ImportError):
        return 0  # rank 0 meets the same and tells it
    while True:
        while not comm.iprobe(source=0, tag=_TAG):
            time.sleep(_POLL)
        received = comm.recv(source=0, tag=_TAG)
        if received is None:
            return 0
        _together(comm, functools.partial(_do_part, *received), _say_nothing)


def dismiss() -> None:
    """Let the followers go; called on rank 0 at its end, whatever happened."""
    if num_ranks() == 1:
        return
    try:
        comm = _communicator()
    except (ReferenceFailedError, ImportError):
        return
    for rank in range(1, comm.size):
        comm.send(None, dest=rank, tag=_TAG)


@functools.cache
def _communicator() -> Any:
    """All ranks, on a channel of its own: dolfinx too has barriers under way on COMM_WORLD."""
    require_available()
    from palpate.reference.fenicsx import COMM

    if COMM.size != num_ranks():
        raise ReferenceUnavailableError(
            f"mpirun started {num_ranks()} processes, and the MPI of FEniCSx sees {COMM.size}; "
            "use the mpirun that belongs to it"
        )
    return COMM.Dup()


def _do_part(task: Task, sent: bytes, say: Say) -> Any:
    with scratch_folder("ranks") as folder:
        given = folder / "problem.npz"
        given.write_bytes(sent)
        problem = load_problem(given)
    return task(problem, say)


def _together(comm: Any, part: Callable[[Say], Any], progress: Say) -> tuple[Any, Exception | None]:
    """Do this rank's part; return its answer, or the error that every rank met."""
    try:
        answer = part(progress)
    except Exception as error:
        # The others may wait inside the solve for what this rank will never send.
        everyone = comm.Ibarrier()
        deadline = time.monotonic() + _PATIENCE
        while not everyone.Test():
            if time.monotonic() > deadline:
                _end_all(comm, _exit_code(error), f"rank {comm.rank}: {error}")
            time.sleep(_POLL)
        return None, error
    comm.Ibarrier().Wait()
    return answer, None


def _exit_code(error: Exception) -> int:
    if isinstance(error, InputError):
        return 2
    return 3 if isinstance(error, ReferenceFailedError) else 4


def _end_all(comm: Any, code: int, why: str) -> None:
    print(f"palpate: {why}", file=sys.stderr, flush=True)
    comm.Abort(code)


def _say_nothing(_line: str) -> None:
    pass
