"""A case: its file, its tables, and the problem they make."""

from palpate.validation.case.load import (
    QUICK,
    Case,
    CaseError,
    builtin_cases,
    builtin_folder,
    load_case,
    load_cases,
)

__all__ = [
    "QUICK",
    "Case",
    "CaseError",
    "builtin_cases",
    "builtin_folder",
    "load_case",
    "load_cases",
]
