"""How a command ends: by a verdict, an error or a signal, or with no reader left."""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, NoReturn, TextIO

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import discard_in_use
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.quoting import for_terminal_lines
from palpate.validation.states import CandidateFailedError, ExitCode

if TYPE_CHECKING:
    from typing_extensions import Buffer

_STOPS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
# The exit code of an error is that of the first class that fits.
_CODES: dict[type[Exception], ExitCode] = {
    InputError: ExitCode.UNUSABLE_INPUT,
    ReferenceUnavailableError: ExitCode.UNUSABLE_INPUT,
    ReferenceFailedError: ExitCode.INCONCLUSIVE,
    CandidateFailedError: ExitCode.FAILED,
}
# A process ends at the latest so long after a signal [s]. The core handles none while it computes,
# and a library may catch the error or wait for its own threads.
_PATIENCE = 4.0


@dataclass
class Stop:
    """The signal that asked to end, if there was one."""

    number: int | None = None


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Turn the signals that ask to end into KeyboardInterrupt, raised at the present statement.

    This yields the signal that it was: a library may catch the error as its own.

    Signals that are ignored, under nohup say, stay ignored. Where the main thread is deep in a
    computation, or waits for others while it tidies up, the process still ends after some seconds,
    with its child processes and its temporaries.
    """
    if threading.current_thread() is not threading.main_thread():
        yield Stop()  # only the main thread can take signals
        return
    asked = Stop()
    is_over = threading.Event()

    def stop(number: int, _frame: FrameType | None) -> NoReturn:
        asked.number = number
        for other in free:
            signal.signal(other, signal.SIG_IGN)  # a second one must not disturb the tidying
        raise KeyboardInterrupt

    # None means that C code handles the signal.
    free = [n for n in _STOPS if signal.getsignal(n) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, stop) for number in free}
    woken, wake = os.pipe()
    if hasattr(os, "set_blocking"):  # Windows: from Python 3.12 on
        os.set_blocking(wake, False)
    before_wake = signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    waiting = threading.Thread(target=_end_if_deaf, args=(woken, is_over), daemon=True)
    waiting.start()
    try:
        yield asked
    finally:
        is_over.set()
        signal.set_wakeup_fd(before_wake)
        os.close(wake)
        waiting.join()
        os.close(woken)
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_if_deaf(woken: int, is_over: threading.Event) -> None:
    while number := os.read(woken, 1):
        if number[0] in _STOPS and not is_over.wait(_PATIENCE):
            _end_now(number[0])


def _end_now(number: int) -> NoReturn:
    discard_in_use()
    os._exit(128 + number)


class _PatientFile(io.FileIO):
    """A stream whose reader may leave, as `head` does: the rest is discarded.

    Another error, a full disk say, is raised once: at the interpreter's end none can be reported.
    """

    is_lost = False

    def write(self, data: Buffer, /) -> int:
        view = memoryview(data)
        if self.is_lost:
            return view.nbytes
        try:
            return super().write(view) or 0
        except BrokenPipeError:
            self.is_lost = True
            return view.nbytes
        except OSError:
            self.is_lost = True
            raise


def outlive_readers() -> None:
    """Let standard output and error outlive their readers: the verdict does not depend on them."""
    sys.stdout = _patient(sys.stdout, sys.__stdout__)
    sys.stderr = _patient(sys.stderr, sys.__stderr__)


def quiet_archives() -> None:
    """Let an archive that could not be written end without a word: the error itself is reported."""
    if sys.unraisablehook is not sys.__unraisablehook__:
        return  # somebody else's

    def report(what: sys.UnraisableHookArgs) -> None:
        if getattr(what.object, "__qualname__", "") != "ZipFile.__del__":
            sys.__unraisablehook__(what)

    sys.unraisablehook = report


def _patient(stream: TextIO | None, original: TextIO | None) -> TextIO:
    if stream is None:  # the caller closed it; take its number before a file gets it
        return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123
    if stream is not original or not isinstance(stream, io.TextIOWrapper):
        return stream  # somebody else's
    stream.flush()
    raw = _PatientFile(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
    )


def end_soon(number: int) -> None:
    """Let the process end soon after a signal, whatever threads the interpreter waits for."""
    timer = threading.Timer(_PATIENCE, _end_now, (number,))
    timer.daemon = True
    timer.start()


def end_by(number: int) -> int:
    """Print that a signal ended a command, and return its exit code."""
    _say("stopped; nothing half-written was left")
    return 128 + number


def end_of(error: BaseException) -> int:
    """Print what ended a command, in a line, and return its exit code."""
    if isinstance(error, typer.Abort):  # typer's word for Ctrl-C, and for an end of file
        error = error.__cause__ or KeyboardInterrupt()
    if isinstance(error, KeyboardInterrupt):
        return end_by(signal.SIGINT)
    for kind, code in _CODES.items():
        if isinstance(error, kind):
            _say(str(error))
            return code
    if isinstance(error, OSError):
        _say(f"{error.filename or ''}: {error.strerror or error}")
        return ExitCode.UNUSABLE_INPUT
    # typer has its own copy of click or uses click itself: errors are known by their methods.
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        _say(_with_suggestion(error.format_message()))
        return ExitCode.UNUSABLE_INPUT
    handle, name = tempfile.mkstemp(prefix="palpate-error-", suffix=".txt", text=True)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        traceback.print_exception(error, file=file)
    _say(f"internal error: {type(error).__name__}: {error} ({name})")
    return ExitCode.INTERNAL_ERROR


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(for_terminal_lines(f"palpate: {line}"), file=sys.stderr)


def _with_suggestion(message: str) -> str:
    """The message about a word that is not in a list, with the one that was probably meant."""
    message = message.replace("Value error, ", "")
    found = re.search(r"'([^']*)' is not one of (.+)\.$", message)
    if found is None:
        return message
    near = difflib.get_close_matches(found[1], re.findall(r"'([^']*)'", found[2]), n=1)
    return f"{message} Did you mean '{near[0]}'?" if near else message
