"""What a board has computed already, kept beside it: answers, and truths under other laws.

A file holds what its key says and nothing else: a case, a law, an adapter or a time limit that
has changed has another key, and is computed anew. Each file is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.atomic_write import atomic_path, write_text_atomically
from palpate.meshes.untrusted_text import UntrustedTextError, parse_json, read_text
from palpate.validation.exchange.result_files import ResultFile, ResultFileError, read_result

_ARRAYS = ("times", "points", "cells", "original_id")


def key_of(*parts: str) -> str:
    """One key of several."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


class Kept:
    """A folder of runs.

    Args:
        folder: Made where it is not there.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder

    def path(self, name: str, key: str, suffix: str) -> Path:
        """Where what has this key lies."""
        return self.folder / f"{re.sub(r'[^A-Za-z0-9.-]', '_', name)}-{key[:16]}{suffix}"

    def read(self, name: str, key: str) -> tuple[dict[str, Any], ResultFile | None] | None:
        """A run's record and its answer; None where there is none that can be read."""
        try:
            record = parse_json(read_text(self.path(name, key, ".json")))
            if not isinstance(record, dict) or record.get("key") != key:
                return None
            if not record.get("has_answer"):
                return record, None
            return record, read_result(self.path(name, key, ".npz"))
        except (OSError, UntrustedTextError, ResultFileError, ValueError):
            return None

    def write(self, name: str, key: str, record: dict[str, Any], answer: ResultFile | None) -> None:
        """Keep a run: the answer first, so that a record never stands alone."""
        if answer is not None:
            fields = {one: getattr(answer, one) for one in _ARRAYS}
            what = "positions" if answer.are_positions else "displacement"
            with atomic_path(self.path(name, key, ".npz")) as new, new.open("wb") as stream:
                np.savez_compressed(
                    stream,
                    **{what: answer.values},
                    **{one: value for one, value in fields.items() if value is not None},
                    case_key=answer.case_key,
                    about=json.dumps(answer.about, default=str),
                )
        document = {**record, "key": key, "has_answer": answer is not None}
        text = json.dumps(document, indent=1, default=str)
        write_text_atomically(self.path(name, key, ".json"), text + "\n")
