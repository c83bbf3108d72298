"""Checks where outputs may go, before solving: never over an input or over each other."""

from __future__ import annotations

import os
import shlex
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from palpate.meshes.errors import InputError
from palpate.meshes.own_files import guard, may_replace

if TYPE_CHECKING:
    from palpate.validation.case import Case

# What a path leads to: the existing file itself, however the path is spelled.
_Identity: TypeAlias = tuple[int, int] | str
# Folders that version control keeps at the root of a repository.
_ROOTS = (".git", ".hg", ".svn")


class OutputError(InputError):
    """An output that would overwrite something, or cannot be written; `.path` names it."""

    def __init__(self, path: str | Path, reason: str) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: {reason}")


def require_outputs(
    outputs: Mapping[str, Path | None],
    *,
    inputs: Iterable[str | Path] = (),
    force: bool = False,
) -> None:
    """Refuse output files that would overwrite an input, each other or somebody else's file.

    Those that cannot be written are refused, too. What comes there while the run computes stays.

    Args:
        outputs: Output files by the option that names each; None where it was not given.
        inputs: Files that the run reads.
        force: Whether files that palpate did not write may be replaced.

    Raises:
        OutputError: An output is refused; nothing was touched.
    """
    read = {_identity(path): Path(path) for path in inputs}
    written: dict[_Identity, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        _require_writable(path)
        file = _identity(path)
        if file in read:
            raise OutputError(
                path, f"{option} would overwrite an input ({read[file]}); name another file"
            )
        # Small and capital letters are one where a file system does not distinguish them.
        name = file if isinstance(file, tuple) else unicodedata.normalize("NFC", file).casefold()
        if name in written:
            raise OutputError(
                path, f"{option} and {written[name]} name one file; give each its own"
            )
        written[name] = option
        if not (force or may_replace(path)):
            raise OutputError(
                path,
                f"was not written by palpate, and {option} would replace it; "
                "name another file, or say --force",
            )
        guard(path, force=force)


def require_reference_file(path: Path) -> None:
    """Refuse a file of a reference to be that is no stored reference.

    Raises:
        OutputError: Somebody else's file has this name.
    """
    if not may_replace(path):
        raise OutputError(path, "is no reference of palpate's, and would be replaced; move it")


def require_case_folder(
    folder: Path, *, inputs: Iterable[str | Path] = (), force: bool = False
) -> None:
    """Refuse a folder for `write_case_folder` whose files are not an exported case's.

    Args:
        folder: A folder that does not exist, has no files of those names, or has an exported case.
        inputs: Files that the run reads; the folder may contain none of them.
        force: Whether files of those names that palpate did not write may be replaced.

    Raises:
        OutputError: It is a file, a folder with files of those names, or a protected folder.
    """
    from palpate.validation.exchange.case_folder import FILES

    real = require_folder(folder, inputs=inputs)
    taken = [name for name in FILES if not may_replace(real / name)]
    if taken and not force:
        raise OutputError(
            folder,
            f"has files that are no exported case's ({', '.join(taken)}); name another, or say "
            "--force",
        )
    for name in FILES:
        guard(real / name, force=force)


def require_folder(path: str | Path, *, inputs: Iterable[str | Path] = ()) -> Path:
    """The real path of a folder to be, in which files of a run stand among nobody's own.

    Args:
        path: The folder, which may or may not exist.
        inputs: Files that the run reads.

    Raises:
        OutputError: It is a file, the current folder or one above it, home, a repository's root, or
            a folder with an input.
    """
    _identity(path)  # refuses what cannot be a path
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_dir():
        raise OutputError(path, "is a file; name a folder")
    here = Path(os.path.realpath(Path.cwd()))
    if here.is_relative_to(target):
        raise OutputError(
            path,
            "is the current folder, or one above it; "
            f"name a folder of its own, such as {Path(path) / 'out'}",
        )
    home = Path(os.path.realpath(os.path.expanduser("~")))  # noqa: PTH111
    if home.is_relative_to(target):
        raise OutputError(path, "is your home folder, or one above it; name a folder in it")
    for name in _ROOTS:
        if os.path.lexists(target / name):
            raise OutputError(
                path, f"is the root of a repository (it holds {name}); name a folder in it"
            )
    for file in inputs:
        if Path(os.path.realpath(file)).is_relative_to(target) and os.path.lexists(file):
            raise OutputError(path, f"holds {file}, which this run reads; name a folder of its own")
    return target


def input_files(
    cases: Sequence[Case], *others: str | Path | None, command: str | None = None
) -> list[Path]:
    """The files that a run reads: case files with their meshes and references, and others.

    Args:
        cases: Cases that are judged or solved.
        others: Further files; None is left out.
        command: A simulator's command line: every word of it that is a file here counts.
    """
    from palpate.validation.references.stored import accepted_path, pending_path

    files = [file for case in cases for file in case.files]
    for case in cases:
        files += [accepted_path(case.name, case.beside), pending_path(case.name, case.beside)]
    files += [Path(other) for other in others if other is not None]
    try:
        words = shlex.split(command or "")
    except ValueError:
        words = []  # it is refused where the command is run
    return files + [Path(word) for word in words if os.path.isfile(word)]  # noqa: PTH113


def _identity(path: str | Path) -> _Identity:
    """The same for every spelling of a path and every link to a file.

    Raises:
        OutputError: No file can have this path.
    """
    try:
        real = os.path.realpath(path)
    except ValueError as error:  # a NUL in it
        raise OutputError(path, f"no file can have this name ({error})") from error
    try:
        status = os.stat(real)  # noqa: PTH116
    except OSError:
        return real
    return status.st_dev, status.st_ino


def _require_writable(path: Path) -> None:
    _identity(path)  # refuses what cannot be a path
    real = Path(os.path.realpath(path))
    if real.is_symlink():
        raise OutputError(path, "is a link that leads nowhere but to itself; name another file")
    if real.is_dir():
        raise OutputError(path, "is a folder; name a file in it")
    if real.exists() and not real.is_file():
        raise OutputError(path, "is a device or a pipe; name a plain file")
    if not real.parent.is_dir():
        raise OutputError(path, f"there is no folder {path.parent}; make it first")
    if not os.access(real.parent, os.W_OK | os.X_OK):
        raise OutputError(path, f"{path.parent} cannot be written; name a file elsewhere")
    if real.exists() and not os.access(real, os.W_OK):
        raise OutputError(path, "may not be written; name another file")
