"""Cached results: each with its date, a hash of its content, and of all that made it.

A result is a record (NAME.json) and, where it has arrays, a file beside it (NAME.npz). It is used
where the caller asks for cached results by name, record and file have the hashes that they were
written with, and everything that made it is as it was. Else it is made again, and the reason is
reported. What this call has made itself is used in any case.
"""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import date_now, file_hash, palpate_hash
from palpate.meshes.temporaries import atomic_path, write_text_atomically
from palpate.meshes.untrusted import parse_json, read_text
from palpate.reference import availability
from palpate.validation.states import Progress


class _UnusableError(Exception):
    """Of a cached result; the message goes on from "the cached result"."""


# What made a result, by name: versions and hashes. None where that cannot be known: such a result
# is never used again.
Maker = Mapping[str, str]
_SCHEMA = 2
# Of Debian: every installed package with its version, shared libraries among them.
_SYSTEM = Path("/var/lib/dpkg/status")


def text_hash(*parts: str) -> str:
    """SHA-256 of several texts."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@functools.cache
def made_here() -> dict[str, str]:
    """What makes a result in this process: palpate, FEniCSx, and the system's packages."""
    return {"palpate": palpate_hash(), **availability.versions(), **system_packages()}


@functools.cache
def system_packages() -> dict[str, str]:
    """The hash of what the system has installed; nothing where that is not known."""
    return {"packages of the system": file_hash(_SYSTEM)} if _SYSTEM.is_file() else {}


@dataclass(frozen=True)
class CachedResult:
    """A result that was made before.

    Attributes:
        record: What is stored of it, as plain data.
        file: The file of its arrays, None where it has none.
        date: When it was made.
        is_from_before: Whether an earlier call made it.
    """

    record: Mapping[str, Any]
    file: Path | None
    date: str
    is_from_before: bool


class ResultCache:
    """A folder of results.

    Args:
        folder: Created if it does not exist.
        is_read: Whether results of earlier calls are used.

    Raises:
        InputError: The folder cannot be made.
    """

    def __init__(self, folder: Path, *, is_read: bool = False) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: no folder for results ({error.strerror})") from error
        self.folder, self.is_read = folder, is_read
        # Dates of what is used of earlier calls, by the record's name.
        self.used: dict[str, str] = {}
        self._own: set[Path] = set()

    def path(self, name: str, asked: str) -> Path:
        """The record of a result.

        Args:
            name: Its name for people.
            asked: A hash of what was asked.
        """
        return self.folder / f"{re.sub(r'[^A-Za-z0-9.-]', '_', name)}-{asked[:16]}.json"

    def read(
        self, name: str, asked: str, maker: Maker | None, progress: Progress
    ) -> CachedResult | None:
        """A result; None where it has to be made. Use of one from before, or why not, is reported.

        Args:
            name: See `path`.
            asked: See `path`.
            maker: What would make it now.
            progress: Called with a line.
        """
        path = self.path(name, asked)
        is_own = path in self._own
        if not (is_own or self.is_read) or not path.exists():
            return None
        try:
            document = self._checked(path, asked)
        except _UnusableError as error:
            progress(f"{name}: made again; the cached result {error}")
            return None
        before, date = document["made_by"], str(document["date"])
        if not is_own and (maker is None or before != dict(maker)):
            progress(
                f"{name}: made again; of the cached result of {date} {_changed(before, maker)}"
            )
            return None
        if not is_own:
            self.used[path.stem] = date
            progress(f"{name}: cached, of {date}")
        file = path.with_suffix(".npz") if document["file"] else None
        return CachedResult(document["record"], file, date, not is_own)

    def write(
        self,
        name: str,
        asked: str,
        maker: Maker | None,
        record: Mapping[str, Any],
        write_file: Callable[[Path], None] | None = None,
    ) -> None:
        """Store a result, its file first, so that no record exists without it.

        Args:
            name: See `path`.
            asked: See `path`.
            maker: What made it; where that is not known, nothing is stored.
            record: Plain data.
            write_file: Writes the file of its arrays.
        """
        if maker is None:
            return
        path, digest = self.path(name, asked), ""
        if write_file is not None:
            with atomic_path(path.with_suffix(".npz")) as temporary:
                write_file(temporary)
                digest = file_hash(temporary)
        document = {
            "cached_result": _SCHEMA,
            "name": name,
            "asked": asked,
            "date": date_now(),
            "made_by": dict(maker),
            "file": digest,
            "record": json.loads(json.dumps(record, default=str)),
        }
        document["sha256"] = _content_hash(document)
        write_text_atomically(path, json.dumps(document, indent=1) + "\n")
        self._own.add(path)

    def _checked(self, path: Path, asked: str) -> dict[str, Any]:
        """The document of a result whose contents have their hashes.

        Raises:
            _UnusableError: They have not, or it is of another question or version.
        """
        try:
            document: dict[str, Any] = parse_json(read_text(path), allow_nan=True)
            is_whole = document["sha256"] == _content_hash(document)
            if is_whole and document["file"]:
                is_whole = document["file"] == file_hash(path.with_suffix(".npz"))
            if not is_whole:
                raise _UnusableError("has changed since it was written: it has not its hash")
            if document["cached_result"] != _SCHEMA or document["asked"] != asked:
                raise _UnusableError("is of another question, or of another version of palpate")
        except (InputError, OSError, KeyError, TypeError) as error:
            raise _UnusableError(f"cannot be read ({error})") from error
        return document


def _content_hash(document: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in document.items() if key != "sha256"}
    return text_hash(json.dumps(rest, sort_keys=True))


def _changed(before: Mapping[str, str], now: Maker | None) -> str:
    if now is None:
        return "it is not known what makes it now"
    names = sorted({*before, *now})
    return f"{', '.join(n for n in names if before.get(n) != now.get(n))} changed since"
