"""Which folder a run may replace: its own of before, by the marker in it, and no other."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from palpate.meshes.errors import InputError
from palpate.validation.run_marker import MARKER, files_of, read_marker

# The numbers of a run, for other programs.
RESULTS = "results.json"
# Folders that version control keeps at the root of a repository.
_ROOTS = (".git", ".hg", ".svn")
_SHOWN = 5
T = TypeVar("T")


class RunFolderError(InputError):
    """A folder that a run may not replace; `.path` names it."""

    def __init__(self, path: str | Path, reason: str) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: {reason}")


def require_run_folder(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a folder that a run may not replace, before anything is solved.

    Args:
        path: Not there yet, empty, or the folder of an earlier run.
        inputs: Files that the run reads; the folder may hold none of them.

    Raises:
        RunFolderError: A file, the current folder or one above it, home, a repository's root, a
            folder with an input, one with files but no run's, or a run's files that were changed.
    """
    try:
        target = Path(os.path.realpath(path))
    except ValueError as error:
        raise RunFolderError(path, f"no folder can have this name ({error})") from error
    if target.exists() and not target.is_dir():
        raise RunFolderError(path, "is a file; name a folder for the results")
    require_unprotected(path, inputs=inputs)
    if target.is_mount():
        raise RunFolderError(path, "is a mount point and cannot be swapped; name a folder in it")
    if target.is_dir():
        unswapped(target, lambda: _require_replaceable(path, target))
    above = next(folder for folder in target.parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise RunFolderError(path, f"cannot be written: {above} does not allow it")


def require_unprotected(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a folder in which nobody wants files of a run among his own.

    Args:
        path: Whether there or not.
        inputs: Files that the run reads.

    Raises:
        RunFolderError: The current folder or one above it, home, a repository's root, or a folder
            with an input.
    """
    target = Path(os.path.realpath(path))
    here = Path(os.path.realpath(Path.cwd()))
    if here.is_relative_to(target):
        raise RunFolderError(
            path,
            "is the current folder, or one above it; "
            f"name a folder of its own, such as {Path(path) / 'out'}",
        )
    home = Path(os.path.realpath(os.path.expanduser("~")))  # noqa: PTH111
    if home.is_relative_to(target):
        raise RunFolderError(path, "is your home folder, or one above it; name a folder in it")
    for name in _ROOTS:
        if os.path.lexists(target / name):
            raise RunFolderError(
                path, f"is the root of a repository (it holds {name}); name a folder in it"
            )
    for file in inputs:
        if Path(os.path.realpath(file)).is_relative_to(target) and os.path.lexists(file):
            raise RunFolderError(
                path, f"holds {file}, which this run reads; name a folder of its own"
            )


def _require_replaceable(path: str | Path, target: Path) -> None:
    try:
        marker = read_marker(target)
        files = files_of(target)
    except OSError as error:
        raise RunFolderError(path, f"cannot be read ({error.strerror or error})") from error
    if marker is None:
        if RESULTS in files:
            raise RunFolderError(
                path,
                f"has a {RESULTS} but no {MARKER}: a run of palpate 0.1, or a folder of your own; "
                "look through it and remove it yourself, or name another folder",
            )
        if files:
            raise RunFolderError(
                path, f"holds files that are no palpate run's ({some(files)}); name another folder"
            )
        return
    listed = [name for name in files if name in marker.hashes]
    changed = [name for name in listed if not marker.is_own(target, name)]
    if changed:
        raise RunFolderError(
            path,
            f"files of an earlier run that were changed since ({some(changed)}) would be "
            "replaced; move them, or name another folder",
        )


def unswapped(target: Path, look: Callable[[], T]) -> T:
    """Look at a folder, again where another run put its own in its place meanwhile."""
    for _ in range(20):
        before = _number(target)
        try:
            found = look()
        except (InputError, OSError):
            if _number(target) == before:
                raise
            continue
        if _number(target) == before:
            return found
    raise RunFolderError(target, "other runs keep replacing it; name another folder")


def _number(folder: Path) -> int | None:
    try:
        return folder.stat().st_ino
    except OSError:
        return None


def some(names: list[str]) -> str:
    """The first few names of a list, and how many more."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
