"""A folder of results that is all old or all new: made beside, then swapped in one step."""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.meshes.errors import InputError

# Written last into a run; a folder that has it is one of ours and may be replaced.
MARK = "results.json"
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


@contextmanager
def run_folder(path: str | Path) -> Iterator[Path]:
    """Yield an empty folder beside `path`; swapped with it when the block succeeds.

    On failure, Ctrl-C included, the new folder is removed and the old one stays. Two runs at
    once each swap in their own complete folder; the later one stays.

    Raises:
        InputError: `path` is a file, or a folder with things that are not a run's.
    """
    target = Path(path).absolute()
    if target.is_symlink():
        target = target.resolve()
    if target.exists() and not target.is_dir():
        raise InputError(f"{path}: is a file; name a folder for the results")
    if target.is_dir() and any(target.iterdir()) and not (target / MARK).is_file():
        raise InputError(f"{path}: holds files that are not a palpate run's; name another folder")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp"))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    try:
        try:
            yield fresh
        except OSError as error:
            raise InputError(
                f"{path}: could not be written ({error.strerror or error}); "
                "what was there before is unchanged"
            ) from error
        mask = os.umask(0)
        os.umask(mask)
        fresh.chmod(0o777 & ~mask)
        _swap_in(fresh, target)
    finally:
        # After a swap this is the old run; after a failure the unfinished new one.
        shutil.rmtree(fresh, ignore_errors=True)


def _swap_in(fresh: Path, target: Path) -> None:
    for _ in range(20):
        if target.exists():
            if _exchange(fresh, target):
                return
            # No exchange on this system: a moment without the folder, never a mixture.
            old = Path(
                tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".old")
            )
            target.rename(old / "run")
            fresh.rename(target)
            shutil.rmtree(old, ignore_errors=True)
            return
        try:
            fresh.rename(target)
            return
        except OSError:
            continue  # another run was faster: exchange with its folder
    raise InputError(f"{target}: could not be replaced; is it in use?")


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
