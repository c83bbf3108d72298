"""The cache of compiled forms, which a killed run never corrupts for the next one.

FFCx marks a form as "being compiled" by a `.c` file and as ready by a `.c.cached` file beside it.
A run killed in between leaves the first without the second, and every later run waits for it and
fails with a TimeoutError. Here the folder is private to this version of palpate and dolfinx and is
used only under a lock, shared or exclusive, that the system releases when its process ends. A
process with the exclusive lock can therefore remove every `.c` without its `.c.cached`.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import palpate
from palpate.meshes.temporaries import scratch_folder

Made = TypeVar("Made")
# Attempts with the exclusive lock before the error is raised. Another process may have finished a
# missing form only just now; after this many attempts the failure has another cause.
_TRIES_ALONE = 3
_FOR_THIS_PROCESS = contextlib.ExitStack()
atexit.register(_FOR_THIS_PROCESS.close)


def cache_folder(dolfinx_version: str) -> Path:
    """Folder of compiled forms: $XDG_CACHE_HOME/palpate or ~/.cache/palpate, by versions.

    Falls back to a folder in the system's temporary one where that cannot be written, and to a
    folder for this process alone where the temporary one belongs to another user.
    """
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    name = f"forms-{palpate.__version__}-dolfinx-{dolfinx_version}-{python}"
    user = os.getuid() if hasattr(os, "getuid") else 0  # Windows: st_uid is 0 as well
    for parent in (Path(home) / "palpate", Path(tempfile.gettempdir()) / f"palpate-{user}"):
        folder = parent / name
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            # Code is loaded from here: never use a folder that another user owns.
            if os.access(folder, os.W_OK) and folder.stat().st_uid == user:
                return folder
    return _FOR_THIS_PROCESS.enter_context(scratch_folder("forms"))


def remove_unfinished(folder: Path) -> list[str]:
    """Remove the `.c` files of unfinished compilations; the caller has the exclusive lock."""
    names = {path.name for path in folder.iterdir()}
    unfinished = sorted(n for n in names if n.endswith(".c") and f"{n}.cached" not in names)
    for name in unfinished:
        (folder / name).unlink(missing_ok=True)
    return unfinished


def compiled_in(folder: Path, make: Callable[[], Made]) -> Made:
    """Call `make` with the compiled forms of a folder, which other processes use too; its result.

    It raises TimeoutError where another process compiles the same form, or has died doing so, and
    is called again when that process has ended.
    """
    tries_alone = 0
    while True:
        with locked(folder, alone=False):
            try:
                return make()
            except TimeoutError:
                if tries_alone == _TRIES_ALONE:
                    raise
        with locked(folder, wait=False) as is_alone:
            if is_alone:
                tries_alone += not remove_unfinished(folder)


@contextlib.contextmanager
def locked(folder: Path, *, alone: bool = True, wait: bool = True) -> Iterator[bool]:
    """Lock the folder, exclusively or shared; yields whether the lock was obtained.

    That may fail unless it waits for other processes, however long. Windows has no such lock: there
    two processes that compile the same form disturb each other.
    """
    try:
        import fcntl
    except ImportError:
        yield True
        return
    how = (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | (0 if wait else fcntl.LOCK_NB)
    with (folder / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, how)
        except BlockingIOError:
            yield False
            return
        try:
            yield True
        finally:
            fcntl.flock(lock, fcntl.LOCK_UN)
