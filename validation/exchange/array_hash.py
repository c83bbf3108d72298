"""The hash by which arrays are known again: of a case, of a problem, of a file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def array_hash(what: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over a word on what they are, and name, type, shape and bytes of every array."""
    digest = hashlib.sha256(what.encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"|{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
