"""Versions of what is installed, for provenance."""

from __future__ import annotations

from importlib import metadata


def version_of(package: str) -> str:
    """The installed version; "sources in place" where the package is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "sources in place"
