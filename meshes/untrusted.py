"""Files that others wrote, JSON, TOML, .npz and VTU: their sizes are checked before they are read.

What the parsers let through and nothing here can use is refused too: tables nested a thousand
deep (every later step would run out of stack), whole numbers beyond the range of a float, files of
gigabytes. In an .npz or a VTU file six megabytes of compressed data can unpack to six gigabytes:
the headers of the arrays are read, and what does not fit is refused with nothing unpacked.
"""

from __future__ import annotations

import base64
import json
import lzma
import math
import os
import re
import stat
import tomllib
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError, InputError

# Tables within tables; a case or a result is nested five deep.
DEEPEST = 32
MOST_TEXT_BYTES = 64 * 1024**2
# Unpacked arrays whose size is not known beforehand: a motion of a million numbers, 100 times.
MOST_BYTES = 1024**3
# numpy's letters of truth values, whole numbers, reals and text.
_KINDS = "biufUS"
_Header = tuple[tuple[int, ...], bool, np.dtype[Any]]
_READ: Callable[..., NDArray[Any]] = np.lib.format.read_array
_VERSION: Callable[[IO[bytes]], tuple[int, int]] = np.lib.format.read_magic
_HEADERS: dict[tuple[int, int], Callable[[IO[bytes]], _Header]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_SIZES = {
    f"{kind}{bits}": bits // 8
    for kind, widths in (("Float", (32, 64)), ("Int", (8, 16, 32, 64)), ("UInt", (8, 16, 32, 64)))
    for bits in widths
}
_DECOMPRESSORS: dict[str, Any] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}
# Of ASCII data: a digit and a space give one float64 at most.
_BYTES_PER_CHARACTER = 4


class UntrustedTextError(InputError):
    """Text of another format than expected, or that cannot be used; the message says why."""


def parse_json(text: str, *, allow_nan: bool = False) -> Any:
    """The value of a JSON text; with `allow_nan` also NaN and Infinity, which Python writes.

    Raises:
        UntrustedTextError: Not JSON, nested too deep, or a number beyond the range of a float.
    """

    def constant(word: str) -> float:
        if allow_nan:
            return float(word)
        raise UntrustedTextError(f"it holds {word}, which is no JSON")

    value = _parsed(lambda: json.loads(text, parse_constant=constant), "JSON")
    for part in _parts_of(value, "JSON"):
        # 1e999, or a one with four hundred zeros, is valid JSON.
        if isinstance(part, int if allow_nan else int | float) and not is_a_float(part):
            raise UntrustedTextError("not JSON for use here: a number no float can hold")
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        UntrustedTextError: Not TOML, or nested too deep. Numbers beyond the range of a float are
            left to the caller, who knows line and key.
    """
    tables: dict[str, Any] = _parsed(lambda: tomllib.loads(text), "TOML")
    return tables


def read_text(path: str | Path, *, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """The UTF-8 text of a file, without a byte order mark.

    Raises:
        FileFormatError: Missing, no plain file, too large, or not UTF-8.
    """
    try:
        with open_plain(path, most_bytes=most_bytes) as stream:
            return stream.read().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(path, f"not UTF-8 text ({error.reason})") from error


def open_plain(path: str | Path, *, most_bytes: int) -> BufferedReader:
    """A file opened to read bytes; pipes, devices and endless files are refused.

    Raises:
        FileFormatError: Missing, unreadable, no plain file, or larger than `most_bytes`.
    """
    try:
        kind = Path(path).stat()
        if not stat.S_ISREG(kind.st_mode):
            raise FileFormatError(path, "is no plain file")
        if kind.st_size > most_bytes:
            raise FileFormatError(
                path, f"takes {shown_bytes(kind.st_size)}; at most {shown_bytes(most_bytes)} here"
            )
        return Path(path).open("rb")
    except FileNotFoundError as error:
        raise FileFormatError(path, "no such file") from error
    # RuntimeError and ValueError: a loop of links, a NUL in the name.
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, FileFormatError):
            raise
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
        raise FileFormatError(path, f"cannot be opened ({reason})") from error


def shown_bytes(number: int) -> str:
    """A size as text: 12 kB, 5.9 GB."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number} bytes"


