"""Programs in processes of their own, which end with this process in whatever way it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

_SUPERVISOR = Path(__file__).with_name("supervisor.py")
# A supervisor that has not finished after this time is ended itself [s].
_PATIENCE = 10.0


@contextmanager
def supervised(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a program; it and whatever it started end with the block, or with this process.

    On Linux that is so even after a kill -9 of this process, and for processes that left the
    program's session. Elsewhere the program's process group ends with the block; on Windows the
    program alone.

    Args:
        command: Program and arguments.
        options: Options of subprocess.Popen: its streams, env, cwd, text.

    Yields:
        The process, whose exit status is the program's.

    Raises:
        OSError: The program cannot be started.
    """
    words = [os.fspath(word) for word in command]
    if not sys.platform.startswith("linux"):
        process = subprocess.Popen(words, start_new_session=True, **options)
        try:
            yield process
        finally:
            _end_group(process)
        return
    with contextlib.ExitStack() as handles:
        theirs, ours = _pipe(handles)
        number_pipe, trouble = _pipe(handles)
        supervisor = [sys.executable, "-I", "-S", str(_SUPERVISOR)]
        numbers = [str(number) for number in (theirs.fileno(), trouble.fileno(), os.getpid())]
        process = subprocess.Popen(
            [*supervisor, *numbers, *words],
            start_new_session=True,
            pass_fds=(theirs.fileno(), trouble.fileno()),
            **options,
        )
        try:
            trouble.close()
            number = number_pipe.read(16)  # nothing, once the program runs
            if number:
                _close_streams(process)
                raise OSError(int(number), os.strerror(int(number)), words[0])
            yield process
        finally:
            with contextlib.suppress(OSError):
                ours.write(b".")
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_PATIENCE)
            if process.returncode is None:
                _end_group(process)


def run_supervised(
    command: Sequence[str | Path], *, time_limit: float, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end and return its output as text; options are those of `supervised`.

    Raises:
        subprocess.TimeoutExpired: No end within the time limit [s]; it and whatever it started
            have been ended.
        OSError: The program cannot be started.
    """
    streams: dict[str, Any] = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
    }
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(
            supervised(command, text=True, errors="replace", **streams, **options)
        )
        stack.callback(_close_streams, process)
        said, errors = process.communicate(timeout=time_limit)
    return subprocess.CompletedProcess(process.args, process.returncode, said, errors)


def _close_streams(process: subprocess.Popen[Any]) -> None:
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def _pipe(handles: contextlib.ExitStack) -> tuple[FileIO, FileIO]:
    """Both ends of a pipe, closed at the end."""
    reading, writing = os.pipe()
    return (
        handles.enter_context(FileIO(reading, "r")),
        handles.enter_context(FileIO(writing, "w")),
    )


def _end_group(process: subprocess.Popen[Any]) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if sys.platform == "win32":  # without process groups: children of the program go on
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
