"""Runs a program and ends it, with all it started, on the caller's request or when the caller ends.

A script of its own without palpate, for Linux: python -I -S supervisor.py READ WRITE CALLER
PROGRAM... The caller writes to the pipe READ or closes it; the error number of a program that
cannot be started is written to WRITE. Processes that the program leaves behind, even in sessions
of their own, become children of this process (a "subreaper") and are ended with it. Its exit
status is the program's.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import select
import signal
import sys
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_STOPS = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_LIBRARY = ctypes.CDLL(None)


def main() -> int:
    """Run the program of the command line; return its exit status."""
    caller, trouble = int(sys.argv[1]), int(sys.argv[2])
    for handle in (caller, trouble):
        os.set_inheritable(handle, False)
    _LIBRARY.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    woken, wake = os.pipe()
    for handle in (woken, wake):
        os.set_blocking(handle, False)
    signal.set_wakeup_fd(wake)
    for number in (signal.SIGCHLD, *_STOPS):
        signal.signal(number, lambda *_: None)
    awaited = [caller, woken, *_caller_process(int(sys.argv[3]))]
    child = _start(sys.argv[4:], trouble)
    os.close(trouble)
    while not _has_ended(child):
        ready, _, _ = select.select(awaited, [], [])
        if ready != [woken] or set(os.read(woken, 4096)) & set(_STOPS):
            break
    return _end_as(_end_all(child))


def _caller_process(number: int) -> list[int]:
    """A descriptor that is readable when the caller ends; none where the system lacks pidfd.

    The pipe alone shows it too, unless a process that the caller forked has its other end open.
    """
    with contextlib.suppress(OSError, AttributeError):
        if os.getppid() == number:
            return [os.pidfd_open(number)]
    return []


def _start(command: list[str], trouble: int) -> int:
    child = os.fork()
    if child:
        return child
    try:
        os.setsid()
        _LIBRARY.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        for number in (signal.SIGPIPE, signal.SIGXFSZ):
            signal.signal(number, signal.SIG_DFL)  # Python ignores them
        os.execvp(command[0], command)
    except OSError as error:
        os.write(trouble, str(error.errno).encode("ascii"))
    finally:
        os._exit(127)


def _has_ended(child: int) -> bool:
    """Whether the program has ended; it is not reaped, so that its number is not used again."""
    while True:
        found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if found is None:
            return False
        if found.si_pid == child:
            return True
        os.waitpid(found.si_pid, 0)


def _end_all(child: int) -> int:
    """End the program's group and every descendant; return the program's wait status.

    Only children of this process are ended, whose numbers no other process can have; their own
    children then become children of this process and are ended in the next round.
    """
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    while children := _children():
        ended = []
        for number in children:
            with contextlib.suppress(PermissionError):
                os.kill(number, signal.SIGKILL)
                ended.append(number)
        for number in ended:
            os.waitpid(number, 0)
        if not ended:
            break  # processes of another user, which cannot be ended
    return status


def _children() -> list[int]:
    own = os.getpid()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            # PID (NAME) STATE PARENT ..., and the name may hold anything.
            _, _, rest = (folder / "stat").read_text(errors="replace").rpartition(")")
            if int(rest.split()[1]) == own:
                found.append(int(folder.name))
    return found


def _end_as(status: int) -> int:
    """The program's exit status; where a signal ended it, end by the same."""
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # one core file is enough
        if -code != signal.SIGKILL:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return abs(code)


if __name__ == "__main__":
    sys.exit(main())
