"""Whether FEniCSx is installed, and in which versions, found without importing it."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys

from palpate.reference.errors import ReferenceUnavailableError

# Import names with the distribution names under which Debian, conda and PyPI know them.
_PARTS = {
    "dolfinx": ("fenics-dolfinx", "dolfinx", "dolfinx-solver-real"),
    "basix": ("fenics-basix",),
    "ffcx": ("fenics-ffcx",),
    "ufl": ("fenics-ufl",),
    "petsc4py": ("petsc4py", "petsc"),
    "numpy": ("numpy",),
}


def is_available() -> bool:
    """Whether FEniCSx is installed for this Python (found, not yet loaded)."""
    return all(importlib.util.find_spec(name) for name in ("dolfinx", "petsc4py", "ufl"))


def require_available() -> None:
    """Raise ReferenceUnavailableError, with the remedy, where FEniCSx is not installed."""
    if not is_available():
        raise ReferenceUnavailableError(
            "FEniCSx (dolfinx) is not installed for this Python; apt-get install python3-dolfinx "
            "(Debian), or pip install dolfinx-solver-real (Python 3.12 or newer)"
        )


def versions() -> dict[str, str]:
    """Versions of Python and of the parts of FEniCSx that are installed, as text."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for part, distributions in _PARTS.items():
        for name in distributions:
            try:
                found[part] = importlib.metadata.version(name)
                break
            except importlib.metadata.PackageNotFoundError:
                continue
    return found
