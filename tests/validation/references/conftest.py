"""What the tests of stored references share."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.validation.references.stored import content_hash, references_folder


@pytest.fixture
def copy_of(tmp_path: Path) -> Callable[[str], Path]:
    """A built-in case's references as a file of one's own."""
    return lambda name: Path(shutil.copy(references_folder() / f"{name}.npz", tmp_path))


@pytest.fixture
def rewrite() -> Callable[..., None]:
    """Change a file of references; its hash stays, is made anew ("new") or goes (None)."""

    def rewrite(path, *, change=None, hashed="old"):
        with np.load(path) as stored:
            arrays = {name: stored[name] for name in stored.files}
        header = json.loads(str(arrays["header"]))
        if change is not None:
            change(arrays, header)
        arrays["header"] = np.array(json.dumps(header, sort_keys=True))
        old = arrays.pop("sha256")
        if hashed is not None:
            arrays["sha256"] = old if hashed == "old" else np.array(content_hash(arrays))
        np.savez(path, **arrays)

    return rewrite
