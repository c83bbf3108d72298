"""Numbers of text files, a row to a line, as quickly as numpy reads them; None where not so plain.

Whoever gets None reads the file word by word, which takes ten times as long and knows every kind of
line; what is found is the same.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Called with the part that is done, 0 to 1.
Done = Callable[[float], None]
# Lines read at once: a hundredth of a second.
_BLOCK = 20_000


def nobody(_done: float) -> None:
    """Report to nobody."""


def scaled(done: Done, first: float, last: float) -> Done:
    """Report a part of the work that goes from one part of the whole to another."""
    return lambda part: done(first + (last - first) * part)


def table(
    lines: Sequence[bytes],
    columns: Iterable[int] | None,
    kind: Any,
    done: Done = nobody,
) -> NDArray[Any] | None:
    """Columns of numbers, shape (num_lines, num_columns); what follows a # is left out.

    Args:
        lines: One row each.
        columns: Which of a line's words; None is all, as many in every line.
        kind: np.float64 or np.int64.
        done: Called after each block of lines.

    Returns:
        The numbers; None where a line has too few, or something else.
    """
    chosen: Any = None if columns is None else tuple(columns)
    blocks: list[NDArray[Any]] = []
    for first in range(0, len(lines), _BLOCK):
        block = lines[first : first + _BLOCK]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of lines without data, and of 1.5 as an index
                found = np.loadtxt(
                    list(block), kind, usecols=chosen, ndmin=2, comments="#", encoding="latin-1"
                )
        except (ValueError, OverflowError, Warning):
            return None
        if len(found) < len(block) or (blocks and found.shape[1] != blocks[0].shape[1]):
            return None
        blocks.append(found)
        done((first + len(block)) / len(lines))
    return np.concatenate(blocks) if blocks else None


def polygons_by_corners(
    lines: Sequence[bytes], done: Done = nobody
) -> dict[int, NDArray[np.int64]] | None:
    """Rows of as many indices as their first word says, by that number; the rest is left out."""
    words = [line.split(None, 1)[:1] for line in lines]
    kinds = {word[0] for word in words if word}
    if not (all(words) and all(word.isdigit() and len(word) < 5 for word in kinds)):
        return None
    found: dict[int, list[NDArray[np.int64]]] = {}
    for word in kinds:
        of_kind = lines if len(kinds) == 1 else _chosen(lines, words, word)
        rows = table(of_kind, range(1, int(word) + 1), np.int64, done) if int(word) else None
        if rows is None:
            return None
        found.setdefault(int(word), []).append(rows)
    if any(len(rows) > 1 for rows in found.values()):  # 3 and 03
        return None
    return {count: rows[0] for count, rows in sorted(found.items())}


def _chosen(lines: Sequence[bytes], words: list[list[bytes]], word: bytes) -> list[bytes]:
    return [line for line, first in zip(lines, words, strict=True) if first[0] == word]