def _parsed(parse: Callable[[], Any], kind: str) -> Any:
    try:
        value = parse()
    except UntrustedTextError:
        raise
    except RecursionError as error:
        raise UntrustedTextError(f"not {kind} for use here: nested too deep") from error
    except (
        ValueError,
        OverflowError,
    ) as error:  # TOMLDecodeError and JSONDecodeError are the first
        raise UntrustedTextError(f"not {kind}: {error}") from error
    for _ in _parts_of(value, kind):
        pass
    return value


def _parts_of(value: Any, kind: str) -> Iterator[Any]:
    """A value and all within it, level by level, so that depth needs no stack.

    Raises:
        UntrustedTextError: Nested too deep.
    """
    level = [value]
    for _ in range(DEEPEST):
        yield from level
        tables = [list(item.values()) if isinstance(item, dict) else item for item in level]
        level = [part for parts in tables if isinstance(parts, list) for part in parts]
        if not level:
            return
    raise UntrustedTextError(f"not {kind} for use here: nested more than {DEEPEST} deep")


def is_a_float(value: float) -> bool:
    """Whether a number is finite and, if whole, within the range of a float."""
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def read_npz(
    path: str | Path, *, most_bytes: int = MOST_BYTES, names: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz file by name, all or those of `names`.

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
                return {name: _array(archive, entry) for name, entry in wanted.items()}
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
    """Check the sizes in the headers, the first hundred bytes of each array."""
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


def _array(archive: ZipFile, entry: ZipInfo) -> NDArray[Any]:
    """The array, which numpy reads piece by piece: never more than its header, checked before."""
    with archive.open(entry) as stream:
        return _READ(stream, allow_pickle=False)


def unpacked_bytes(path: str | Path, *, most_bytes: int) -> int:
    """Memory that the arrays of a VTU file take [bytes], found before they are unpacked.

    The numbers of points and cells and the header of each compressed array tell the size; a block
    that unpacks to more than its header says is refused as well.

    Raises:
        FileFormatError: More than `most_bytes`, or impossible headers.
    """
    with open_plain(path, most_bytes=4 * most_bytes) as stream:
        text: bytes = stream.read()
    try:
        return _Sizes(path, text, most_bytes).total()
    except FileFormatError:
        raise
    # XML, numbers and base64 that others wrote: damage shows as any kind of error.
    except Exception as error:
        first_line = (str(error).splitlines() or [""])[0][:200]
        raise FileFormatError(
            path, f"cannot be read as vtu ({first_line or type(error).__name__})"
        ) from error


class _Sizes:
    """Sizes of the arrays of one VTU file."""

    def __init__(self, path: str | Path, text: bytes, most_bytes: int) -> None:
        self.path, self.most_bytes = path, most_bytes
        self.raw: bytes | None = None
        try:
            self.root = ElementTree.fromstring(text)
        except ElementTree.ParseError:
            self.root, self.raw = _without_raw_data(text)
        order = "<" if self.root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        width = _SIZES[self.root.get("header_type", "UInt32")]
        self.header = np.dtype(f"{order}u{width}")
        self.compressor = self.root.get("compressor")
        if self.compressor is not None and self.compressor not in _DECOMPRESSORS:
            raise FileFormatError(path, f"compressor {self.compressor!r} is not known")
        appended = self.root.find("AppendedData")
        words = "" if appended is None else (appended.text or "").strip()
        self.appended = words[1:] if self.raw is None else ""

    def total(self) -> int:
        """Bytes of all arrays, each checked against its number of points or cells."""
        total = 0
        limits = self._limits()
        for array in self.root.iter("DataArray"):
            size = self._unpacked(array)
            if size > limits.get(array, size):
                raise FileFormatError(
                    self.path,
                    f"array {array.get('Name')!r} unpacks to {shown_bytes(size)}, its points or "
                    f"cells need {shown_bytes(limits[array])}; damaged?",
                )
            total += size
            if total > self.most_bytes:
                raise FileFormatError(
                    self.path,
                    f"unpacks to {shown_bytes(total)} or more, at most "
                    f"{shown_bytes(self.most_bytes)} here; damaged, or of another case?",
                )
        return total

    def _limits(self) -> dict[ElementTree.Element, int]:
        """Bytes that binary arrays by point and by cell may unpack to."""
        limits = {}
        for piece in self.root.iter("Piece"):
            points, cells = int(piece.attrib["NumberOfPoints"]), int(piece.attrib["NumberOfCells"])
            for table, rows in (("Points", points), ("PointData", points), ("CellData", cells)):
                for array in piece.findall(f"{table}/DataArray"):
                    if array.get("format", "ascii") != "ascii":
                        columns = int(array.get("NumberOfComponents") or 1)
                        limits[array] = rows * columns * _SIZES[array.attrib["type"]]
        return limits

    def _unpacked(self, array: ElementTree.Element) -> int:
        kind = array.get("format", "ascii")
        if kind == "ascii":
            return _BYTES_PER_CHARACTER * len(array.text or "")
        if kind == "binary":
            return self._of_data((array.text or "").strip())
        offset = int(array.attrib["offset"])
        if offset < 0:
            raise FileFormatError(self.path, f"offset {offset} of an array")
        return self._of_data(self.appended[offset:] if self.raw is None else self.raw[offset:])

    def _of_data(self, data: str | bytes) -> int:
        """Bytes that base64 text, or raw data, unpacks to."""
        width = self.header.itemsize
        first = int(np.frombuffer(_bytes(data, width), self.header)[0])
        if self.compressor is None:
            return min(first, len(data))
        length = (3 + first) * width
        if length > len(data):
            raise FileFormatError(self.path, f"{first} compressed blocks cannot be")
        _, block, last, *sizes = (int(n) for n in np.frombuffer(_bytes(data, length), self.header))
        declared = [block] * (first - 1) + [last or block] if first else []
        if sum(declared) > self.most_bytes:
            return sum(declared)
        packed = _bytes(
            data[_encoded(length) :] if isinstance(data, str) else data[length:], sum(sizes)
        )
        start = 0
        for size, out in zip(sizes, declared, strict=True):
            found = _DECOMPRESSORS[self.compressor]().decompress(
                packed[start : start + size], out + 1
            )
            if len(found) > out:
                raise FileFormatError(self.path, "a compressed block is larger than it says")
            start += size
        return sum(declared)


def _without_raw_data(text: bytes) -> tuple[ElementTree.Element, bytes]:
    """The XML around raw appended data, which is no XML, and the data after its underscore."""
    opening = re.search(rb"<AppendedData[^>]*>", text)
    closing = text.rfind(b"</AppendedData>")
    if opening is None or closing < 0:
        raise ValueError("damaged XML")
    root = ElementTree.fromstring(text[: opening.end()] + text[closing:])
    return root, text[opening.end() : closing].split(b"_", 1)[1]


def _encoded(length: int) -> int:
    """Number of base64 characters for `length` bytes."""
    return -(-length // 3) * 4


def _bytes(data: str | bytes, length: int) -> bytes:
    """The first bytes of base64 text, or of raw data."""
    if isinstance(data, bytes):
        return data[:length]
    return base64.b64decode(data[: _encoded(length)])[:length]


@contextmanager
def limited_memory(most_bytes: int) -> Iterator[None]:
    """Let the process grow by at most `most_bytes`; a larger request is a MemoryError.

    For short calls into readers that reserve whatever a file asks for. Applies to the whole
    process, and on Linux only: elsewhere it does nothing.
    """
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):
        yield
        return
    old, hardest = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * resource.getpagesize() + most_bytes
    limits = [n for n in (old, hardest) if n != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([wanted, *limits]), hardest))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (old, hardest))
