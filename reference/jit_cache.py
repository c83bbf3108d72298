"""The cache of compiled forms, which a killed run never corrupts for the next one.

FFCx marks a form as "being compiled" by a `.c` file and as ready by a `.c.cached` file beside it.
A run killed in between leaves the first without the second, and every later run waits for it and
fails with a TimeoutError. Here the folder is private to this version of palpate and dolfinx and is
used only under a lock, shared or exclusive, that the system releases when its process ends. A
process with the exclusive lock can therefore remove every `.c` without its `.c.cached`.

The name of a form has the hash of what it computes, but not of what was compiled. So each has a
`.sha256` with the hash of its library, of the versions of FEniCSx and of the compiler. A process
checks all of them before its first form; those that have not their hash are compiled again.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import palpate
from palpate.meshes.fingerprint import file_hash
from palpate.meshes.temporaries import scratch_folder, write_text_atomically
from palpate.reference import availability

Made = TypeVar("Made")
# Attempts with the exclusive lock before the error is raised. Another process may have finished a
# missing form only just now; after this many attempts the failure has another cause.
_TRIES_ALONE = 3
# Endings of the file that FFCx writes when a form is compiled, and of its hash.
_READY, _HASH = ".c.cached", ".sha256"
# Folders whose forms this process has checked.
_CHECKED: set[Path] = set()
# When folders were changed last, as this process saw them with a hash for every form.
_NOTED: dict[Path, int] = {}
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


@functools.cache
def made_by() -> str:
    """What compiles a form here: versions of Python and FEniCSx, and the compiler."""
    words = str(sysconfig.get_config_var("CC") or "cc").split()
    compiler = os.path.realpath(shutil.which(words[0]) or words[0])
    with contextlib.suppress(OSError):
        found = os.stat(compiler)  # noqa: PTH116
        compiler += f", {found.st_size} bytes of {found.st_mtime_ns}"
    return f"{availability.versions()}, {compiler}"


def changed_forms(folder: Path) -> list[str]:
    """Names of finished forms that have not the hash that they were compiled with, or none."""
    libraries, notes = _libraries(folder), {path.name for path in folder.glob(f"*{_HASH}")}
    return sorted(
        name
        for name in _finished(folder)
        if name + _HASH not in notes
        or (folder / f"{name}{_HASH}").read_text("utf-8") != _form_hash(libraries.get(name, []))
    )


def check_forms(folder: Path) -> None:
    """Remove forms that have changed, once in a process; the caller has the exclusive lock."""
    if folder not in _CHECKED:
        for name in changed_forms(folder):
            for file in folder.glob(f"{name}.*"):
                file.unlink(missing_ok=True)
        _CHECKED.add(folder)


def note_forms(folder: Path) -> None:
    """Write the hashes of the forms that have been compiled just now; the caller has a lock."""
    changed = folder.stat().st_mtime_ns
    if _NOTED.get(folder) == changed:  # nothing was compiled; to list a thousand forms takes long
        return
    notes = {path.name for path in folder.glob(f"*{_HASH}")}
    new = [name for name in _finished(folder) if name + _HASH not in notes]
    libraries = _libraries(folder) if new else {}
    for name in new:
        write_text_atomically(folder / f"{name}{_HASH}", _form_hash(libraries.get(name, [])))
    if not new:
        _NOTED[folder] = changed


def _finished(folder: Path) -> list[str]:
    return [path.name.removesuffix(_READY) for path in folder.glob(f"*{_READY}")]


def _libraries(folder: Path) -> dict[str, list[Path]]:
    """The compiled libraries by the name of their form."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix in (".so", ".pyd"):
            found.setdefault(path.name.partition(".")[0], []).append(path)
    return found


def _form_hash(libraries: list[Path]) -> str:
    digest = hashlib.sha256(made_by().encode())
    for library in libraries:
        digest.update(file_hash(library).encode())
    return digest.hexdigest()


def compiled_in(folder: Path, make: Callable[[], Made]) -> Made:
    """Call `make` with the compiled forms of a folder, which other processes use too; its result.

    It raises TimeoutError where another process compiles the same form, or has died doing so, and
    is called again when that process has ended.
    """
    tries_alone = 0
    if folder not in _CHECKED:
        with locked(folder, alone=False):
            changed = changed_forms(folder)
        if changed:
            with locked(folder):
                check_forms(folder)
        _CHECKED.add(folder)
    while True:
        with locked(folder, alone=False):
            try:
                made = make()
                note_forms(folder)
                return made
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
