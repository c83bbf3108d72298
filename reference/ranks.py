"""One solve on all ranks of mpirun: rank 0 leads, the others wait for the tasks that it sends.

    mpirun -n 4 palpate solve CASE --with reference -o RESULT.vtu

Only rank 0 reads, judges, prints and writes; the other processes only do their part of each solve,
and leave Ctrl-C to rank 0. An error that occurs on every rank is raised on rank 0 as usual, and so
is one of another rank that the others did not wait for. An error on a single rank while the others
wait for it inside a solve ends all ranks, with a line that states the rank and the error; so do
the end of rank 0 and a time limit. If a rank is killed, mpirun notices it and ends the rest.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.reference.availability import require_available
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceFailedError,
    ReferenceUnavailableError,
)
from palpate.reference.tasks import Progress, say_nothing

# Environment variables in which Open MPI and MPICH pass a process its rank and their number.
_VARIABLES = (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK"))
_TAG = 1
_POLL = 0.005  # [s]
# Rank 0 reports a time limit; where it cannot, because it waits inside a library for another rank,
# the system ends it so much later [s].
_GRACE = 20.0
# Wait before all ranks are ended, so that mpirun can pass on their last lines [s].
_TO_BE_HEARD = 0.5

# The function that runs on every rank, with a problem and a function to report progress.
Task: TypeAlias = Callable[[Problem, Progress], Any]

# Whether the other ranks work on a task that rank 0 has not completed.
_is_under_way = False


def _size_and_rank() -> tuple[int, int]:
    for size, rank in _VARIABLES:
        if size in os.environ and rank in os.environ:
            return int(os.environ[size]), int(os.environ[rank])
    return 1, 0


def num_ranks() -> int:
    """Number of processes that mpirun started; 1 without mpirun."""
    return _size_and_rank()[0]


def is_follower() -> bool:
    """Whether this process only does its part of the solves of rank 0."""
    return _size_and_rank()[1] > 0


def solve_on_ranks(task: Task, problem: Problem, *, time_limit: float, progress: Progress) -> Any:
    """Do a task on all ranks; called on rank 0, returns the result of rank 0.

    The task is picklable and makes the same collective calls on every rank; all ranks are ended
    after the time limit [s].

    Raises:
        ReferenceUnavailableError: mpirun does not belong to the MPI FEniCSx was built with.
        ReferenceCrashedError: Another rank alone had an error, after the last collective call of
            the task.
    """
    global _is_under_way
    comm = _communicator()
    _is_under_way = True
    for rank in range(1, comm.size):
        comm.send((task, problem), dest=rank, tag=_TAG)
    limit = min(time_limit, threading.TIMEOUT_MAX)
    timer = threading.Timer(limit, _end_all, (comm, 3, f"no answer within {limit:g} s"))
    timer.daemon = True
    timer.start()
    _set_alarm(limit + _GRACE)
    try:
        answer, error = _together(comm, lambda say: task(problem, say), progress)
    finally:
        timer.cancel()
        _set_alarm(0.0)
    _is_under_way = False
    if error is not None:
        raise error
    return answer


def follow() -> int:
    """Do rank 0's tasks until it has no more; return the exit status of a follower."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        comm = _communicator()
    except (ReferenceFailedError, ImportError) as error:
        # Rank 0 has the same error and reports it. Otherwise it would wait for this rank.
        time.sleep(_GRACE)
        print(f"palpate: rank {_size_and_rank()[1]}: {error}", file=sys.stderr, flush=True)
        return 2
    try:
        while True:
            while not comm.iprobe(source=0, tag=_TAG):
                time.sleep(_POLL)
            received = comm.recv(source=0, tag=_TAG)
            if received is None:
                return 0
            task, problem = received
            _together(comm, functools.partial(task, problem), say_nothing)
    except BaseException as error:
        _end_all(comm, 4, f"rank {comm.rank}: {type(error).__name__}: {error}")
        raise


def dismiss(code: int) -> None:
    """Let the followers go; called on rank 0 at its end, whatever happened, with its exit status.

    All ranks have that status if the others still wait for it in a task.
    """
    if num_ranks() == 1:
        return
    try:
        comm = _communicator()
    except (ReferenceFailedError, ImportError):
        return
    if _is_under_way:
        _abort(comm, code)
    for rank in range(1, comm.size):
        comm.send(None, dest=rank, tag=_TAG)


@functools.cache
def _communicator() -> Any:
    """A separate communicator of all ranks: dolfinx has pending barriers on COMM_WORLD."""
    require_available()
    names = (name for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
    taken = {number: signal.getsignal(number) for number in (getattr(signal, n) for n in names)}
    from palpate.reference.fenicsx import COMM

    # Once loaded, PETSc handles these signals itself, and ends all ranks with an exit status of
    # its own.
    for number, handler in taken.items():
        if handler is not None:
            signal.signal(number, handler)
    if COMM.size != num_ranks():
        raise ReferenceUnavailableError(
            f"mpirun started {num_ranks()} processes, and the MPI of FEniCSx sees {COMM.size}; "
            "use the mpirun that belongs to it"
        )
    return COMM.Dup()


def _together(
    comm: Any, part: Callable[[Progress], Any], progress: Progress
) -> tuple[Any, Exception | None]:
    """Do this rank's part; return its result, or its error, or on rank 0 that of another rank."""
    from palpate.reference.fenicsx import MPI, comes

    answer, error = None, None
    try:
        answer = part(progress)
    except Exception as own:
        error = own
    worst = np.array([0 if error is None else _exit_code(error)])
    everyone = comm.Iallreduce(MPI.IN_PLACE, worst, MPI.MAX)
    if error is None:
        everyone.Wait()
    elif not comes(everyone):
        # The others wait inside the task for a message that this rank will never send.
        _end_all(comm, _exit_code(error), f"rank {comm.rank}: {error}")
    if worst[0] == 0:
        return answer, None
    reports = comm.gather(None if error is None else f"rank {comm.rank}: {error}")
    if error is None and reports is not None:
        error = ReferenceCrashedError(int(worst[0]), next(line for line in reports if line))
    return None, error


def _set_alarm(seconds: float) -> None:
    """Have the system end this process after a time by an unhandled signal; 0 cancels this."""
    if hasattr(signal, "setitimer"):  # not on Windows
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _exit_code(error: Exception) -> int:
    if isinstance(error, InputError):
        return 2
    return 3 if isinstance(error, ReferenceFailedError) else 4


def _end_all(comm: Any, code: int, why: str) -> None:
    print(f"palpate: {why}", file=sys.stderr, flush=True)
    _abort(comm, code)


def _abort(comm: Any, code: int) -> None:
    sys.stdout.flush()
    time.sleep(_TO_BE_HEARD)
    comm.Abort(code)
