"""Temporary files and folders that are swept by a later run when a kill left them behind.

The name carries the process's number and the process holds a lock on it: what has neither a
living process nor a holder of its lock is left over. The lock is what tells processes of other
machines and containers apart that share the folder.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

# Of scratch folders: palpate-PURPOSE-PROCESS-RANDOM.
_SCRATCH = re.compile(r"palpate-[a-z-]+-(?P<process>\d+)-[0-9a-f]{8}")
# Of what an internal error left for people to read; nobody reads it after this long [s].
_ERROR_TEXT = re.compile(r"palpate-error-\w+\.txt")
_ERROR_TEXT_AGE = 7 * 86400.0


def own_mark() -> str:
    """Process number and random digits, for a temporary name."""
    return f"{os.getpid()}-{secrets.token_hex(4)}"


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock that says that a temporary is in use; nothing where there are no locks."""
    handle = _lock(path)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def sweep(folder: Path, pattern: re.Pattern[str], remove: Callable[[Path], None]) -> None:
    """Remove what dead processes of this user left in a folder; trouble with it is no error.

    Args:
        folder: Where.
        pattern: Of the whole name, with the process's number as the group `process`.
        remove: What to do with each.
    """
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            match = pattern.fullmatch(entry.name)
            if match is None or not _is_own(entry) or _is_alive(int(match["process"])):
                continue
            path = Path(entry.path)
            handle = _lock(path)
            if handle is None:
                continue
            try:
                with contextlib.suppress(OSError):
                    remove(path)
            finally:
                os.close(handle)


@contextmanager
def scratch_folder(purpose: str) -> Iterator[Path]:
    """Yield an empty folder for one purpose, gone afterwards; those of killed runs go first.

    Args:
        purpose: A word of small letters and hyphens, part of the name.
    """
    parent = Path(tempfile.gettempdir())
    sweep_scratch(parent)
    folder = parent / f"palpate-{purpose}-{own_mark()}"
    folder.mkdir(mode=0o700)
    try:
        with held(folder):
            yield folder
    finally:
        _remove_tree(folder)


@functools.cache
def sweep_scratch(parent: Path) -> None:
    """Remove scratch folders of dead processes, and old texts of errors; once in a process."""
    sweep(parent, _SCRATCH, _remove_tree)
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(parent)):
            if _ERROR_TEXT.fullmatch(entry.name) and _is_own(entry):
                with contextlib.suppress(OSError):
                    if time.time() - entry.stat(follow_symlinks=False).st_mtime > _ERROR_TEXT_AGE:
                        Path(entry.path).unlink()


def _remove_tree(folder: Path) -> None:
    """Remove a folder of ours, what a simulator made unwritable included."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        for place, names, _ in os.walk(folder):
            for name in ("", *names):
                inner = Path(place, name)
                if not inner.is_symlink():
                    with contextlib.suppress(OSError):
                        inner.chmod(0o700)
        shutil.rmtree(folder, ignore_errors=True)


def _is_own(entry: os.DirEntry[str]) -> bool:
    """Whether it is this user's file or folder; a link is nobody's."""
    try:
        status = entry.stat(follow_symlinks=False)
    except OSError:
        return False
    is_plain = stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)
    return is_plain and hasattr(os, "getuid") and status.st_uid == os.getuid()


def _is_alive(process: int) -> bool:
    if os.name == "nt":
        return True  # there the signal 0 is Ctrl-C, not a question
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _lock(path: Path) -> int | None:
    """Lock a file or folder without waiting; None where it is held, or cannot be locked."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
