"""A case: its file, its tables, and the problem they make."""

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
