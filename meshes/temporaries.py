"""Temporary files and folders, and files that appear whole or not at all.

What a killed run leaves behind is removed by a later run. The name of a temporary carries the
process's number, and the process keeps a lock on it: where neither the process nor the lock is
alive, nobody uses it any more. The lock protects processes on other machines and in other
containers that use the same folder.
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

# Names of scratch folders: palpate-PURPOSE-PROCESS-RANDOM.
_SCRATCH = re.compile(r"palpate-[a-z-]+-(?P<process>\d+)-[0-9a-f]{8}")
# Of files that are being written.
_HALF_WRITTEN = re.compile(r"\..+\.palpate-(?P<process>\d+)-[0-9a-f]{8}\.tmp(\.\w+)?")
# Names of texts that an internal error left for people to read; removed after this time [s].
_ERROR_TEXT = re.compile(r"palpate-error-\w+\.txt")
_ERROR_TEXT_AGE = 7 * 86400.0
# When this process loaded this file, less the granularity of the times of files [s].
_STARTED = time.time() - 5.0
# Temporaries that this process has at the moment.
_in_use: set[Path] = set()


def own_mark() -> str:
    """Process number and random digits, for a temporary name."""
    return f"{os.getpid()}-{secrets.token_hex(4)}"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a temporary for as long as it is in use; does nothing where there are no locks."""
    handle = _lock(path)
    _in_use.add(path)
    try:
        yield
    finally:
        _in_use.discard(path)
        if handle is not None:
            os.close(handle)


def keep(path: Path) -> None:
    """Let `discard_in_use` leave a temporary: what it holds may be more than palpate's."""
    _in_use.discard(path)


def discard_in_use() -> None:
    """Remove what this process has in use, before it ends without tidying up; never fails."""
    for path in list(_in_use):
        with contextlib.suppress(OSError):
            _remove_tree(path) if path.is_dir() else path.unlink()


def sweep(folder: Path, pattern: re.Pattern[str], remove: Callable[[Path], None]) -> None:
    """Remove what dead processes of this user left in a folder; failures are ignored.

    `pattern` is that of the whole name, with the process's number as the group `process`.
    """
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            match = pattern.fullmatch(entry.name)
            if match is None or not _is_own(entry) or _may_be_used(entry, int(match["process"])):
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
    """Yield an empty folder that is removed afterwards; removes those of killed runs first.

    `purpose` is a part of the name: small letters and hyphens.
    """
    parent = Path(tempfile.gettempdir())
    sweep_scratch(parent)
    folder = parent / f"palpate-{purpose}-{own_mark()}"
    with removed_after(folder, _remove_tree):
        folder.mkdir(mode=0o700)
        with locked(folder):
            yield folder


@contextmanager
def removed_after(path: Path, remove: Callable[[Path], None]) -> Iterator[None]:
    """Remove a temporary at the end of the block, also where a signal interrupts the removing."""
    try:
        yield
    finally:
        try:
            remove(path)
        except BaseException:
            remove(path)  # a second signal is ignored
            raise


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


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, renamed onto it when the block succeeds.

    The temporary name keeps the suffix, since writers choose the format by it. On any failure,
    Ctrl-C included, the temporary file is removed and an old `path` stays as it was. A link stays
    a link: what it points to is replaced.
    """
    target = Path(os.path.realpath(path))
    _sweep_beside(target.parent)
    name = f".{target.stem[:40]}.palpate-{own_mark()}.tmp{target.suffix}"
    temporary = target.with_name(name)
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
        with locked(temporary):
            yield temporary
            with temporary.open("rb+") as written:
                os.fsync(written.fileno())
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # 0600 would lock colleagues out
        temporary.replace(target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        # A full disk has no name, and a folder that has vanished is no matter of the temporary.
        names = (None, os.fspath(temporary))
        if isinstance(error, OSError) and error.errno and error.filename in names:
            raise OSError(error.errno, error.strerror, os.fspath(path)) from error
        raise


def write_text_atomically(path: str | Path, text: str) -> None:
    """Write UTF-8 text so that `path` has the old text or the new one, never a part."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@functools.cache
def _sweep_beside(folder: Path) -> None:
    """Remove what killed runs left in a folder; once in a process."""
    sweep(folder, _HALF_WRITTEN, Path.unlink)


def _remove_tree(folder: Path) -> None:
    """Remove a scratch folder, including what a simulator made unwritable."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        for inside, names, _ in os.walk(folder):
            for name in ("", *names):
                inner = Path(inside, name)
                if not inner.is_symlink():
                    with contextlib.suppress(OSError):
                        inner.chmod(0o700)
        shutil.rmtree(folder, ignore_errors=True)


def _is_own(entry: os.DirEntry[str]) -> bool:
    """Whether it is a file or folder of this user; links never count as such."""
    try:
        status = entry.stat(follow_symlinks=False)
    except OSError:
        return False
    is_plain = stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)
    return is_plain and hasattr(os, "getuid") and status.st_uid == os.getuid()


def _may_be_used(entry: os.DirEntry[str], process: int) -> bool:
    """Whether its process lives; an older one of our own number (in a container) does not."""
    if process == os.getpid():
        return entry.stat(follow_symlinks=False).st_mtime > _STARTED
    return _is_alive(process)


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
    """Lock a file or folder without waiting; None where it is locked, or cannot be locked."""
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
