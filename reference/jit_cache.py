"""Where compiled forms are kept, so that a killed run never spoils the next one.

FFCx marks a form as "being compiled" by a `.c` file and as ready by a `.c.cached` file beside it.
A run killed in between leaves the first without the second, and every later run waits for it and
fails with a TimeoutError. Here the folder is private to this version of palpate and dolfinx and is
only used under a lock that the system releases when its holder dies; so whoever holds the lock
knows that a `.c` without its `.c.cached` is a dead run's, and removes it.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import palpate
from palpate.meshes.temporaries import scratch_folder

_FOR_THIS_PROCESS = contextlib.ExitStack()
atexit.register(_FOR_THIS_PROCESS.close)


def cache_folder(dolfinx_version: str) -> Path:
    """Folder of compiled forms: $XDG_CACHE_HOME/palpate or ~/.cache/palpate, by versions.

    Falls back to a folder under the system's temporary one where that cannot be written, and to
    one for this process alone where that is somebody else's.
    """
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    name = f"forms-{palpate.__version__}-dolfinx-{dolfinx_version}-{python}"
    user = os.getuid() if hasattr(os, "getuid") else 0  # Windows: st_uid is 0 as well
    for parent in (Path(home) / "palpate", Path(tempfile.gettempdir()) / f"palpate-{user}"):
        folder = parent / name
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            # Code is loaded from here: never from a folder that somebody else owns.
            if os.access(folder, os.W_OK) and folder.stat().st_uid == user:
                return folder
    return _FOR_THIS_PROCESS.enter_context(scratch_folder("forms"))


def remove_unfinished(folder: Path) -> list[str]:
    """Remove the `.c` files of compilations that never finished; call with the lock held."""
    names = {path.name for path in folder.iterdir()}  # once: every form that is loaded asks
    unfinished = sorted(n for n in names if n.endswith(".c") and f"{n}.cached" not in names)
    for name in unfinished:
        (folder / name).unlink(missing_ok=True)
    return unfinished


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; waits for another process that is compiling, however long.

    Windows has no such lock: there two processes that compile the same form disturb each other.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.flock(lock, fcntl.LOCK_UN)
