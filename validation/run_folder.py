"""A folder of results that is all old or all new: made beside, then swapped in one step.

Nothing that palpate did not write is ever removed: files of the user's own in the folder of an
old run are carried into the new one.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import held, own_mark, sweep
from palpate.validation.run_folder_rules import (
    RESULTS,
    RunFolderError,
    require_run_folder,
    some,
    unswapped,
)
from palpate.validation.run_marker import MARKER, files_of, folders_of, leave_marker, read_marker

__all__ = ["MARKER", "RESULTS", "RunFolderError", "require_run_folder", "run_folder"]

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_TEMPORARY = re.compile(r"\.(?P<target>.+)\.palpate-run-(?P<process>\d+)-[0-9a-f]{8}")


@contextmanager
def run_folder(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> Iterator[Path]:
    """Yield an empty folder beside `path`; swapped with it when the block succeeds.

    On failure, Ctrl-C included, the new folder is removed and the old one stays. Two runs at
    once each swap in their own complete folder; the later one stays. Where the old folder may
    not be replaced any more, the new run is left beside it.

    Args:
        path: See `require_run_folder`; so are the errors.
        inputs: Likewise.
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
        raise RunFolderError(path, f"cannot be written ({error.strerror or error})") from error
    try:
        with held(fresh):
            try:
                yield fresh
                leave_marker(fresh)
            except OSError as error:
                raise RunFolderError(
                    path,
                    f"could not be written ({error.strerror or error}); "
                    "what was there before is unchanged",
                ) from error
            try:
                require_run_folder(path, inputs=given)
                _swap_in(fresh, target)
            except (InputError, OSError) as error:
                beside = _free_name(target)
                fresh.rename(beside)
                raise RunFolderError(
                    path,
                    f"could not be replaced when the run was done, so it is in {beside} ({error})",
                ) from error
    finally:
        # After a swap this is the old run; after a failure the unfinished new one.
        with contextlib.suppress(OSError, InputError):
            _remove(fresh, target)


def _swap_in(fresh: Path, target: Path) -> None:
    mask = os.umask(0)
    os.umask(mask)
    fresh.chmod(0o777 & ~mask)
    for _ in range(20):
        if not (target / MARKER).exists():
            if os.name == "nt":  # where a rename takes nobody's place, not even an empty folder's
                with contextlib.suppress(OSError):
                    target.rmdir()
            try:
                fresh.rename(target)  # takes the place of an empty folder too, and of no other
                return
            except OSError:
                if not (target / MARKER).exists():
                    raise
                continue  # another run was faster: exchange with its folder
        _carry(target, fresh)
        if not _exchange(fresh, target):
            # No exchange on this system: a moment without the folder, never a mixture.
            old = target.with_name(f".{target.name}.palpate-run-{own_mark()}")
            target.rename(old)
            fresh.rename(target)
            old.rename(fresh)
        return
    raise RunFolderError(target, "could not be replaced; is it in use?")


def _carry(old: Path, fresh: Path) -> None:
    """Put the user's own files of an old run into a new one: as links where that works."""

    def look() -> tuple[list[str], list[str]]:
        marker = read_marker(old)
        listed = marker.hashes if marker is not None else {}
        made = {parent.as_posix() for name in listed for parent in Path(name).parents}
        return (
            [name for name in folders_of(old) if name not in made],
            [name for name in files_of(old) if name not in listed],
        )

    folders, files = unswapped(old, look)
    taken = [name for name in (*folders, *files) if os.path.lexists(fresh / name)]
    if taken:
        raise RunFolderError(
            old, f"your own files there have names of the new run's ({some(taken)}); move them"
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
    """Remove what a run wrote, and what `target` has as well; whatever else is there is kept.

    Without a marker it was never finished, and all of it is palpate's.
    """
    if not run.exists():
        return
    marker = read_marker(run)
    if marker is None:
        shutil.rmtree(run)
        return
    for name in files_of(run):
        if marker.is_own(run, name) or _is_same(run / name, target / name):
            (run / name).unlink()
    left = files_of(run)
    if left:
        # Written into the old folder in the very moment of the swap.
        kept = _free_name(target)
        run.rename(kept)
        print(f"palpate: kept in {kept}: {some(left)}", file=sys.stderr)
        return
    (run / MARKER).unlink()
    for name in reversed(folders_of(run)):
        (run / name).rmdir()
    run.rmdir()


def _target_of(left: Path) -> Path:
    """The folder that a killed run wanted to replace."""
    match = _TEMPORARY.fullmatch(left.name)
    assert match is not None
    return left.with_name(match["target"])


def _is_same(one: Path, other: Path) -> bool:
    """Whether two files are one by a link, or equal."""
    if one.is_symlink() or other.is_symlink():
        return one.is_symlink() and other.is_symlink() and one.readlink() == other.readlink()
    if not other.is_file() or not one.is_file():
        return False
    return one.samefile(other) or one.read_bytes() == other.read_bytes()


def _free_name(target: Path) -> Path:
    return target.with_name(f"{target.name}-{secrets.token_hex(3)}")


def _exchange(one: Path, other: Path) -> bool:
    """Swap two folders in one step (Linux renameat2); False where there is no such call."""
    if not sys.platform.startswith("linux"):
        return False
    library = ctypes.CDLL(None, use_errno=True)
    call = getattr(library, "renameat2", None)
    if call is None:
        return False
    result: int = call(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE)
    return result == 0
