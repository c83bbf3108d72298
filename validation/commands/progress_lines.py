"""Progress on standard error: what is being done, for people and logs alike."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console
from rich.text import Text

from palpate.validation.quoting import for_terminal


def progress_lines() -> Callable[[str], None]:
    """A function that prints one dim line."""
    console = Console(stderr=True, highlight=False)
    return lambda line: console.print(Text(f"  {for_terminal(line)}", style="dim"), soft_wrap=True)
