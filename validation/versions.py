"""Versions of what is installed, for provenance and for `palpate --version`."""

from __future__ import annotations

import platform
import re
from importlib import metadata


def version_of(package: str) -> str:
    """The installed version; "sources in place" where the package is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "sources in place"


def version_lines() -> list[str]:
    """Versions of palpate (first), its compiled core, Python, FEniCSx and extras, a line each."""
    from palpate.fastsim import _core
    from palpate.reference import availability

    parts = availability.versions()
    python, numpy = parts.pop("python"), parts.pop("numpy", "not installed")
    fenicsx = ", ".join(f"{name} {number}" for name, number in parts.items())
    return [
        f"palpate {version_of('palpate')}",
        f"core {_core.__version__}, {_core.widest_instruction_set().name}",
        f"Python {python}, numpy {numpy}, {platform.system()} {platform.machine()}",
        f"FEniCSx: {fenicsx if availability.is_available() else 'not installed'}",
        *(f"extra {extra}: {packages}" for extra, packages in extras().items()),
    ]


def extras() -> dict[str, str]:
    """Each extra that palpate's installed metadata names, with the packages installed for it."""
    try:
        wanted = metadata.requires("palpate") or []
    except metadata.PackageNotFoundError:
        return {}
    found: dict[str, list[str]] = {}
    for requirement in wanted:
        extra = re.search(r"extra\s*==\s*['\"](.+?)['\"]", requirement)
        name = re.match(r"[\w.-]+", requirement)
        if extra and name:
            found.setdefault(extra[1], []).append(_installed(name[0]))
    return {extra: ", ".join(packages) for extra, packages in found.items()}


def _installed(package: str) -> str:
    try:
        return f"{package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"{package} not installed"
