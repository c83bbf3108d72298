"""Why a stored reference is not used."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.meshes.errors import InputError


class MissingReferenceError(InputError):
    """No reference is stored for a case."""


class StaleReferenceError(InputError):
    """The stored reference belongs to another mesh, material, support, load or schema."""


class UntrustedReferenceError(StaleReferenceError):
    """The stored reference is not what was once written, or nobody can tell."""


class UnsoundReferenceError(UntrustedReferenceError):
    """The stored reference contradicts itself or its case; `.contradictions` says how."""

    def __init__(self, what: str, contradictions: Sequence[str], remedy: str) -> None:
        self.contradictions = tuple(contradictions)
        shown = "; ".join(self.contradictions[:3])
        more = len(self.contradictions) - 3
        rest = f" and {more} more" if more > 0 else ""
        super().__init__(f"{what} cannot be right: {shown}{rest}; {remedy}")
