"""A case: its file, its tables, and the problem they make; loaded when it is first used."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.validation.case.load import (
        QUICK,
        Case,
        CaseError,
        builtin_cases,
        builtin_folder,
        load_case,
        load_cases,
        require_case_name,
    )

__all__ = [
    "QUICK",
    "Case",
    "CaseError",
    "builtin_cases",
    "builtin_folder",
    "load_case",
    "load_cases",
    "require_case_name",
]

if not TYPE_CHECKING:  # a type checker takes it for a promise that every name exists

    def __getattr__(name: str) -> Any:
        if name in __all__:
            return getattr(importlib.import_module("palpate.validation.case.load"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
