"""Numbers that were found already, by what was run: a study that was cut goes on where it was.

In $XDG_CACHE_HOME/palpate/calibration or ~/.cache/palpate/calibration, a file for each problem and
way. Its name is a hash of the problem, the way, and every source that has a hand in the numbers:
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
from palpate.validation.studies.calibration.drawn import Drawn
from palpate.validation.versions import version_of


def kept_folder() -> Path:
    """Where numbers are kept; made where it is not there."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(home) / "palpate" / "calibration"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def file_of(folder: Path, drawn: Drawn, way: str) -> Path:
    """Where the numbers of a problem, found in a way, are kept."""
    told = json.dumps([drawn.name, drawn.maker, dict(drawn.given), way], sort_keys=True)
    key = hashlib.sha256(f"{told}\n{_sources_hash()}".encode()).hexdigest()[:16]
    return folder / f"{drawn.name}-{way}-{key}.json"


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
def _sources_hash() -> str:
    """Of every source that the numbers come from, and of the solver's version."""
    digest = hashlib.sha256(version_of("fenics-dolfinx").encode())
    rooms = [Path(folder) for room in (meshes, reference, references, metrics)
             for folder in room.__path__]  # fmt: skip
    for room in (*rooms, Path(__file__).parent):
        for file in sorted(room.rglob("*")):
            if file.suffix in (".py", ".npz"):
                digest.update(file.relative_to(room).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()
