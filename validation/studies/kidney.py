"""Fig. 5 and Table I: the kidney, original, with linear and with Green strain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from palpate.validation.studies.common import code_of, judge_and_report


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Judge the kidney and leave report.html, the pictures and the table as CSV."""
    return code_of(judge_and_report("kidney", folder, progress, console))
