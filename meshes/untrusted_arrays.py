"""Arrays from .npz files that others wrote: sizes are read, and judged, before any data is.

An .npz file is a zip file, in which six megabytes can stand for six gigabytes. Each array's header
says its shape and kind of number; what does not fit is refused with nothing unpacked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted_text import open_plain, shown_bytes

# What has no size known beforehand: a motion of a million numbers at a hundred times.
MOST_BYTES = 1024**3
# Truth values, whole numbers, reals, text.
_KINDS = "biufUS"
_PIECE = 1024**2
_Header = tuple[tuple[int, ...], bool, np.dtype[Any]]
_VERSION: Callable[[IO[bytes]], tuple[int, int]] = np.lib.format.read_magic
_HEADERS: dict[tuple[int, int], Callable[[IO[bytes]], _Header]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npz(
    path: str | Path, *, most_bytes: int = MOST_BYTES, names: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz file by name.

    Args:
        path: The file.
        most_bytes: What its arrays may take when unpacked, all together.
        names: Which arrays to read; the others are left alone. All where None.

    Raises:
        FileFormatError: Missing, damaged, or larger than `most_bytes` when unpacked.
    """
    with open_plain(path, most_bytes=4 * most_bytes) as stream:
        try:
            with ZipFile(stream) as archive:
                entries = {
                    entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()
                }
                wanted = {n: e for n, e in entries.items() if names is None or n in names}
                _require_room(path, archive, wanted, most_bytes)
                return {name: _array(path, archive, entry) for name, entry in wanted.items()}
        except FileFormatError:
            raise
        # Damage shows as any of a dozen kinds of error, the decompressor's own among them.
        except Exception as error:
            first_line = (str(error).splitlines() or [""])[0][:200]
            raise FileFormatError(
                path, f"cannot be read as npz ({first_line or type(error).__name__})"
            ) from error


def array_names(path: str | Path) -> list[str]:
    """Names of the arrays of an .npz file that can be read."""
    with ZipFile(path) as archive:
        return sorted(name.removesuffix(".npy") for name in archive.namelist())


def _require_room(
    path: str | Path, archive: ZipFile, entries: dict[str, ZipInfo], most_bytes: int
) -> None:
    """Judge the headers: the first hundred bytes of each array."""
    total = 0
    for name, entry in entries.items():
        if entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise FileFormatError(path, f"{name!r} is packed in a way numpy does not use")
        with archive.open(entry) as stream:
            shape, _, dtype = _header(stream)
        if dtype.kind not in _KINDS or dtype.itemsize == 0:
            raise FileFormatError(
                path, f"{name!r} holds {dtype}, which is neither numbers nor text"
            )
        size = math.prod(shape) * dtype.itemsize
        total += size
        if total > most_bytes:
            raise FileFormatError(
                path,
                f"{name!r} has shape {shape}: {shown_bytes(total)} when unpacked, at most "
                f"{shown_bytes(most_bytes)} here; damaged, or of another case?",
            )
        if entry.file_size < size:
            raise FileFormatError(path, f"{name!r} is shorter than its shape {shape} says")


def _header(stream: IO[bytes]) -> _Header:
    """Shape, whether columns come first, and kind of number."""
    version = _VERSION(stream)
    if version not in _HEADERS:
        raise ValueError(f"version {version} of the npy format")
    shape, columns_first, dtype = _HEADERS[version](stream)
    if any(not isinstance(n, int) or isinstance(n, bool) or n < 0 for n in shape):
        raise ValueError(f"shape {shape}")
    return shape, columns_first, dtype


def _array(path: str | Path, archive: ZipFile, entry: ZipInfo) -> NDArray[Any]:
    with archive.open(entry) as stream:
        shape, columns_first, dtype = _header(stream)
        size = math.prod(shape) * dtype.itemsize
        # Never more than was judged, whatever the zip file says of itself; piece by piece, so
        # that the data is there once.
        data = bytearray(size)
        for start in range(0, size, _PIECE):
            piece = stream.read(min(_PIECE, size - start))
            if len(piece) != min(_PIECE, size - start):
                raise FileFormatError(path, f"{entry.filename!r} is cut off")
            data[start : start + len(piece)] = piece
    array = np.frombuffer(data, dtype=dtype) if size else np.zeros(math.prod(shape), dtype)
    return array.reshape(shape, order="F" if columns_first else "C")
