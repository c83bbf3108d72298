"""Numbers that were found already, by what was run: a study that was cut goes on where it was.

In $XDG_CACHE_HOME/palpate/STUDY or ~/.cache/palpate/STUDY, a file for each thing that was solved.
Its name ends with a hash of what was solved and of every source that has a hand in the numbers:
another reference, another key.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from palpate import meshes, reference
from palpate.meshes.atomic_write import write_text_atomically
from palpate.validation import metrics, references
from palpate.validation.versions import version_of


def kept_folder(study: str) -> Path:
    """Where numbers of a study are kept; made where it is not there."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(home) / "palpate" / study
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def kept_file(folder: Path, name: str, solved: Any, own: Path) -> Path:
    """Where the numbers of one thing are kept.

    Args:
        folder: Of all of the study's.
        name: What the file's name begins with.
        solved: What tells it apart, as plain values.
        own: Folder of the study's own sources.
    """
    told = json.dumps(solved, sort_keys=True)
    key = hashlib.sha256(f"{told}\n{_sources_hash(own)}".encode()).hexdigest()[:16]
    return folder / f"{name}-{key}.json"


def load_rows(file: Path) -> list[list[Any]] | None:
    """What is kept in a file; None where nothing is, or what is there cannot be read."""
    try:
        rows = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return rows if isinstance(rows, list) else None


def save_rows(file: Path, rows: Sequence[Sequence[Any]]) -> None:
    """Keep numbers."""
    write_text_atomically(file, json.dumps([list(row) for row in rows]))


@cache
def _sources_hash(own: Path) -> str:
    """Of every source that the numbers come from, and of the solver's version."""
    digest = hashlib.sha256(version_of("fenics-dolfinx").encode())
    rooms = [Path(folder) for room in (meshes, reference, references, metrics)
             for folder in room.__path__]  # fmt: skip
    for room in (*rooms, own):
        for file in sorted(room.rglob("*")):
            # Answers are the study's own; stored references have no hand in its numbers.
            if file.suffix == ".py" or (room == own and file.suffix == ".npz"):
                digest.update(file.relative_to(room).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()
