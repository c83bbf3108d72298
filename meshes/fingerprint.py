"""Hashes of what results are made of and made by: arrays, files, palpate itself."""

from __future__ import annotations

import functools
import hashlib
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROOMS = ("meshes", "fastsim", "reference", "validation")
_CODE = (".py", ".so", ".pyd")


def array_hash(what: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over a word on what they are, and name, type, shape and bytes of every array."""
    digest = hashlib.sha256(what.encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"|{name}|{array.dtype.str}|{array.shape}|".encode())
        if array.size:
            digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def file_hash(path: str | Path) -> str:
    """SHA-256 of a file's bytes."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@functools.cache
def palpate_hash() -> str:
    """SHA-256 over every source of palpate, its compiled core, and Python's and numpy's versions.

    A stored result is made by these; palpate's version would not do, since sources in place change
    without a new one.
    """
    root = Path(__file__).parents[1]
    files = (file for room in _ROOMS for file in (root / room).rglob("*") if file.suffix in _CODE)
    digest = hashlib.sha256(f"Python {platform.python_version()}, numpy {np.__version__}".encode())
    for file in sorted(files):
        digest.update(f"|{file.relative_to(root)}|{file_hash(file)}".encode())
    return digest.hexdigest()


def date_now() -> str:
    """The date and the time of day, to the second, in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")
