"""What a run wrote into its folder: a list with sizes and hashes, kept in the folder itself.

By it alone a folder is known for a run's; a file that it does not list, or that has changed
since, is somebody's own.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from palpate.meshes.errors import InputError
from palpate.validation.versions import version_of

MARKER = ".palpate-run.json"
SCHEMA = 1


@dataclass(frozen=True)
class RunMarker:
    """SHA-256 of every file that a run wrote, by its path in the folder."""

    hashes: Mapping[str, str]

    def is_own(self, folder: Path, name: str) -> bool:
        """Whether a file of the folder is as the run wrote it."""
        path = folder / name
        return (
            name in self.hashes
            and not path.is_symlink()
            and path.is_file()
            and _hash(path) == self.hashes[name]
        )


def leave_marker(folder: Path) -> None:
    """List all files of a folder, which are a run's, in the folder."""
    listed = {name: _hash(folder / name) for name in files_of(folder)}
    document = {
        "palpate_run": SCHEMA,
        "palpate": version_of("palpate"),
        "about": "Files that palpate wrote, with their SHA-256: the next run may replace these "
        "and no others.",
        "files": listed,
    }
    text = json.dumps(document, indent=1) + "\n"
    (folder / MARKER).write_text(text, encoding="utf-8")


def read_marker(folder: Path) -> RunMarker | None:
    """What the run of a folder wrote; None where no run left a marker.

    Raises:
        InputError: A marker that is damaged, or of a later palpate.
    """
    path = folder / MARKER
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(_damaged(path)) from error
    if not isinstance(document, dict) or not isinstance(document.get("files"), dict):
        raise InputError(_damaged(path))
    if document.get("palpate_run") != SCHEMA:
        raise InputError(f"{path}: of another version of palpate; name another folder")
    files = document["files"]
    for name, digest in files.items():
        if not isinstance(digest, str) or not _is_inside(name):
            raise InputError(_damaged(path))
    return RunMarker(files)


def files_of(folder: Path) -> list[str]:
    """Everything in a folder that is no folder, links included, sorted; the marker is left out.

    Raises:
        OSError: A folder in it that cannot be read.
    """
    found = []
    for place, names, files in os.walk(folder, onerror=_raise):
        links = [name for name in names if Path(place, name).is_symlink()]
        found += [Path(place, name).relative_to(folder).as_posix() for name in (*files, *links)]
    return sorted(name for name in found if name != MARKER)


def folders_of(folder: Path) -> list[str]:
    """Folders in a folder, outer ones first; links are not followed."""
    found = []
    for place, names, _ in os.walk(folder, onerror=_raise):
        found += [Path(place, n).relative_to(folder).as_posix() for n in names]
    return sorted(name for name in found if not (folder / name).is_symlink())


def _raise(error: OSError) -> None:
    raise error


def _hash(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _is_inside(name: str) -> bool:
    parts = PurePosixPath(name)
    return bool(parts.parts) and not parts.is_absolute() and ".." not in parts.parts


def _damaged(path: Path) -> str:
    return (
        f"{path}: damaged, so what palpate wrote there is not known; "
        "look through the folder and remove it, or name another one"
    )
