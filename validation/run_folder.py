"""A folder of results that is all old or all new: written beside it, then swapped in one step.

A run lists the files that it wrote, with hashes, in a marker file in the folder. Only a folder
with such a marker is known as a run's and may be replaced: a file that is not listed, or has
changed since, belongs to the user. Nothing that palpate did not write is ever removed: the user's
own files in the folder of an old run are carried into the new one.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TypeVar

from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import file_hash
from palpate.meshes.temporaries import keep, locked, own_mark, removed_after, sweep
from palpate.validation.output_files import OutputError, require_folder
from palpate.validation.versions import version_of

# The file with the numbers of a run, for other programs.
RESULTS = "results.json"
MARKER = ".palpate-run.json"
_SCHEMA = 1
_SHOWN = 5
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_TEMPORARY = re.compile(r"\.(?P<target>.+)\.palpate-run-(?P<process>\d+)-[0-9a-f]{8}")
T = TypeVar("T")


@contextmanager
def run_folder(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> Iterator[Path]:
    """Yield an empty folder beside `path`; swapped with it when the block succeeds.

    On failure, Ctrl-C included, the new folder is removed and the old one stays. Two runs at
    once each swap in their own complete folder; the later one stays. Where the old folder may
    not be replaced any more, the new run is left beside it.

    Args:
        path: See `require_run_folder`, also for the errors.
        inputs: See `require_run_folder`.
    """
    given = list(inputs)
    require_run_folder(path, inputs=given)
    target = Path(os.path.realpath(path))
    fresh = target.with_name(f".{target.name}.palpate-run-{own_mark()}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target.parent, _TEMPORARY, lambda left: _remove(left, _target_of(left)))
        fresh.mkdir()
    except OSError as error:
        raise OutputError(path, f"cannot be written ({error.strerror or error})") from error

    def tidy_up(left: Path) -> None:
        # After a swap this is the old run; after a failure the unfinished new one.
        with contextlib.suppress(OSError, InputError):
            _remove(left, target)

    with removed_after(fresh, tidy_up), locked(fresh):
        try:
            yield fresh
            _write_marker(fresh)
        except OSError as error:
            raise OutputError(
                path,
                f"could not be written ({error.strerror or error}); "
                "what was there before is unchanged",
            ) from error
        try:
            require_run_folder(path, inputs=given)
            keep(fresh)  # after the swap it is the old run
            _swap_in(fresh, target)
        except (InputError, OSError) as error:
            beside = _free_name(target)
            fresh.rename(beside)
            raise OutputError(
                path,
                f"could not be replaced when the run was done, so it is in {beside} ({error})",
            ) from error


def require_run_folder(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a folder that a run may not replace, before anything is solved.

    Args:
        path: A folder that does not exist, is empty, or belongs to an earlier run.
        inputs: Files that the run reads; the folder may contain none of them.

    Raises:
        OutputError: It is a file, the current folder or one above it, home, a repository's root, a
            folder with an input or with files that no run wrote, or a run's files were changed.
    """
    target = require_folder(path, inputs=inputs)
    if target.is_mount():
        raise OutputError(path, "is a mount point and cannot be swapped; name a folder in it")
    if target.is_dir():
        _unswapped(target, lambda: _require_replaceable(path, target))
    above = next(folder for folder in target.parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise OutputError(path, f"cannot be written: {above} does not allow it")


def _require_replaceable(path: str | Path, target: Path) -> None:
    try:
        hashes = _read_marker(target)
        files = _files_of(target)
    except OSError as error:
        raise OutputError(path, f"cannot be read ({error.strerror or error})") from error
    if hashes is None and files:
        raise OutputError(
            path,
            f"holds files but no {MARKER}, so they are no palpate run's ({_some(files)}); look "
            "through it and remove it yourself, or name another folder",
        )
    listed = [name for name in files if name in (hashes or {})]
    changed = [name for name in listed if not _is_own(target, name, hashes or {})]
    if changed:
        raise OutputError(
            path,
            f"files of an earlier run that were changed since ({_some(changed)}) would be "
            "replaced; move them, or name another folder",
        )


def _unswapped(target: Path, look: Callable[[], T]) -> T:
    """Inspect a folder; repeat it where another run swapped in its own folder meanwhile."""
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
    raise OutputError(target, "other runs keep replacing it; name another folder")


def _number(folder: Path) -> int | None:
    try:
        return folder.stat().st_ino
    except OSError:
        return None


def _some(names: list[str]) -> str:
    """The first few names of a list, and how many more."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _write_marker(folder: Path) -> None:
    """Write the marker, which lists all files of a run's folder."""
    document = {
        "palpate_run": _SCHEMA,
        "palpate": version_of("palpate"),
        "about": "Files that palpate wrote, with their SHA-256: the next run may replace these "
        "and no others.",
        "files": {name: file_hash(folder / name) for name in _files_of(folder)},
    }
    text = json.dumps(document, indent=1) + "\n"
    (folder / MARKER).write_text(text, encoding="utf-8")


def _read_marker(folder: Path) -> dict[str, str] | None:
    """SHA-256 of every file that a run wrote, by its path in the folder; None without a marker.

    Raises:
        InputError: The marker is damaged, or was written by a later palpate.
    """
    path = folder / MARKER
    damaged = InputError(
        f"{path}: damaged, so what palpate wrote there is not known; "
        "look through the folder and remove it, or name another one"
    )
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise damaged from error
    if not isinstance(document, dict) or not isinstance(document.get("files"), dict):
        raise damaged
    if document.get("palpate_run") != _SCHEMA:
        raise InputError(f"{path}: of another version of palpate; name another folder")
    files: dict[str, str] = document["files"]
    for name, digest in files.items():
        parts = PurePosixPath(name)
        is_inside = parts.parts and not parts.is_absolute() and ".." not in parts.parts
        if not isinstance(digest, str) or not is_inside:
            raise damaged
    return files


def _is_own(folder: Path, name: str, hashes: Mapping[str, str]) -> bool:
    """Whether a file of the folder is unchanged since the run wrote it."""
    path = folder / name
    if name not in hashes or path.is_symlink() or not path.is_file():
        return False
    return file_hash(path) == hashes[name]


def _files_of(folder: Path) -> list[str]:
    """All files in a folder and its subfolders, links included, sorted; without the marker.

    Raises:
        OSError: A folder in it cannot be read.
    """
    found = []
    for where, names, files in os.walk(folder, onerror=_raise):
        links = [name for name in names if Path(where, name).is_symlink()]
        found += [Path(where, name).relative_to(folder).as_posix() for name in (*files, *links)]
    return sorted(name for name in found if name != MARKER)


def _folders_of(folder: Path) -> list[str]:
    """All subfolders of a folder, outer ones first; links are not followed."""
    found = []
    for where, names, _ in os.walk(folder, onerror=_raise):
        found += [Path(where, n).relative_to(folder).as_posix() for n in names]
    return sorted(name for name in found if not (folder / name).is_symlink())


def _raise(error: OSError) -> None:
    raise error


def _swap_in(fresh: Path, target: Path) -> None:
    mask = os.umask(0)
    os.umask(mask)
    fresh.chmod(0o777 & ~mask)
    for _ in range(20):
        if not (target / MARKER).exists():
            if os.name == "nt":  # a rename replaces nothing there, not even an empty folder
                with contextlib.suppress(OSError):
                    target.rmdir()
            try:
                fresh.rename(target)  # this replaces an empty folder too, and no other
                return
            except OSError:
                if not (target / MARKER).exists():
                    raise
                continue  # another run was faster: exchange with its folder
        _carry(target, fresh)
        if not _exchange(fresh, target):
            # This system has no exchange: the folder is missing for a moment, but never a mixture.
            old = target.with_name(f".{target.name}.palpate-run-{own_mark()}")
            target.rename(old)
            fresh.rename(target)
            old.rename(fresh)
        return
    raise OutputError(target, "could not be replaced; is it in use?")


def _carry(old: Path, fresh: Path) -> None:
    """Carry the user's own files from an old run into a new one, as links where possible."""

    def look() -> tuple[list[str], list[str]]:
        listed = _read_marker(old) or {}
        made = {parent.as_posix() for name in listed for parent in Path(name).parents}
        return (
            [name for name in _folders_of(old) if name not in made],
            [name for name in _files_of(old) if name not in listed],
        )

    folders, files = _unswapped(old, look)
    taken = [name for name in (*folders, *files) if os.path.lexists(fresh / name)]
    if taken:
        raise OutputError(
            old, f"your own files there have names of the new run's ({_some(taken)}); move them"
        )
    for name in folders:
        (fresh / name).mkdir(parents=True)
        shutil.copystat(old / name, fresh / name)
    for name in files:
        (fresh / name).parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(old / name, fresh / name, follow_symlinks=False)
        except OSError:
            shutil.copy2(old / name, fresh / name, follow_symlinks=False)


def _remove(run: Path, target: Path) -> None:
    """Remove what a run wrote, and what `target` has as well; everything else stays.

    Without a marker the run was never finished, and all of its files are palpate's.
    """
    if not run.exists():
        return
    hashes = _read_marker(run)
    if hashes is None:
        shutil.rmtree(run)
        return
    for name in _files_of(run):
        if _is_own(run, name, hashes) or _is_same(run / name, target / name):
            (run / name).unlink()
    left = _files_of(run)
    if left:
        # Files that were written into the old folder in the moment of the swap.
        beside = _free_name(target)
        run.rename(beside)
        print(f"palpate: left in {beside}: {_some(left)}", file=sys.stderr)
        return
    (run / MARKER).unlink()
    for name in reversed(_folders_of(run)):
        (run / name).rmdir()
    run.rmdir()


def _target_of(left: Path) -> Path:
    """The folder that an interrupted run was to replace."""
    match = _TEMPORARY.fullmatch(left.name)
    assert match is not None
    return left.with_name(match["target"])


def _is_same(one: Path, other: Path) -> bool:
    """Whether two files are the same by a link, or have equal contents."""
    if one.is_symlink() or other.is_symlink():
        return one.is_symlink() and other.is_symlink() and one.readlink() == other.readlink()
    if not other.is_file() or not one.is_file():
        return False
    return one.samefile(other) or one.read_bytes() == other.read_bytes()


def _free_name(target: Path) -> Path:
    return target.with_name(f"{target.name}-{secrets.token_hex(3)}")


def _exchange(one: Path, other: Path) -> bool:
    """Swap two folders in one step (Linux renameat2); False where there is no such call."""
    call = None
    if sys.platform.startswith("linux"):
        call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if call is None:
        return False
    result: int = call(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE)
    return result == 0
