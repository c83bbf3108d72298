"""JSON and TOML from files that others wrote, as plain data of sizes that can be used.

What the parsers let through and nothing here can use is refused too: tables nested a thousand
deep (every later step would run out of stack), whole numbers beyond what a float holds, files of
gigabytes.
"""

from __future__ import annotations

import json
import math
import os
import stat
import tomllib
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import Any

from palpate.meshes.errors import FileFormatError, InputError

# A case or a result goes five deep.
DEEPEST = 32
MOST_BYTES = 64 * 1024**2


class UntrustedTextError(InputError):
    """Text that is not what it claims to be, or is not to be used; the message says why."""


def parse_json(text: str, *, allow_nan: bool = False) -> Any:
    """The value of a JSON text.

    Args:
        text: The text.
        allow_nan: Let the words NaN and Infinity through, which Python writes.

    Raises:
        UntrustedTextError: Not JSON, nested too deep, or a number that no float holds.
    """

    def constant(word: str) -> float:
        if allow_nan:
            return float(word)
        raise UntrustedTextError(f"it holds {word}, which is no JSON")

    value = _parsed(lambda: json.loads(text, parse_constant=constant), "JSON")
    _require_floats(value, allow_nan=allow_nan)
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        UntrustedTextError: Not TOML, or nested too deep. Numbers that no float holds are left to
            whoever knows line and key.
    """
    tables: dict[str, Any] = _parsed(lambda: tomllib.loads(text), "TOML")
    return tables


def read_text(path: str | Path, *, most_bytes: int = MOST_BYTES) -> str:
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
    """A size for people: 12 kB, 5.9 GB."""
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
    _require_shallow(value, kind)
    return value


def _require_shallow(value: Any, kind: str) -> None:
    """Level by level, so that depth costs no stack."""
    level = [value]
    for _ in range(DEEPEST):
        level = [part for item in level for part in _parts(item)]
        if not level:
            return
    raise UntrustedTextError(f"not {kind} for use here: nested more than {DEEPEST} deep")


def _require_floats(value: Any, *, allow_nan: bool) -> None:
    """1e999 is JSON, and infinite; so is a one with four hundred zeros."""
    is_wrong = isinstance(value, int if allow_nan else int | float) and not is_a_float(value)
    if is_wrong:
        raise UntrustedTextError("not JSON for use here: a number no float can hold")
    for part in _parts(value):
        _require_floats(part, allow_nan=allow_nan)


def _parts(item: Any) -> list[Any]:
    if isinstance(item, dict):
        return list(item.values())
    return item if isinstance(item, list) else []


def is_a_float(value: float) -> bool:
    """Whether a number is finite, and a whole one within what a float can hold."""
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
